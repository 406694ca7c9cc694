#include "carmap/slam/tracker.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "carmap/localize/motion_model.h"

namespace carmap {
namespace {

std::vector<uint32_t> AllLandmarks(const MapSnapshot& map) {
  std::vector<uint32_t> idxs(map.landmarks.size());
  std::iota(idxs.begin(), idxs.end(), 0u);
  return idxs;
}

const SnapshotKeyframe* Find(const MapSnapshot& map, KeyframeId id) {
  for (const SnapshotKeyframe& keyframe : map.keyframes) {
    if (keyframe.id == id) return &keyframe;
  }
  return nullptr;
}

}  // namespace

Rigid3 Tracker::Predict(Timestamp timestamp, const MapSnapshot& map) const {
  const SnapshotKeyframe* reference = last_ ? Find(map, last_->reference) : nullptr;
  if (!reference) return map.keyframes.back().map_from_camera.Inverse();
  const Rigid3 last_from_map = last_->camera_from_reference * reference->map_from_camera.Inverse();
  if (last_->interval_s <= 0) return last_from_map;
  const double elapsed_s = timestamp.seconds() - last_->timestamp.seconds();
  return Extrapolate(last_->this_from_previous, elapsed_s / last_->interval_s) * last_from_map;
}

std::optional<TrackedPose> Tracker::FindPose(const FeatureGrid& grid, const LocalMap& local,
                                             const Rigid3& predicted_camera_from_map) const {
  const auto& [map, rig] = local;
  const std::vector<uint32_t> landmark_idxs = AllLandmarks(map);
  TrackingOptions tracking = options_.tracking;
  if (!last_ || last_->interval_s <= 0) {
    // Nothing tells the speed: as seen from where the vehicle was, only distant landmarks are where
    // they should be, and they agree on a wrong pose.
    if (auto pose = TrackByAppearance(map, landmark_idxs, grid, rig, tracking, /*seed=*/1))
      return pose;
  }
  auto pose = TrackByProjection(map, landmark_idxs, grid, rig, predicted_camera_from_map, tracking);
  if (pose) return pose;
  tracking.first_radius_px *= 4;
  pose = TrackByProjection(map, landmark_idxs, grid, rig, predicted_camera_from_map, tracking);
  if (pose) return pose;
  return TrackByAppearance(map, landmark_idxs, grid, rig, options_.tracking, /*seed=*/1);
}

bool Tracker::WantsKeyframe(const TrackedFrame& frame, const MapSnapshot& map) const {
  const Rigid3 newest_from_camera =
      map.keyframes.back().map_from_camera.Inverse() * frame.map_from_camera;
  const size_t tracked = frame.landmark_of_feature.size();
  return newest_from_camera.translation.norm() > options_.max_keyframe_distance_m ||
         RotationAngle(newest_from_camera.rotation) > options_.max_keyframe_turn_rad ||
         tracked < options_.min_tracked_ratio * static_cast<double>(tracked_after_keyframe_) ||
         tracked < static_cast<size_t>(options_.min_tracked);
}

TrackedFrame Tracker::Track(Timestamp timestamp, const std::vector<Feature>& features,
                            const LocalMap* local) {
  TrackedFrame frame;
  if (!local) {
    const auto with_depth =
        std::count_if(features.begin(), features.end(),
                      [](const Feature& feature) { return feature.has_disparity(); });
    frame.wants_keyframe = with_depth >= options_.min_first_features;
    if (!frame.wants_keyframe) {
      frame.lost_because = fmt::format("only {} features with depth, {} are needed to begin a map",
                                       with_depth, options_.min_first_features);
    }
    return frame;
  }

  const MapSnapshot& map = local->snapshot;
  const FeatureGrid grid(features, local->rig.camera.width, local->rig.camera.height);
  const auto pose = FindPose(grid, *local, Predict(timestamp, map));
  if (!pose) {
    frame.lost_because = features.size() < 50
                             ? fmt::format("only {} features in the image", features.size())
                             : "its features do not agree with the map so far";
    return frame;
  }
  const SnapshotKeyframe& newest = map.keyframes.back();
  frame.map_from_camera = pose->camera_from_map.Inverse();
  frame.reference = newest.id;
  frame.camera_from_reference = pose->camera_from_map * newest.map_from_camera;
  for (const LandmarkMatch& match : pose->inliers) {
    frame.landmark_of_feature.emplace_back(map.landmarks[match.landmark_idx].id, match.feature_idx);
  }

  if (newest_keyframe_ != newest.id) {
    newest_keyframe_ = newest.id;
    tracked_after_keyframe_ = frame.landmark_of_feature.size();
  }
  frame.wants_keyframe = WantsKeyframe(frame, map);

  LastPose last{timestamp, newest.id, frame.camera_from_reference, {}, 0};
  const SnapshotKeyframe* reference = last_ ? Find(map, last_->reference) : nullptr;
  if (reference) {
    const Rigid3 previous_from_map =
        last_->camera_from_reference * reference->map_from_camera.Inverse();
    last.this_from_previous = pose->camera_from_map * previous_from_map.Inverse();
    last.interval_s = timestamp.seconds() - last_->timestamp.seconds();
  }
  last_ = last;
  return frame;
}

}  // namespace carmap
