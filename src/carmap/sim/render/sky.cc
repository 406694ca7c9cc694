#include "carmap/sim/render/sky.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "carmap/base/random.h"
#include "carmap/sim/render/pattern_tiles.h"

namespace carmap {
namespace {

constexpr int kCloudSize = 256;
constexpr int kSkylineSize = 4096;

/// Interpolated in a tiling picture.
float Tiled(const cv::Mat& tile, float x, float y) {
  const float x0 = std::floor(x), y0 = std::floor(y);
  const float tx = x - x0, ty = y - y0;
  const int mask = tile.cols - 1, column = static_cast<int>(x0), row = static_cast<int>(y0);
  const auto* above = tile.ptr<float>(row & mask);
  const auto* below = tile.ptr<float>((row + 1) & mask);
  const int left = column & mask, right = (column + 1) & mask;
  const float a = above[left] + tx * (above[right] - above[left]);
  const float b = below[left] + tx * (below[right] - below[left]);
  return a + ty * (b - a);
}

float SmoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.f, 1.f);
  return t * t * (3 - 2 * t);
}

float Azimuth(const Eigen::Vector3f& d) {  // 0..1
  return std::atan2(d.y(), d.x()) / (2 * static_cast<float>(M_PI)) + 0.5f;
}

std::vector<float> Skyline(uint64_t seed) {
  std::vector<float> heights(kSkylineSize, 0.f);
  float weight = 0.006f;
  for (int cells = 16; cells <= 2048; cells *= 2, weight *= 0.6f) {
    for (int i = 0; i < kSkylineSize; ++i) {
      const float at = static_cast<float>(i) * static_cast<float>(cells) / kSkylineSize;
      const int cell = static_cast<int>(at);
      const float t = at - static_cast<float>(cell);
      const auto height = [&](int c) {
        return static_cast<float>(UnitHash(HashKeys(seed, cells), c % cells));
      };
      heights[i] += weight * (height(cell) + t * (height(cell + 1) - height(cell)));
    }
  }
  return heights;
}

}  // namespace

Sky::Sky(const Light& light)
    : light_(light),
      to_sun_(light.to_sun_in_enu.cast<float>()),
      skyline_(Skyline(light.cloud_seed)) {
  cv::resize(DrawMacroTile(MacroTile::kClouds), clouds_, {kCloudSize, kCloudSize}, 0, 0,
             cv::INTER_AREA);
  HashSequence random(light.cloud_seed, 1);
  cloud_u_ = static_cast<float>(random.Between(0, kCloudSize));
  cloud_v_ = static_cast<float>(random.Between(0, kCloudSize));
  cloud_share_ = static_cast<float>(light.weather == Weather::kOvercast ? random.Between(0.5, 0.9)
                                                                        : random.Between(0.1, 0.6));
  // So scaled that level ground gets light.sky.
  double sum = 0;
  constexpr int kRings = 24, kSectors = 48;
  for (int ring = 0; ring < kRings; ++ring) {
    const float z = std::sqrt((static_cast<float>(ring) + 0.5f) / kRings);
    for (int sector = 0; sector < kSectors; ++sector) {
      const float azimuth = 2 * static_cast<float>(M_PI) * static_cast<float>(sector) / kSectors;
      const float r = std::sqrt(1 - z * z);
      sum += Dome({r * std::cos(azimuth), r * std::sin(azimuth), z});
    }
  }
  scale_ = static_cast<float>(light.sky / (sum / (kRings * kSectors)));
  ground_ =
      static_cast<float>(0.15 * (light.sky + light.sun * std::max(0., light.to_sun_in_enu.z())));
  haze_ = scale_ * 0.5f * (Dome({1, 0, 0.03f}) + Dome({0, 1, 0.03f}));
}

float Sky::Dome(const Eigen::Vector3f& d) const {
  const float z = std::max(d.z(), 0.f);
  const float lift = 1 / (z + 0.15f);
  const float cloud =
      Tiled(clouds_, d.x() * lift * 30 + cloud_u_, d.y() * lift * 30 + cloud_v_) - 1;
  if (light_.weather == Weather::kOvercast) {
    return (1 + 2 * z) / 3 * (1 + 0.35f * cloud_share_ * cloud);
  }
  // Brighter towards the horizon and about the sun; thin clouds.
  const float sun = std::max(0.f, d.dot(to_sun_));
  const float sun2 = sun * sun, sun8 = sun2 * sun2 * sun2 * sun2;
  const float clear = 0.55f + 0.5f * std::exp(-4 * z) + 0.35f * sun8 + 0.1f * sun2;
  const float cover = cloud_share_ * SmoothStep(0.05f, 0.6f, cloud);
  return clear + cover * (1.6f - clear);
}

float Sky::Radiance(const Eigen::Vector3f& direction, float pixel_rad) const {
  const float at = Azimuth(direction) * kSkylineSize;
  const int i = static_cast<int>(at) % kSkylineSize;
  const float t = at - std::floor(at);
  const float top = skyline_[i] + t * (skyline_[(i + 1) % kSkylineSize] - skyline_[i]);
  const float covered = SmoothStep(-pixel_rad, pixel_rad, top - direction.z());
  const float distant = 0.45f * haze_ + 0.3f * ground_;
  const float dome = scale_ * Dome(direction);
  return dome + covered * (distant - dome);
}

float Sky::Mirrored(const Eigen::Vector3f& direction) const {
  if (direction.z() < 0) return ground_;
  const float sun = direction.dot(to_sun_);
  const float glare = sun > 0.99f ? static_cast<float>(light_.sun) * 12 * (sun - 0.99f) * 100 : 0;
  return scale_ * Dome(direction) + glare;
}

}  // namespace carmap
