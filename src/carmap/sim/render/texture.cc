#include "carmap/sim/render/texture.h"

#include <hwy/highway.h>
#include <tbb/parallel_for.h>

#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/base/random.h"
#include "carmap/sim/render/pattern_tiles.h"

namespace carmap {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::CappedTag<float, 8>;
using Ints = hn::RebindToSigned<Floats>;
using F = hn::Vec<Floats>;
using I = hn::Vec<Ints>;

constexpr int kLevels = std::bit_width(unsigned{kTileSize});
constexpr int kMaxLooks = 10, kMaxMacroLooks = 3;
/// Of the width that a pixel covers: interpolation widens each look by about a texel more.
constexpr float kSharpness = 0.65f;
constexpr int kPatterns = static_cast<int>(Pattern::kGround) + 1;
constexpr float kMacroTileM = 512.f / 37;
constexpr float kUnit = 128;  ///< value of a texel as bright as the mean

/// Each row is followed by its first texels, and the last row by the first one, so that neighbours
/// can be loaded together.
constexpr int Stride(int size) { return size + 4; }

/// Bytes before each level of a tile, and of a whole tile.
constexpr std::array<int32_t, kLevels + 1> LevelOffsets() {
  std::array<int32_t, kLevels + 1> offsets{};
  for (int level = 0; level < kLevels; ++level) {
    const int size = kTileSize >> level;
    offsets[level + 1] = offsets[level] + (size + 1) * Stride(size);
  }
  return offsets;
}
constexpr auto kLevelOffsets = LevelOffsets();

/// How many pictures there are of a pattern, for seeds to choose from.
int FiguresOf(Pattern pattern) {
  if (pattern == Pattern::kSign || pattern == Pattern::kPoster) return 10;
  return pattern == Pattern::kCurtain ? 4 : 1;
}

void StoreLevel(const cv::Mat& level, uint8_t* texels) {
  const int size = level.rows;
  const cv::Mat_<uint8_t> bytes = cv::Mat_<float>(level * kUnit);
  for (int y = 0; y <= size; ++y) {
    for (int x = 0; x < Stride(size); ++x) *texels++ = bytes(y % size, x % size);
  }
}

/// A picture and its mip maps.
void StoreTile(const cv::Mat& tile, uint8_t* texels) {
  cv::Mat level = tile;
  for (int i = 0; i < kLevels; ++i) {
    StoreLevel(level, texels + kLevelOffsets[i]);
    if (i + 1 < kLevels) cv::resize(level, level, {}, 0.5, 0.5, cv::INTER_AREA);
  }
}

/// One level of the pictures that eight spots look at.
class Level {
 public:
  Level(const uint8_t* texels, I tile, I level) : texels_(texels) {
    const Floats f;
    const Ints i;
    // 2^-level, from its exponent's bits.
    shrink_ = hn::BitCast(f, hn::ShiftLeft<23>(hn::Sub(hn::Set(i, 127), level)));
    size_ = hn::ConvertTo(i, hn::Mul(shrink_, hn::Set(f, kTileSize)));
    first_ = hn::Add(tile, hn::GatherIndex(i, kLevelOffsets.data(), level));
  }

  /// Interpolated at (x, y), in texels of level 0 whose corner is at 0.
  F At(F x, F y) const {
    const Floats f;
    const Ints i;
    x = hn::MulSub(x, shrink_, hn::Set(f, 0.5f));
    y = hn::MulSub(y, shrink_, hn::Set(f, 0.5f));
    const F x0 = hn::Floor(x), y0 = hn::Floor(y);
    const F tx = hn::Sub(x, x0), ty = hn::Sub(y, y0);
    const I mask = hn::Sub(size_, hn::Set(i, 1));
    const I column = hn::And(hn::ConvertTo(i, x0), mask), row = hn::And(hn::ConvertTo(i, y0), mask);
    const I stride = hn::Add(size_, hn::Set(i, Stride(0)));
    const I texel = hn::Add(first_, hn::Add(hn::Mul(row, stride), column));
    const F above = Between(texel, tx), below = Between(hn::Add(texel, stride), tx);
    return hn::MulAdd(ty, hn::Sub(below, above), above);
  }

 private:
  /// A texel and its neighbour to the right.
  F Between(I texel, F share) const {
    const Floats f;
    const Ints i;
    const I byte = hn::Set(i, 255);
    const I four = hn::GatherOffset(i, reinterpret_cast<const int32_t*>(texels_), texel);
    const F a = hn::ConvertTo(f, hn::And(four, byte));
    const F b = hn::ConvertTo(f, hn::And(hn::ShiftRight<8>(four), byte));
    return hn::MulAdd(share, hn::Sub(b, a), a);
  }

  const uint8_t* texels_;
  F shrink_;  ///< from texels of level 0
  I size_;
  I first_;  ///< texel
};

}  // namespace

/// Which tile each spot looks at, and how it lies there.
struct Textures::Looks {
  alignas(32) int32_t tile[TextureSpots::kCapacity];  ///< its first texel
  alignas(32) float texels_per_m[TextureSpots::kCapacity];
  alignas(32) float shift_u[TextureSpots::kCapacity], shift_v[TextureSpots::kCapacity];  ///< texels
};

const Textures& Textures::Get() {
  static const auto* const textures = new Textures;
  return *textures;
}

Textures::Textures() : layers_(kPatterns) {
  std::vector<std::function<cv::Mat()>> tiles;
  for (int p = 0; p < kPatterns; ++p) {
    const auto pattern = static_cast<Pattern>(p);
    layers_[p].first_tile = static_cast<int>(tiles.size());
    layers_[p].variants = FiguresOf(pattern);
    for (int v = 0; v < layers_[p].variants; ++v) {
      tiles.emplace_back([=] { return DrawPatternTile(pattern, static_cast<uint32_t>(v)); });
    }
  }
  const auto add_macro = [&](MacroTile kind,
                             std::initializer_list<std::pair<Pattern, float>> shares) {
    for (const auto& [pattern, share] : shares) {
      layers_[static_cast<int>(pattern)].macro_tile = static_cast<int>(tiles.size());
      layers_[static_cast<int>(pattern)].macro_share = share;
    }
    tiles.emplace_back([=] { return DrawMacroTile(kind); });
  };
  using enum Pattern;
  add_macro(MacroTile::kRoad, {{kAsphalt, 1.f}});
  add_macro(MacroTile::kStreaks,
            {{kConcrete, 0.4f}, {kPlaster, 0.12f}, {kStone, 0.4f}, {kBrick, 0.4f}, {kMetal, 0.3f}});
  add_macro(MacroTile::kStains, {{kGrass, 1.f},
                                 {kSoil, 1.f},
                                 {kGravel, 1.f},
                                 {kLeaves, 1.f},
                                 {kPaving, 0.5f},
                                 {kCobbles, 0.5f},
                                 {kWood, 0.4f},
                                 {kRoofTiles, 0.5f},
                                 {kBark, 0.5f},
                                 {kFabric, 0.3f},
                                 {kPlain, 0.2f},
                                 {kCarPaint, 0.15f},
                                 {kGlass, 0.1f},
                                 {kRubber, 0.2f},
                                 {kSkin, 0.1f},
                                 {kSign, 0.1f},
                                 {kPoster, 0.1f},
                                 {kCurtain, 0.2f},
                                 {kGround, 1.f}});
  texels_.resize(tiles.size() * kLevelOffsets[kLevels]);
  tbb::parallel_for(size_t{0}, tiles.size(),
                    [&](size_t i) { StoreTile(tiles[i](), &texels_[i * kLevelOffsets[kLevels]]); });
}

void Textures::LookUpTiles(const TextureSpots& spots, const Looks& looks, int max_looks, int count,
                           float* value) const {
  const Floats f;
  const Ints i;
  const int lanes = static_cast<int>(hn::Lanes(f));
  const F zero = hn::Zero(f), one = hn::Set(f, 1);
  for (int k = 0; k < count; k += lanes) {
    const F scale = hn::Load(f, looks.texels_per_m + k);
    const F x = hn::MulAdd(hn::Load(f, spots.u_m + k), scale, hn::Load(f, looks.shift_u + k));
    const F y = hn::MulAdd(hn::Load(f, spots.v_m + k), scale, hn::Load(f, looks.shift_v + k));
    const F along_x = hn::Mul(hn::Load(f, spots.major_u_m + k), scale);
    const F along_y = hn::Mul(hn::Load(f, spots.major_v_m + k), scale);
    const F major = hn::Sqrt(hn::MulAdd(along_x, along_x, hn::Mul(along_y, along_y)));
    const F minor = hn::Max(hn::Mul(hn::Load(f, spots.minor_m + k), scale), one);
    const F looks_wanted = hn::Min(hn::Max(hn::Ceil(hn::Div(major, minor)), one),
                                   hn::Set(f, static_cast<float>(max_looks)));
    const F width =
        hn::Max(hn::Mul(hn::Max(minor, hn::Div(major, looks_wanted)), hn::Set(f, kSharpness)), one);
    // log2(width), linear between powers of two.
    const I bits = hn::BitCast(i, width);
    const I octave = hn::Sub(hn::ShiftRight<23>(bits), hn::Set(i, 127));
    const F mantissa =
        hn::BitCast(f, hn::Or(hn::And(bits, hn::Set(i, 0x7fffff)), hn::Set(i, 0x3f800000)));
    const F share = hn::Sub(mantissa, one);
    const I last = hn::Set(i, kLevels - 1);
    const I tile = hn::Load(i, looks.tile + k);
    const Level fine(texels_.data(), tile, hn::Min(octave, last));
    const Level coarse(texels_.data(), tile, hn::Min(hn::Add(octave, hn::Set(i, 1)), last));

    const F step = hn::Div(one, looks_wanted);
    F at = hn::MulSub(step, hn::Set(f, 0.5f), hn::Set(f, 0.5f));
    F sum = zero;
    const auto most = static_cast<int>(hn::GetLane(hn::MaxOfLanes(f, looks_wanted)));
    for (int look = 0; look < most; ++look) {
      const F tap_x = hn::MulAdd(at, along_x, x), tap_y = hn::MulAdd(at, along_y, y);
      const F a = fine.At(tap_x, tap_y), b = coarse.At(tap_x, tap_y);
      const auto counts = hn::Lt(hn::Set(f, static_cast<float>(look)), looks_wanted);
      sum = hn::Add(sum, hn::IfThenElseZero(counts, hn::MulAdd(share, hn::Sub(b, a), a)));
      at = hn::Add(at, step);
    }
    hn::Store(hn::Mul(hn::Mul(sum, step), hn::Set(f, 1 / kUnit)), f, value + k);
  }
}

void Textures::LookUp(const TextureSpots& spots, int count, float* brightness) const {
  if (count <= 0) return;
  Looks looks{};
  const int padded = (count + 7) / 8 * 8;
  for (int k = 0; k < padded; ++k) {
    const Layers& layers = layers_[static_cast<int>(spots.pattern[k])];
    const uint64_t hash = HashKeys(spots.seed[k], 17);
    const auto variant = static_cast<int>((hash >> 40) % static_cast<uint64_t>(layers.variants));
    looks.tile[k] = (layers.first_tile + variant) * kLevelOffsets[kLevels];
    looks.texels_per_m[k] = kTileSize / layers.tile_m;
    // The ground is papered without seams.
    looks.shift_u[k] = spots.seed[k] == 0 ? 0.f : static_cast<float>(hash % kTileSize);
    looks.shift_v[k] = spots.seed[k] == 0 ? 0.f : static_cast<float>((hash >> 20) % kTileSize);
  }
  LookUpTiles(spots, looks, kMaxLooks, padded, brightness);

  alignas(32) float macro[TextureSpots::kCapacity];
  for (int k = 0; k < padded; ++k) {
    looks.tile[k] = layers_[static_cast<int>(spots.pattern[k])].macro_tile * kLevelOffsets[kLevels];
    looks.texels_per_m[k] = kTileSize / kMacroTileM;
  }
  LookUpTiles(spots, looks, kMaxMacroLooks, padded, macro);
  for (int k = 0; k < padded; ++k) {
    const float share = layers_[static_cast<int>(spots.pattern[k])].macro_share;
    brightness[k] *= 1 + share * (macro[k] - 1);
  }
}

}  // namespace carmap
