#include "carmap/eval/matching_ratio.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "carmap/feature/feature_grid.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/localize/map_neighbourhood.h"

namespace carmap {
namespace {

constexpr double kFarthestM = 150;  // landmarks farther away are not looked for

bool IsAt(const Feature& feature, const Eigen::Vector3d& uvd, double radius_px) {
  return std::abs(feature.x_px - uvd.x()) <= radius_px &&
         std::abs(feature.y_px - uvd.y()) <= radius_px;
}

/// What is in front of a landmark, or behind it, has another disparity.
bool IsShown(const Eigen::Vector3d& uvd, const FeatureGrid& grid, const StereoRig& rig,
             const MatchingOptions& options) {
  bool is_shown = false;
  grid.VisitNear(uvd.x(), uvd.y(), options.true_match_px, [&](uint32_t feature_idx) {
    const Feature& feature = grid.features()[feature_idx];
    if (!feature.has_disparity()) return;
    const double disparity_px = rig.WithoutBias(feature.x_px, feature.disparity_px);
    is_shown = is_shown || std::abs(disparity_px - uvd.z()) <= options.same_disparity_px;
  });
  return is_shown;
}

Rigid3 Disturb(const Rigid3& camera_from_map, const MatchingOptions& options, uint64_t seed) {
  std::mt19937_64 generator(seed);
  std::normal_distribution<double> normal;
  Eigen::Matrix<double, 6, 1> delta;
  for (int i = 0; i < 6; ++i) {
    delta[i] = normal(generator) * (i < 3 ? options.prediction_m : options.prediction_rad);
  }
  return Perturb(camera_from_map, delta);
}

}  // namespace

MatchingMeter::MatchingMeter(const ReconstructedMap& map, const StereoRig& rig,
                             const Vocabulary& vocabulary, const MatchingOptions& options)
    : map_(map), rig_(rig), options_(options), by_appearance_(map.snapshot, vocabulary) {}

MatchingCounts MatchingMeter::Measure(const std::vector<Feature>& features,
                                      const Rigid3& true_camera_from_map, uint64_t seed) const {
  const auto& landmarks = map_.snapshot.landmarks;
  const FeatureGrid grid(features, rig_.camera.width, rig_.camera.height);
  const auto place_of = [&](uint32_t landmark_idx) -> Eigen::Vector3d {
    return rig_.Project(true_camera_from_map * landmarks[landmark_idx].position_in_map);
  };

  std::vector<bool> is_in_sight(landmarks.size(), false);
  for (const uint32_t idx : map_.landmark_positions().WithinRadius(
           true_camera_from_map.Inverse().translation, kFarthestM)) {
    is_in_sight[idx] = IsInSight(landmarks[idx], rig_, true_camera_from_map) &&
                       IsShown(place_of(idx), grid, rig_, options_);
  }
  const auto count_true = [&](const std::vector<LandmarkMatch>& matches) {
    return static_cast<size_t>(
        std::count_if(matches.begin(), matches.end(), [&](const LandmarkMatch& match) {
          return is_in_sight[match.landmark_idx] &&
                 IsAt(features[match.feature_idx], place_of(match.landmark_idx),
                      options_.true_match_px);
        }));
  };

  MatchingCounts counts;
  counts.in_sight = static_cast<size_t>(std::count(is_in_sight.begin(), is_in_sight.end(), true));
  const Rigid3 predicted = Disturb(true_camera_from_map, options_, seed);
  const auto tracked = TrackByProjection(map_.snapshot, LandmarksAround(map_, predicted.Inverse()),
                                         grid, rig_, predicted, {});
  if (tracked) {
    const Rigid3& camera_from_map = tracked->camera_from_map;
    counts.by_position = count_true(
        MatchByProjection(map_.snapshot, LandmarksAround(map_, camera_from_map.Inverse()), grid,
                          rig_, camera_from_map, {}));
  }
  const auto similar = LandmarksSeenBy(map_, by_appearance_.Candidates(features));
  counts.by_appearance = count_true(MatchByAppearance(map_.snapshot, similar, features));
  return counts;
}

}  // namespace carmap
