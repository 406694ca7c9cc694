// Image features: where they are, how far away, and what they look like.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace carmap {

/// Binary intensity tests in a descriptor. Fixed: maps of all vehicles must agree on it.
inline constexpr size_t kSignatureBits = 128;

/// The feature signature of paper §2 (feature/signature.h).
struct Descriptor {
  std::array<uint64_t, kSignatureBits / 64> words{};
  auto operator<=>(const Descriptor&) const = default;
};

/// Number of differing bits, 0..kSignatureBits.
inline int HammingDistance(const Descriptor& a, const Descriptor& b) {
  int distance = 0;
  for (size_t i = 0; i < a.words.size(); ++i) distance += std::popcount(a.words[i] ^ b.words[i]);
  return distance;
}

/// A feature of the left image, in pixels of the full-size image.
struct Feature {
  float x_px = 0, y_px = 0;
  float disparity_px = kNoDisparity;  ///< u_left - u_right > 0, or kNoDisparity
  uint8_t level = 0;                  ///< of the image pyramid; 0 is full size
  /// Index, in the frame, of the feature at a finer level that shows the same corner; kNoTwin if
  /// there is none (LinkTwins).
  uint16_t twin_idx = kNoTwin;
  Descriptor descriptor;

  static constexpr float kNoDisparity = -1;
  static constexpr uint16_t kNoTwin = 0xffff;
  bool has_disparity() const { return disparity_px > 0; }
};

/// Index of the feature that stands for the corner that feature `idx` of a frame shows: equal for
/// all features of one corner.
inline uint32_t CornerOf(const std::vector<Feature>& features, uint32_t idx) {
  return features[idx].twin_idx == Feature::kNoTwin ? idx : features[idx].twin_idx;
}

/// Size ratio of neighbouring pyramid levels. Fixed: maps of all vehicles must agree on it.
inline constexpr double kLevelScale = 1.2;
inline constexpr int kLevelCount = 8;

/// Pixels of the full-size image that one pixel of this level spans.
inline double ScaleOfLevel(int level) { return std::pow(kLevelScale, level); }

/// A coordinate of a level's pixel grid in the full-size image, and back. Images share their outer
/// edges, so centres of pixels shift by half a pixel's difference.
inline double FullSizeFromLevel(double at_level, double scale) {
  return (at_level + 0.5) * scale - 0.5;
}
inline double LevelFromFullSize(double at_full, double scale) {
  return (at_full + 0.5) / scale - 0.5;
}

}  // namespace carmap
