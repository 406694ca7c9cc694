#include "carmap/vehicle/sighting_counter.h"

#include <algorithm>
#include <cmath>

#include "carmap/localize/frame_tracking.h"

namespace carmap {
namespace {

/// Farther than that no vehicle moves between two frames: the frame of poses became another.
constexpr double kJumpM = 20;

}  // namespace

bool SightingCounter::IsDue(const VehiclePose& pose) const {
  if (pose.known_by != KnownBy::kMap || pose.inliers.size() < options_.min_inliers ||
      SigmaM(pose.pose->covariance) > options_.max_sigma_m) {
    return false;
  }
  const Rigid3 base_from_camera = pose.pose->camera_from_base.Inverse();
  return !last_due_ ||
         (base_from_camera.translation - last_due_->translation).norm() >= options_.spacing_m;
}

void SightingCounter::Take(const ReconstructedMap& base, const StereoRig& rig,
                           const VehiclePose& pose, const DenseDisparity* disparities) {
  if (!pose.pose) {
    last_.reset();
    return;
  }
  const Rigid3& camera_from_base = pose.pose->camera_from_base;
  const Rigid3 base_from_camera = camera_from_base.Inverse();
  if (last_) {
    const double step_m = (base_from_camera.translation - last_->translation).norm();
    if (step_m < kJumpM) driven_m_ += step_m;
  }
  last_ = base_from_camera;
  for (const LandmarkMatch& match : pose.inliers) {
    Count& count = counts_[base.snapshot.landmarks[match.landmark_idx].id];
    ++count.seen_frames;
    count.last_at_m = driven_m_;
  }
  if (disparities == nullptr) return;
  last_due_ = base_from_camera;
  for (const uint32_t idx : LandmarksAround(base, base_from_camera, options_.neighbourhood)) {
    Expect(base.snapshot.landmarks[idx], rig, camera_from_base, *disparities);
  }
}

/// From about where it was recognised before.
bool SightingCounter::IsInSight(const SnapshotLandmark& landmark, const StereoRig& rig,
                                const Rigid3& camera_from_base,
                                const Eigen::Vector3d& p_in_camera) const {
  const double fx = rig.camera.fx;
  if (p_in_camera.z() < 0.1 || rig.DisparityAt(p_in_camera.z()) < options_.min_disparity_rad * fx) {
    return false;
  }
  const Eigen::Vector3d uvd = rig.Project(p_in_camera);
  const double border_px = options_.border_ratio * rig.camera.width;
  if (uvd.x() < border_px || uvd.x() >= rig.camera.width - border_px || uvd.y() < border_px ||
      uvd.y() >= rig.camera.height - border_px) {
    return false;
  }
  const Eigen::Vector3d to_viewer =
      camera_from_base.Inverse().translation - landmark.position_in_map;
  const double distance_m = to_viewer.norm();
  return distance_m * options_.distance_slack >= landmark.min_distance_m &&
         distance_m <= options_.distance_slack * landmark.max_distance_m &&
         to_viewer.dot(landmark.direction_to_viewers.cast<double>()) >=
             std::cos(options_.max_viewing_angle_rad) * distance_m;
}

void SightingCounter::Expect(const SnapshotLandmark& landmark, const StereoRig& rig,
                             const Rigid3& camera_from_base, const DenseDisparity& disparities) {
  const Eigen::Vector3d p_in_camera = camera_from_base * landmark.position_in_map;
  if (!IsInSight(landmark, rig, camera_from_base, p_in_camera)) return;
  const Eigen::Vector3d uvd = rig.Project(p_in_camera);
  const double depth_m = p_in_camera.z();
  const double slack_m = std::max(options_.depth_m, options_.depth_ratio * depth_m);
  if (depth_m <= slack_m) return;
  const auto around = [&](double nearer_than_m) {
    return disparities.LookAt(uvd.x(), uvd.y(), options_.window_rad * rig.camera.fx,
                              rig.DisparityAt(nearer_than_m));
  };
  const DenseDisparity::Around before = around(depth_m - slack_m);
  if (before.known_share < options_.min_known_share ||
      before.nearer_share > options_.max_hidden_share) {
    return;
  }
  Count& count = counts_[landmark.id];
  ++count.expected_frames;
  count.through_frames += around(depth_m + slack_m).nearer_share <= options_.max_present_share;
  count.last_at_m = driven_m_;
}

bool SightingCounter::HasSeen(LandmarkId id) const {
  const auto count = counts_.find(id);
  return count != counts_.end() && count->second.seen_frames > 0;
}

std::map<LandmarkId, Sighting> SightingCounter::Release(double behind_m) {
  std::map<LandmarkId, Sighting> released;
  absl::erase_if(counts_, [&](const auto& entry) {
    const auto& [id, count] = entry;
    if (driven_m_ - count.last_at_m < behind_m) return false;
    if (count.seen_frames >= options_.min_seen_frames) {
      released[id] = Sighting::kSeen;
    } else if (count.seen_frames == 0 && count.expected_frames >= options_.min_expected_frames) {
      const bool is_through =
          count.through_frames >=
          options_.min_through_share * static_cast<double>(count.expected_frames);
      released[id] = is_through ? Sighting::kSeenThrough : Sighting::kMissed;
    }
    return true;
  });
  return released;
}

}  // namespace carmap
