#include "carmap/localize/sized_features.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

namespace carmap {
namespace {

// Features of one corner at neighbouring levels lie this close, by the scale of their level.
constexpr float kTwinPx = 3;

const double kInverseLogScale = 1 / std::log(kLevelScale);

float LevelAt1m(const Feature& feature, const StereoRig& rig) {
  const double disparity_px = rig.WithoutBias(feature.x_px, feature.disparity_px);
  const double distance_m = rig.Triangulate({feature.x_px, feature.y_px}, disparity_px).norm();
  return static_cast<float>(feature.level + std::log(distance_m) * kInverseLogScale);
}

}  // namespace

struct SizedFeatures::BestFeature {
  int distance = std::numeric_limits<int>::max(), second = std::numeric_limits<int>::max();
  size_t slot = 0;

  bool IsClear(const SizeMatchOptions& options) const {
    return distance <= options.max_distance_bits && distance < options.max_ratio * second;
  }
};

SizedFeatures::SizedFeatures(const std::vector<Feature>& features, const StereoRig& rig) {
  std::vector<std::pair<float, uint32_t>> order;
  for (uint32_t i = 0; i < features.size(); ++i) {
    const Feature& feature = features[i];
    if (!feature.has_disparity() || !(rig.WithoutBias(feature.x_px, feature.disparity_px) > 0)) {
      continue;
    }
    order.emplace_back(LevelAt1m(feature, rig), i);
  }
  std::sort(order.begin(), order.end());
  for (const auto& [level_at_1m, feature_idx] : order) {
    levels_at_1m_.push_back(level_at_1m);
    descriptors_.push_back(features[feature_idx].descriptor);
    feature_idxs_.push_back(feature_idx);
    positions_px_.emplace_back(features[feature_idx].x_px, features[feature_idx].y_px);
    twin_radii_px_.push_back(kTwinPx *
                             static_cast<float>(ScaleOfLevel(features[feature_idx].level)));
  }
}

bool SizedFeatures::AreTwins(size_t a, size_t b) const {
  const float radius = std::max(twin_radii_px_[a], twin_radii_px_[b]);
  return (positions_px_[a] - positions_px_[b]).cwiseAbs().maxCoeff() <= radius;
}

SizedFeatures::BestFeature SizedFeatures::FindBest(const SnapshotLandmark& landmark,
                                                   const SizeMatchOptions& options,
                                                   size_t& comparisons) const {
  const auto slack = static_cast<float>(options.max_level_difference);
  const auto begin =
      std::lower_bound(levels_at_1m_.begin(), levels_at_1m_.end(), landmark.level_at_1m - slack);
  const auto end = std::upper_bound(begin, levels_at_1m_.end(), landmark.level_at_1m + slack);
  const auto last = static_cast<size_t>(end - levels_at_1m_.begin());
  BestFeature best;
  for (auto slot = static_cast<size_t>(begin - levels_at_1m_.begin()); slot < last; ++slot) {
    const int distance = HammingDistance(landmark.descriptor, descriptors_[slot]);
    if (distance >= best.second) continue;
    const bool is_twin =
        best.distance <= static_cast<int>(kSignatureBits) && AreTwins(best.slot, slot);
    if (distance < best.distance) {
      if (!is_twin) best.second = best.distance;
      best.distance = distance;
      best.slot = slot;
    } else if (!is_twin) {
      best.second = distance;
    }
  }
  comparisons += static_cast<size_t>(end - begin);
  return best;
}

std::vector<LandmarkMatch> SizedFeatures::Match(const MapSnapshot& map,
                                                std::span<const uint32_t> landmark_idxs,
                                                const SizeMatchOptions& options,
                                                size_t& comparisons) const {
  std::vector<std::tuple<uint32_t, int, uint32_t>> found;  // feature, distance, landmark
  for (const uint32_t landmark_idx : landmark_idxs) {
    const BestFeature best = FindBest(map.landmarks[landmark_idx], options, comparisons);
    if (best.IsClear(options)) {
      found.emplace_back(feature_idxs_[best.slot], best.distance, landmark_idx);
    }
  }
  std::sort(found.begin(), found.end());
  std::vector<LandmarkMatch> matches;
  for (const auto& [feature_idx, distance, landmark_idx] : found) {
    if (!matches.empty() && matches.back().feature_idx == feature_idx) continue;
    matches.push_back({landmark_idx, feature_idx});
  }
  return matches;
}

}  // namespace carmap
