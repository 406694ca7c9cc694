#include "carmap/sim/render/pattern_tiles.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "carmap/base/random.h"

namespace carmap {
namespace {

using Image = cv::Mat_<float>;
constexpr int S = kTileSize;

Image Even(float value = 1) { return Image(S, S, value); }

float SignedHash(uint64_t seed, int x, int y) {
  return static_cast<float>(2 * UnitHash(seed, (uint64_t(uint32_t(y)) << 32) | uint32_t(x)) - 1);
}

/// With mean 0 and standard deviation 1.
Image Standardized(const Image& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return Image((image - mean[0]) / std::max(deviation[0], 1e-6));
}

/// Noise of all wavelengths from `cells_x` × `cells_y` a tile up, each octave weaker by
/// `persistence` than the one before: white noise under a power law, by way of its spectrum (Saupe,
/// in The Science of Fractal Images, 1988). Standardized.
Image Octaves(uint64_t seed, float cells_x, float cells_y, float persistence) {
  // An octave's ring of the spectrum grows with the frequency's square.
  const double slope = (std::log2(persistence) - 1) / 2;
  Image amplitudes(S, S);
  for (int y = 0; y < S; ++y) {
    const auto fy = static_cast<float>(y < S / 2 ? y : y - S) / cells_y;
    for (int x = 0; x < S; ++x) {
      const auto fx = static_cast<float>(x < S / 2 ? x : x - S) / cells_x;
      const float f2 = fx * fx + fy * fy;
      amplitudes(y, x) = f2 < 1 ? 1e30f : f2;
    }
  }
  cv::pow(amplitudes, slope, amplitudes);
  cv::Mat_<cv::Vec2f> spectrum(S, S);
  for (int y = 0; y < S; ++y) {
    for (int x = 0; x < S; ++x) {
      const uint64_t bits = HashKeys(seed, uint64_t(y) << 32 | uint64_t(x));
      spectrum(y, x) = amplitudes(y, x) * cv::Vec2f(static_cast<float>(int32_t(bits >> 32)),
                                                    static_cast<float>(int32_t(bits)));
    }
  }
  cv::Mat noise;
  cv::dft(spectrum, noise, cv::DFT_INVERSE | cv::DFT_COMPLEX_OUTPUT);
  cv::extractChannel(noise, noise, 0);
  return Standardized(noise);
}

/// A rectangle or stone that a texel belongs to.
struct Piece {
  float edge;  ///< texels to the nearest edge of the piece
  float u, v;  ///< within the piece, 0..1
  float tone;  ///< of the whole piece, -1..1
};

/// Rows of equal rectangles, each row shifted against the one before by `shift` of a piece.
Image Courses(uint64_t seed, int columns, int rows, float shift,
              const std::function<float(const Piece&)>& shade) {
  Image image(S, S);
  const float width = static_cast<float>(S) / static_cast<float>(columns);
  const float height = static_cast<float>(S) / static_cast<float>(rows);
  for (int y = 0; y < S; ++y) {
    const int row = std::min(static_cast<int>(static_cast<float>(y) / height), rows - 1);
    const float v = (static_cast<float>(y) + 0.5f) / height - static_cast<float>(row);
    for (int x = 0; x < S; ++x) {
      const float at = (static_cast<float>(x) + 0.5f) / width + shift * static_cast<float>(row % 2);
      const int column = static_cast<int>(at);
      const float u = at - static_cast<float>(column);
      const float edge = std::min(std::min(u, 1 - u) * width, std::min(v, 1 - v) * height);
      image(y, x) = shade({edge, u, v, SignedHash(seed, column % columns, row)});
    }
  }
  return image;
}

/// Stones about jittered lattice points: Worley's cells (1996).
Image Stones(uint64_t seed, int cells, float jitter,
             const std::function<float(const Piece&)>& shade) {
  std::vector<cv::Point2f> offsets(size_t(cells) * cells);
  for (int i = 0; i < cells * cells; ++i) {
    offsets[i] = 0.5f * jitter * cv::Point2f(SignedHash(seed, i, 0), SignedHash(seed, i, 1));
  }
  const float size = static_cast<float>(S) / static_cast<float>(cells);
  Image image(S, S);
  for (int y = 0; y < S; ++y) {
    for (int x = 0; x < S; ++x) {
      const cv::Point2f p((static_cast<float>(x) + 0.5f) / size,
                          (static_cast<float>(y) + 0.5f) / size);
      float nearest = 1e9f, second = 1e9f, tone = 0;
      for (int j = static_cast<int>(p.y) - 1; j <= static_cast<int>(p.y) + 1; ++j) {
        for (int i = static_cast<int>(p.x) - 1; i <= static_cast<int>(p.x) + 1; ++i) {
          const int column = (i + cells) % cells, row = (j + cells) % cells;
          const cv::Point2f centre =
              cv::Point2f(static_cast<float>(i) + 0.5f, static_cast<float>(j) + 0.5f) +
              offsets[size_t(row) * cells + column];
          const cv::Point2f d = p - centre;
          const float distance = std::sqrt(d.dot(d));
          if (distance < nearest) {
            second = nearest;
            nearest = distance;
            tone = SignedHash(HashKeys(seed, 7), column, row);
          } else {
            second = std::min(second, distance);
          }
        }
      }
      image(y, x) = shade({0.5f * (second - nearest) * size, nearest, 0, tone});
    }
  }
  return image;
}

/// Falls from 1 at an edge to 0 `width` texels away.
float Joint(const Piece& piece, float width) {
  const float t = std::clamp(1.5f - piece.edge / width, 0.f, 1.f);
  return t * t * (3 - 2 * t);
}

/// Draws strokes on an even ground; each is drawn again across the edges of the tile.
class Canvas {
 public:
  explicit Canvas(uint8_t ground) : pixels_(S, S, ground) {}

  void Line(cv::Point2f a, cv::Point2f b, int tone, int width) {
    Wrapped(a, [&](cv::Point2f by) {
      cv::line(pixels_, Fixed(a + by), Fixed(b + by), cv::Scalar(tone), width, cv::LINE_AA, kShift);
    });
  }
  void Ellipse(cv::Point2f centre, cv::Size2f axes, float angle_deg, int tone) {
    const cv::Point fixed_axes = Fixed({axes.width, axes.height});
    Wrapped(centre, [&](cv::Point2f by) {
      cv::ellipse(pixels_, Fixed(centre + by), cv::Size(fixed_axes), angle_deg, 0, 360,
                  cv::Scalar(tone), cv::FILLED, cv::LINE_AA, kShift);
    });
  }
  void Arc(cv::Point2f centre, cv::Size2f axes, float from_deg, float to_deg, int tone, int width) {
    const cv::Point fixed_axes = Fixed({axes.width, axes.height});
    Wrapped(centre, [&](cv::Point2f by) {
      cv::ellipse(pixels_, Fixed(centre + by), cv::Size(fixed_axes), 0, from_deg, to_deg,
                  cv::Scalar(tone), width, cv::LINE_AA, kShift);
    });
  }
  void Box(cv::Point2f corner, cv::Size2f size, int tone) {
    Wrapped(corner, [&](cv::Point2f by) {
      cv::rectangle(pixels_, cv::Rect(cv::Point(corner + by), cv::Size(size)), cv::Scalar(tone),
                    cv::FILLED);
    });
  }
  /// Tones as standard deviations from the mean.
  Image Standardized() const {
    Image image;
    pixels_.convertTo(image, CV_32F);
    return carmap::Standardized(image);
  }
  /// Tones as shares of white.
  Image Shares() const {
    Image image;
    pixels_.convertTo(image, CV_32F, 1 / 255.);
    return image;
  }

 private:
  static constexpr int kShift = 4;

  static cv::Point Fixed(cv::Point2f p) {
    return {static_cast<int>(std::lround(p.x * (1 << kShift))),
            static_cast<int>(std::lround(p.y * (1 << kShift)))};
  }
  template <typename Draw>
  static void Wrapped(cv::Point2f at, Draw draw) {
    const float x = at.x < S / 2 ? S : -S, y = at.y < S / 2 ? S : -S;
    for (const cv::Point2f by : {cv::Point2f(0, 0), {x, 0}, {0, y}, {x, y}}) draw(by);
  }

  cv::Mat_<uint8_t> pixels_;
};

cv::Point2f Anywhere(HashSequence& random) {
  return {static_cast<float>(random.Between(0, S)), static_cast<float>(random.Between(0, S))};
}
float Between(HashSequence& random, double low, double high) {
  return static_cast<float>(random.Between(low, high));
}

/// One letter-like sign: two to four straight or round strokes in a box.
void DrawGlyph(Canvas& canvas, HashSequence& random, cv::Point2f corner, cv::Size2f size, int tone,
               int width) {
  const auto point = [&] {
    return corner + cv::Point2f(size.width * 0.5f * static_cast<float>(random.Below(3)),
                                size.height * 0.5f * static_cast<float>(random.Below(3)));
  };
  if (random.Chance(0.7)) {
    const float x = corner.x + (random.Chance(0.7) ? 0 : size.width / 2);
    canvas.Line({x, corner.y}, {x, corner.y + size.height}, tone, width);
  }
  for (uint32_t strokes = 1 + random.Below(3); strokes > 0; --strokes) {
    if (random.Chance(0.35)) {
      const float from = 90.f * static_cast<float>(random.Below(4));
      canvas.Arc(corner + cv::Point2f(size.width / 2, size.height * Between(random, 0.3, 0.7)),
                 {size.width / 2, size.height * 0.3f}, from, from + 180, tone, width);
    } else {
      canvas.Line(point(), point(), tone, width);
    }
  }
}

void DrawLettering(Canvas& canvas, HashSequence& random, float x, float right, float y,
                   float height, int tone) {
  const float width = height * 0.6f;
  while (x + width < right) {
    if (!random.Chance(0.15)) {
      DrawGlyph(canvas, random, {x, y}, {width, height}, tone,
                std::max(1, static_cast<int>(height / 6)));
    }
    x += width * 1.5f;
  }
}

Image Asphalt(uint64_t seed) {
  Canvas stones(110);
  HashSequence random(seed);
  for (int i = 0; i < 3000; ++i) {
    const float radius = Between(random, 0.5, 1.3);
    stones.Ellipse(Anywhere(random), {radius, radius * Between(random, 0.6, 1)},
                   Between(random, 0, 180), static_cast<int>(random.Between(30, 230)));
  }
  return Even() + 0.14f * stones.Standardized() + 0.26f * Octaves(seed, 128, 128, 1) +
         0.02f * Octaves(HashKeys(seed, 1), 8, 8, 0.8f);
}

Image Paving(uint64_t seed) {
  const Image slabs = Courses(seed, 8, 8, 0.5f, [](const Piece& piece) {
    return 1.05f + 0.09f * piece.tone - 0.45f * Joint(piece, 1.3f);
  });
  return slabs + 0.045f * Octaves(seed, 16, 16, 0.8f);
}

Image Cobbles(uint64_t seed) {
  const Image stones = Stones(seed, 24, 0.5f, [](const Piece& piece) {
    return 1.1f + 0.16f * piece.tone - 0.3f * piece.u * piece.u - 0.5f * Joint(piece, 1.8f);
  });
  return stones + 0.07f * Octaves(seed, 32, 32, 0.8f);
}

Image Gravel(uint64_t seed) {
  const Image stones = Stones(seed, 96, 0.9f, [](const Piece& piece) {
    return 1.05f + 0.3f * piece.tone - 0.5f * Joint(piece, 0.8f);
  });
  return stones + 0.08f * Octaves(seed, 8, 8, 0.7f);
}

Image Concrete(uint64_t seed) {
  Canvas pores(128);
  HashSequence random(seed);
  for (int i = 0; i < 700; ++i) {
    const float radius = Between(random, 0.5, 1.5);
    pores.Ellipse(Anywhere(random), {radius, radius}, 0, 30);
  }
  return Even() + 0.03f * pores.Standardized() + 0.06f * Octaves(seed, 4, 4, 0.75f);
}

Image Grass(uint64_t seed) {
  Canvas blades(70);
  HashSequence random(seed);
  for (int i = 0; i < 9000; ++i) {
    const cv::Point2f root = Anywhere(random);
    const float angle = Between(random, 0, 2 * M_PI), length = Between(random, 3, 14);
    const auto tone = static_cast<int>(random.Between(20, 210));
    blades.Line(root, root + length * cv::Point2f(std::cos(angle), std::sin(angle)), tone, 1);
  }
  return Even() + 0.25f * blades.Standardized() + 0.14f * Octaves(seed, 8, 8, 0.8f);
}

Image Leaves(uint64_t seed) {
  Canvas leaves(25);
  HashSequence random(seed);
  for (int i = 0; i < 3200; ++i) {
    const float length = Between(random, 4, 9);
    // Later ones lie on top and get more light.
    const double light = i / 3200.;
    leaves.Ellipse(Anywhere(random), {length, length * Between(random, 0.3, 0.6)},
                   Between(random, 0, 180),
                   static_cast<int>(random.Between(10 + 30 * light, 60 + 150 * light)));
  }
  return Even() + 0.42f * leaves.Standardized() + 0.15f * Octaves(seed, 8, 8, 0.7f);
}

Image Brick(uint64_t seed) {
  const Image bricks = Courses(seed, 10, 32, 0.5f, [](const Piece& piece) {
    return 0.95f + 0.17f * piece.tone + 0.3f * Joint(piece, 1.f);
  });
  return bricks + 0.07f * Octaves(seed, 16, 16, 0.85f);
}

Image Stone(uint64_t seed) {
  const Image blocks = Courses(seed, 4, 8, 0.5f, [](const Piece& piece) {
    return 1.04f + 0.08f * piece.tone - 0.4f * Joint(piece, 1.5f);
  });
  return blocks + 0.07f * Octaves(seed, 8, 8, 0.75f);
}

Image RoofTiles(uint64_t seed) {
  const Image tiles = Courses(seed, 12, 8, 0.5f, [](const Piece& piece) {
    const float round = std::sin(static_cast<float>(M_PI) * piece.u);
    return 0.8f + 0.13f * piece.tone + 0.3f * round - 0.55f * std::max(0.f, 1 - piece.v * 6) -
           0.15f * Joint(piece, 1.f);
  });
  return tiles + 0.06f * Octaves(seed, 16, 16, 0.8f);
}

Image Wood(uint64_t seed) {
  const Image planks = Courses(seed, 16, 1, 0, [](const Piece& piece) {
    return 1.03f + 0.14f * piece.tone - 0.6f * Joint(piece, 1.2f);
  });
  return planks + 0.1f * Octaves(seed, 64, 4, 0.7f);
}

Image Bark(uint64_t seed) {
  const Image ridges = Octaves(seed, 48, 10, 0.65f);
  return Even() + 0.28f * ridges + 0.08f * Octaves(HashKeys(seed, 1), 16, 16, 0.8f);
}

Image Curtain(uint64_t seed) {
  Image image = 0.14f * Octaves(seed, 24, 2, 0.5f) + 0.04f * Octaves(seed, 4, 4, 0.8f);
  HashSequence random(seed, 1);
  Canvas things(128);
  for (int i = 0; i < 60; ++i) {
    things.Box(Anywhere(random), {Between(random, 5, 50), Between(random, 10, 90)},
               static_cast<int>(random.Between(40, 255)));
  }
  return Even() + image + 0.2f * things.Standardized();
}

Image Sign(uint64_t seed, uint32_t variant) {
  HashSequence random(seed, variant);
  const bool dark_ground = random.Chance(0.4);
  Canvas canvas(dark_ground ? 70 : 235);
  const int tone = dark_ground ? 245 : 25;
  // Lines of 12 to 50 cm; the tile is 2.56 m wide.
  for (float y = 4; y < S - 12;) {
    const float height = Between(random, 14, 60);
    if (y + height > S) break;
    DrawLettering(canvas, random, Between(random, 0, 20), S, y, height, tone);
    y += height * 1.35f;
  }
  return canvas.Shares();
}

Image Poster(uint64_t seed, uint32_t variant) {
  HashSequence random(seed, variant);
  Canvas canvas(static_cast<uint8_t>(random.Between(80, 220)));
  for (int i = 0; i < 14; ++i) {
    const auto tone = static_cast<int>(random.Between(15, 250));
    if (random.Chance(0.5)) {
      canvas.Ellipse(Anywhere(random), {Between(random, 15, 110), Between(random, 15, 70)},
                     Between(random, 0, 180), tone);
    } else {
      canvas.Box(Anywhere(random), {Between(random, 20, 200), Between(random, 20, 140)}, tone);
    }
  }
  for (int i = 0; i < 9; ++i) {
    const float x = Between(random, 0, S / 2.), height = Between(random, 10, 55);
    DrawLettering(canvas, random, x, x + Between(random, 100, S / 2.), Between(random, 0, S),
                  height, random.Chance(0.5) ? 20 : 245);
  }
  return canvas.Shares() + 0.05f * Octaves(seed, 8, 8, 0.8f);
}

Image Draw(Pattern pattern, uint64_t seed, uint32_t variant) {
  switch (pattern) {
    case Pattern::kAsphalt:
      return Asphalt(seed);
    case Pattern::kPaving:
      return Paving(seed);
    case Pattern::kCobbles:
      return Cobbles(seed);
    case Pattern::kConcrete:
      return Concrete(seed);
    case Pattern::kGrass:
      return Grass(seed);
    case Pattern::kSoil:
      return Even() + 0.22f * Octaves(seed, 8, 8, 0.85f);
    case Pattern::kGravel:
      return Gravel(seed);
    case Pattern::kBrick:
      return Brick(seed);
    case Pattern::kPlaster:
      return Even() + 0.035f * Octaves(seed, 8, 8, 0.9f);
    case Pattern::kStone:
      return Stone(seed);
    case Pattern::kRoofTiles:
      return RoofTiles(seed);
    case Pattern::kWood:
      return Wood(seed);
    case Pattern::kBark:
      return Bark(seed);
    case Pattern::kLeaves:
      return Leaves(seed);
    case Pattern::kMetal:
      return Even() + 0.04f * Octaves(seed, 4, 64, 0.7f) + 0.04f * Octaves(seed, 4, 4, 0.7f);
    case Pattern::kCarPaint:
    case Pattern::kPlain:
      return Even() + 0.02f * Octaves(seed, 4, 4, 0.8f);
    case Pattern::kRubber:
      return Even() + 0.1f * Octaves(seed, 32, 32, 0.8f);
    case Pattern::kFabric:
      return Even() + 0.12f * Octaves(seed, 20, 5, 0.65f) + 0.03f * Octaves(seed, 256, 256, 1);
    case Pattern::kSkin:
      return Even() + 0.05f * Octaves(seed, 16, 16, 0.7f);
    case Pattern::kCurtain:
      return Curtain(seed);
    case Pattern::kSign:
      return Sign(seed, variant);
    case Pattern::kPoster:
      return Poster(seed, variant);
    case Pattern::kGlass:
    case Pattern::kGround:
      break;
  }
  return Even();
}

/// Mean 1, within 0..2.
cv::Mat Finished(const Image& image) {
  Image clamped;
  cv::min(cv::max(image / cv::mean(image)[0], 0), 2, clamped);
  return clamped / cv::mean(clamped)[0];
}

Image Road() {
  HashSequence random(42);
  Canvas patches(128), lines(128);
  for (int i = 0; i < 10; ++i) {
    patches.Box(Anywhere(random), {Between(random, 20, 90), Between(random, 20, 60)},
                static_cast<int>(random.Between(95, 150)));
  }
  for (int i = 0; i < 14; ++i) {  // cracks and tar seams
    cv::Point2f at = Anywhere(random);
    float angle = Between(random, 0, 2 * M_PI);
    const int tone = random.Chance(0.6) ? 60 : 85;
    for (int step = 0; step < 24; ++step) {
      angle += Between(random, -0.5, 0.5);
      const cv::Point2f next = at + 7.f * cv::Point2f(std::cos(angle), std::sin(angle));
      lines.Line(at, next, tone, 1);
      at = next;
    }
  }
  return Even() + 0.03f * patches.Standardized() + 0.03f * lines.Standardized() +
         0.04f * Octaves(43, 3, 3, 0.5f);
}

}  // namespace

cv::Mat DrawPatternTile(Pattern pattern, uint32_t variant) {
  return Finished(Draw(pattern, HashKeys(0x7e87u, static_cast<uint64_t>(pattern)), variant));
}

cv::Mat DrawMacroTile(MacroTile kind) {
  switch (kind) {
    case MacroTile::kStains:
      return Finished(Even() + 0.15f * Octaves(44, 3, 3, 0.7f));
    case MacroTile::kStreaks:
      return Finished(Even() + 0.1f * Octaves(45, 3, 3, 0.65f) + 0.1f * Octaves(46, 40, 4, 0.6f));
    case MacroTile::kRoad:
      return Finished(Road());
    case MacroTile::kClouds:
      return Finished(Even() + 0.3f * Octaves(47, 3, 3, 0.5f));
  }
  return Even();
}

}  // namespace carmap
