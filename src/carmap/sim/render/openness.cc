#include "carmap/sim/render/openness.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace carmap {
namespace {

constexpr int kReach = 2;
constexpr int kHalo = 2 * kReach;  ///< two rounds
constexpr int kColumns = kTileWidth + 2 * kHalo, kRows = kTileHeight + 2 * kHalo;
constexpr int kCells = kColumns * kRows;

/// Two may differ by so much in how they face, and lie off each other's plane by so much.
struct Limits {
  float cosine, distance_m;
};
Limits LimitsOf(const Sample& sample) {
  if (sample.rough) return {-2, 0.3f};
  return {0.8f, 0.03f + 0.002f * sample.depth_m};
}

/// A tile and what surrounds it, as a structure of arrays.
struct Field {
  int32_t group[kCells];
  float nx[kCells], ny[kCells], nz[kCells];  ///< normal
  float px[kCells], py[kCells], pz[kCells];  ///< position
  float plane[kCells];                       ///< along the normal
  float cosine[kCells], distance[kCells];    ///< limits
  float open[kCells], weight[kCells];

  void Load(int cell, const Sample& sample) {
    group[cell] = static_cast<int32_t>(sample.group);
    nx[cell] = sample.normal.x();
    ny[cell] = sample.normal.y();
    nz[cell] = sample.normal.z();
    px[cell] = sample.position.x();
    py[cell] = sample.position.y();
    pz[cell] = sample.position.z();
    plane[cell] = nx[cell] * px[cell] + ny[cell] * py[cell] + nz[cell] * pz[cell];
    const Limits limits = LimitsOf(sample);
    cosine[cell] = limits.cosine;
    distance[cell] = limits.distance_m;
    open[cell] = sample.open;
    weight[cell] = sample.weight;
  }

  /// Sums up over the cells up to kReach steps away, the outermost by halves: with them each
  /// direction of a block of four counts once.
  void Gather(int step) {
    float open_sum[kCells] = {}, weight_sum[kCells] = {};
    for (int k = -kReach; k <= kReach; ++k) {
      const float share = std::abs(k) == kReach ? 0.5f : 1;
      const int away = k * step;
      const int first = std::max(0, -away), last = std::min(kCells, kCells - away);
      for (int i = first; i < last; ++i) {
        const int j = i + away;
        const float facing = nx[i] * nx[j] + ny[i] * ny[j] + nz[i] * nz[j];
        const float off = std::abs(nx[i] * px[j] + ny[i] * py[j] + nz[i] * pz[j] - plane[i]);
        const bool same = (group[i] == group[j]) & (facing > cosine[i]) & (off < distance[i]);
        const float counts = same ? share : 0;
        open_sum[i] += counts * open[j];
        weight_sum[i] += counts * weight[j];
      }
    }
    std::copy_n(open_sum, kCells, open);
    std::copy_n(weight_sum, kCells, weight);
  }

  void Normalize() {
    for (int i = 0; i < kCells; ++i) {
      const bool known = weight[i] > 0;
      open[i] = known ? open[i] / weight[i] : 0;
      weight[i] = known ? 1 : 0;
    }
  }
};

}  // namespace

std::optional<int> SkyDirectionAt(int x, int y) {
  if ((x + y) % 2 != 0) return std::nullopt;
  // Each once in any block of 4 x 4 pixels.
  static constexpr std::array<uint8_t, 8> kDirections = {0, 5, 3, 6, 7, 2, 4, 1};
  return kDirections[y % 4 * 2 + x / 2 % 2];
}

bool Neighbourly(const Sample& a, const Sample& b) {
  if (a.group != b.group) return false;
  const Limits limits = LimitsOf(a);
  return a.normal.dot(b.normal) > limits.cosine &&
         std::abs(a.normal.dot(b.position - a.position)) < limits.distance_m;
}

void SpreadOpenness(const cv::Rect& tile, const cv::Size& size, std::vector<Sample>& samples) {
  Field field;
  const auto at = [&](int row, int column) -> Sample* {
    const int x = tile.x + column - kHalo, y = tile.y + row - kHalo;
    const bool inside = x >= 0 && y >= 0 && x < size.width && y < size.height;
    return inside ? &samples[static_cast<size_t>(y) * size.width + x] : nullptr;
  };
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Sample* sample = at(row, column);
      field.Load(row * kColumns + column, sample != nullptr ? *sample : Sample{});
    }
  }
  for (int round = 0; round < 2; ++round) {
    field.Gather(1);
    field.Gather(kColumns);
    field.Normalize();
  }
  for (int row = kHalo; row < kHalo + tile.height; ++row) {
    for (int column = kHalo; column < kHalo + tile.width; ++column) {
      const int cell = row * kColumns + column;
      if (field.weight[cell] > 0) at(row, column)->openness = field.open[cell];
    }
  }
}

}  // namespace carmap
