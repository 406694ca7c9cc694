#include "carmap/slam/map_bundle.h"

#include <absl/container/flat_hash_map.h>

#include <algorithm>

namespace carmap {
namespace {

/// Nothing tells how far a landmark is that differs less between left and right.
constexpr double kMinDisparityPx = 0.1;

/// One entry a point: whether a camera sees it farther away than it can tell.
std::vector<bool> PointsTooFar(const Bundle& bundle) {
  const double max_depth_m = bundle.rig.DepthAt(kMinDisparityPx);
  std::vector<bool> is_too_far(bundle.points_in_map.size(), false);
  for (const BundleObservation& o : bundle.observations) {
    const Eigen::Vector3d p =
        bundle.camera_from_map[o.pose_idx] * bundle.points_in_map[o.point_idx];
    if (!(p.z() < max_depth_m)) is_too_far[o.point_idx] = true;
  }
  return is_too_far;
}

}  // namespace

std::vector<LandmarkId> SharedLandmarks(const Map& map, const std::vector<KeyframeId>& ids) {
  std::vector<LandmarkId> landmark_ids;
  for (const KeyframeId& id : ids) {
    for (const auto& link : map.LandmarksOf(id)) {
      if (!link) continue;
      const Landmark& landmark = *map.Find(*link);
      if (landmark.observations.size() > 1 && !landmark.is_non_static())
        landmark_ids.push_back(*link);
    }
  }
  std::sort(landmark_ids.begin(), landmark_ids.end());
  landmark_ids.erase(std::unique(landmark_ids.begin(), landmark_ids.end()), landmark_ids.end());
  return landmark_ids;
}

MapBundle MakeMapBundle(const Map& map, const StereoRig& rig, const MeasurementNoise& noise,
                        const std::vector<KeyframeId>& free_ids,
                        const std::vector<LandmarkId>& landmark_ids) {
  MapBundle result{.map_version = map.version(),
                   .bundle = {.rig = rig, .noise = noise},
                   .landmark_ids = landmark_ids};
  Bundle& bundle = result.bundle;
  const KeyframeId first_of_drive = map.keyframes().begin()->first;
  absl::flat_hash_map<KeyframeId, uint32_t> pose_idxs;
  const auto add_pose = [&](KeyframeId id, bool is_fixed) {
    const auto [place, is_new] =
        pose_idxs.emplace(id, static_cast<uint32_t>(result.keyframe_ids.size()));
    if (is_new) {
      result.keyframe_ids.push_back(id);
      bundle.camera_from_map.push_back(map.Find(id)->map_from_camera.Inverse());
      bundle.pose_is_fixed.push_back(is_fixed);
    }
    return place->second;
  };
  for (const KeyframeId& id : free_ids) add_pose(id, id == first_of_drive);
  for (uint32_t point_idx = 0; point_idx < landmark_ids.size(); ++point_idx) {
    const Landmark& landmark = *map.Find(landmark_ids[point_idx]);
    bundle.points_in_map.push_back(landmark.position_in_map);
    for (const Observation& observation : landmark.observations) {
      const Feature& feature =
          (*map.Find(observation.keyframe_id)->features)[observation.feature_idx];
      bundle.observations.push_back({.pose_idx = add_pose(observation.keyframe_id, true),
                                     .point_idx = point_idx,
                                     .px = {feature.x_px, feature.y_px},
                                     .disparity_px = feature.disparity_px,
                                     .scale = ScaleOfLevel(feature.level)});
      result.links.push_back({landmark.id, observation});
    }
  }
  if (std::none_of(bundle.pose_is_fixed.begin(), bundle.pose_is_fixed.end(),
                   [](bool is_fixed) { return is_fixed; })) {
    bundle.pose_is_fixed.front() = true;
  }
  return result;
}

MapEdit EditOf(const MapBundle& adjusted, const BundleSummary& summary) {
  const Bundle& bundle = adjusted.bundle;
  MapEdit edit{.base_version = adjusted.map_version};
  for (size_t i = 0; i < adjusted.links.size(); ++i) {
    if (summary.is_outlier[i]) edit.removed_observations.push_back(adjusted.links[i]);
  }
  for (size_t i = 0; i < adjusted.keyframe_ids.size(); ++i) {
    if (bundle.pose_is_fixed[i]) continue;
    edit.moved_keyframes.push_back({adjusted.keyframe_ids[i], bundle.camera_from_map[i].Inverse()});
  }
  const std::vector<bool> is_too_far = PointsTooFar(bundle);
  for (size_t i = 0; i < adjusted.landmark_ids.size(); ++i) {
    if (is_too_far[i]) {
      edit.removed_landmarks.push_back(adjusted.landmark_ids[i]);
      continue;
    }
    edit.moved_landmarks.push_back({adjusted.landmark_ids[i], bundle.points_in_map[i]});
  }
  return edit;
}

}  // namespace carmap
