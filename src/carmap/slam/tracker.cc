#include "carmap/slam/tracker.h"

#include <fmt/format.h>

#include <algorithm>

#include "carmap/localize/motion_model.h"

namespace carmap {
namespace {

const SnapshotKeyframe* Find(const MapSnapshot& map, KeyframeId id) {
  for (const SnapshotKeyframe& keyframe : map.keyframes) {
    if (keyframe.id == id) return &keyframe;
  }
  return nullptr;
}

int CountWithDepth(const std::vector<Feature>& features) {
  return static_cast<int>(std::count_if(features.begin(), features.end(),
                                        [](const Feature& f) { return f.has_disparity(); }));
}

/// As near to where it would be if it had gone on as before as brakes and engine allow, with room
/// for what the speed was off.
bool IsNear(const TrackedPose& pose, const Rigid3& predicted_camera_from_map, double elapsed_s) {
  constexpr double kMaxAccelerationMps2 = 20, kMaxSpeedErrorMps = 4;
  const double max_distance_m =
      kMaxSpeedErrorMps * elapsed_s + kMaxAccelerationMps2 * elapsed_s * elapsed_s / 2;
  return (pose.camera_from_map.Inverse().translation -
          predicted_camera_from_map.Inverse().translation)
             .norm() < max_distance_m;
}

TrackingOptions WithWiderWindow(TrackingOptions options) {
  options.first_radius_px *= 4;
  return options;
}

TrackingOptions WithNoise(TrackingOptions options, double factor) {
  options.noise.pixel_px *= factor;
  options.noise.disparity_px *= factor;
  return options;
}

}  // namespace

Rigid3 Tracker::Predict(Timestamp timestamp, const LocalMap& local) const {
  const MapSnapshot& map = local.snapshot;
  const SnapshotKeyframe* reference = last_ ? Find(map, last_->reference) : nullptr;
  if (!reference) return Find(map, local.reference)->map_from_camera.Inverse();
  const Rigid3 last_from_map = last_->camera_from_reference * reference->map_from_camera.Inverse();
  if (last_->interval_s <= 0) return last_from_map;
  const double elapsed_s = timestamp.seconds() - last_->timestamp.seconds();
  return Extrapolate(last_->this_from_previous, elapsed_s / last_->interval_s) * last_from_map;
}

std::optional<TrackedPose> Tracker::FindPose(Timestamp timestamp, const FeatureGrid& grid,
                                             const LocalMap& local) const {
  const std::vector<uint32_t> landmark_idxs = AllLandmarks(local.snapshot);
  const Rigid3 predicted = Predict(timestamp, local);
  const auto by_appearance = [&] {
    return TrackByAppearance(local.snapshot, landmark_idxs, grid, local.rig, options_.tracking,
                             /*seed=*/1);
  };
  const auto by_projection = [&](const TrackingOptions& tracking) {
    return TrackByProjection(local.snapshot, landmark_idxs, grid, local.rig, predicted, tracking);
  };
  if (!last_ || last_->interval_s <= 0) {
    // Nothing tells the speed: as seen from where the vehicle was, only distant landmarks are where
    // they should be, and they agree on a wrong pose.
    const auto pose = by_appearance();
    return pose ? pose : by_projection(options_.tracking);
  }
  // Traffic at the vehicle's own speed agrees with itself; what the vehicle can do comes first.
  const double elapsed_s = timestamp.seconds() - last_->timestamp.seconds();
  const auto is_possible = [&](const std::optional<TrackedPose>& pose) {
    return pose && IsNear(*pose, predicted, elapsed_s);
  };
  const auto pose = by_projection(options_.tracking);
  if (is_possible(pose)) return pose;
  const auto farther_off = by_projection(WithWiderWindow(options_.tracking));
  if (is_possible(farther_off)) return farther_off;
  if (last_->SpeedMps() > options_.min_noisy_speed_mps) {
    const auto noisy = by_projection(WithNoise(options_.tracking, options_.noisy_factor));
    if (is_possible(noisy)) return noisy;
  }
  return pose ? pose : farther_off ? farther_off : by_appearance();
}

/// Distance to a keyframe in steps of which each calls for a new one.
double Tracker::StepsFrom(const Rigid3& reference_from_camera) const {
  return std::max(reference_from_camera.translation.norm() / options_.max_keyframe_distance_m,
                  RotationAngle(reference_from_camera.rotation) / options_.max_keyframe_turn_rad);
}

bool Tracker::WantsKeyframe(const TrackedFrame& frame) const {
  const Rigid3 reference_from_camera = frame.camera_from_reference.Inverse();
  if (StepsFrom(reference_from_camera) > 1) return true;
  if (reference_from_camera.translation.norm() < options_.min_keyframe_distance_m &&
      RotationAngle(reference_from_camera.rotation) < options_.min_keyframe_turn_rad) {
    return false;
  }
  const size_t tracked = frame.landmark_of_feature.size();
  return tracked < options_.min_tracked_ratio * static_cast<double>(tracked_at_best_) ||
         tracked < static_cast<size_t>(options_.min_tracked);
}

TrackedFrame Tracker::Begin(const std::vector<Feature>& features) {
  TrackedFrame frame;
  const int with_depth = CountWithDepth(features);
  frame.wants_keyframe = with_depth >= options_.min_first_features;
  if (!frame.wants_keyframe) {
    frame.lost_because = fmt::format("only {} features with depth, {} are needed to begin a map",
                                     with_depth, options_.min_first_features);
  }
  return frame;
}

TrackedFrame Tracker::Track(Timestamp timestamp, const std::vector<Feature>& features,
                            const LocalMap* local) {
  if (!local) return Begin(features);
  const FeatureGrid grid(features, local->rig.camera.width, local->rig.camera.height);
  const auto pose = FindPose(timestamp, grid, *local);
  return pose ? Accept(timestamp, *local, *pose)
              : Lose(timestamp, features, Predict(timestamp, *local));
}

TrackedFrame Tracker::Resume(Timestamp timestamp, const LocatedFrame& found) {
  last_.reset();
  return Accept(timestamp, *found.local, found.pose);
}

TrackedFrame Tracker::Accept(Timestamp timestamp, const LocalMap& local, const TrackedPose& pose) {
  const MapSnapshot& map = local.snapshot;
  TrackedFrame frame;
  frame.map_from_camera = pose.camera_from_map.Inverse();
  const auto steps_from = [&](const SnapshotKeyframe& keyframe) {
    return StepsFrom(keyframe.map_from_camera.Inverse() * frame.map_from_camera);
  };
  const SnapshotKeyframe& nearest = *std::min_element(
      map.keyframes.begin(), map.keyframes.end(),
      [&](const auto& a, const auto& b) { return steps_from(a) < steps_from(b); });
  frame.reference = nearest.id;
  frame.camera_from_reference = pose.camera_from_map * nearest.map_from_camera;
  for (const LandmarkMatch& match : pose.inliers) {
    frame.landmark_of_feature.emplace_back(map.landmarks[match.landmark_idx].id, match.feature_idx);
  }

  if (local_reference_ != local.reference) {
    local_reference_ = local.reference;
    tracked_at_best_ = frame.landmark_of_feature.size();
  }
  frame.wants_keyframe = WantsKeyframe(frame);

  LastPose last{timestamp, nearest.id, frame.camera_from_reference, {}, 0};
  const SnapshotKeyframe* reference = last_ ? Find(map, last_->reference) : nullptr;
  if (reference) {
    const Rigid3 previous_from_map =
        last_->camera_from_reference * reference->map_from_camera.Inverse();
    last.this_from_previous = pose.camera_from_map * previous_from_map.Inverse();
    last.interval_s = timestamp.seconds() - last_->timestamp.seconds();
    frame.camera_from_previous = last.this_from_previous;
    frame.since_previous_s = last.interval_s;
  }
  last_ = last;
  misplaced_frames_ = 0;
  return frame;
}

TrackedFrame Tracker::Lose(Timestamp timestamp, const std::vector<Feature>& features,
                           const Rigid3& predicted_camera_from_map) {
  TrackedFrame frame;
  frame.lost_because = features.size() < 50
                           ? fmt::format("only {} features in the image", features.size())
                           : "its features do not agree with the map so far";
  frame.map_from_camera = predicted_camera_from_map.Inverse();
  frame.is_misplaced = CountWithDepth(features) >= options_.min_first_features;
  if (!frame.is_misplaced || ++misplaced_frames_ < options_.max_misplaced_frames) return frame;
  misplaced_frames_ = 0;
  frame.begins_part = true;
  frame.gap.reference = local_reference_;
  if (last_) {
    frame.gap = {last_->reference, last_->camera_from_reference, last_->this_from_previous,
                 last_->interval_s, timestamp.seconds() - last_->timestamp.seconds()};
  }
  last_.reset();
  return frame;
}

}  // namespace carmap
