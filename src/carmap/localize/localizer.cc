#include "carmap/localize/localizer.h"

#include <algorithm>
#include <utility>

#include "carmap/base/stopwatch.h"
#include "carmap/localize/motion_model.h"

namespace carmap {

std::optional<Rigid3> Localizer::Predict(Timestamp timestamp) const {
  if (!last_) return std::nullopt;
  const double elapsed_s = timestamp.seconds() - last_->timestamp.seconds();
  if (elapsed_s < 0 || elapsed_s > options_.max_prediction_s) return std::nullopt;
  if (last_->interval_s <= 0) return last_->camera_from_map;
  return Extrapolate(last_->this_from_previous, elapsed_s / last_->interval_s) *
         last_->camera_from_map;
}

/// Any other pose may sit where only distant landmarks agree.
bool Localizer::IsSure(Timestamp timestamp, const std::optional<TrackedPose>& pose) const {
  if (!pose || !last_ || last_->interval_s <= 0) return false;
  const size_t inliers = pose->inliers.size();
  if (inliers < last_->inlier_count / 2) return false;
  if (inliers >= options_.relocalization.sure_inliers) return true;
  return winner_ && inliers >= winner_->inlier_count / 2 &&
         timestamp.seconds() - winner_->timestamp.seconds() <= options_.trust_s;
}

std::optional<TrackedPose> Localizer::TrackFrom(const Rigid3& predicted_camera_from_map,
                                                const FeatureGrid& grid,
                                                double radius_factor) const {
  TrackingOptions tracking = options_.relocalization.tracking;
  tracking.first_radius_px *= radius_factor;
  return TrackAround(map_, grid, rig_, predicted_camera_from_map, tracking,
                     options_.relocalization.neighbourhood);
}

LocalizedFrame Localizer::Localize(Timestamp timestamp, const std::vector<Feature>& features,
                                   const std::optional<GpsFix>& gps) {
  LocalizedFrame frame;
  const FeatureGrid grid(features, rig_.camera.width, rig_.camera.height);
  std::optional<TrackedPose> pose;
  const auto keep_better = [&](std::optional<TrackedPose> other, FoundBy found_by) {
    if (!other || (pose && pose->inliers.size() >= other->inliers.size())) return;
    pose = std::move(other);
    frame.found_by = found_by;
  };

  const Stopwatch tracking_watch;
  if (const auto predicted = Predict(timestamp)) {
    keep_better(TrackFrom(*predicted, grid, 1), FoundBy::kTracking);
    if (!IsSure(timestamp, pose)) {
      keep_better(TrackFrom(*predicted, grid, options_.wide_factor), FoundBy::kWideTracking);
    }
  }
  frame.tracking_ms = tracking_watch.ElapsedMs();
  if (!IsSure(timestamp, pose)) {
    const Stopwatch relocalization_watch;
    keep_better(Relocalize(map_, grid, rig_, gps, options_.relocalization),
                FoundBy::kRelocalization);
    frame.relocalization_ms = relocalization_watch.ElapsedMs();
    winner_ = pose ? std::optional(Winner{timestamp, pose->inliers.size()}) : std::nullopt;
  }
  if (!pose) return frame;

  frame.map_from_camera = pose->camera_from_map.Inverse();
  Remember(timestamp, *pose);
  frame.inliers = std::move(pose->inliers);
  return frame;
}

void Localizer::Remember(Timestamp timestamp, const TrackedPose& pose) {
  LastPose last{timestamp, pose.camera_from_map, pose.inliers.size(), {}, 0};
  if (last_) {
    const double interval_s = timestamp.seconds() - last_->timestamp.seconds();
    if (interval_s > 0 && interval_s <= options_.max_prediction_s) {
      last.this_from_previous = pose.camera_from_map * last_->camera_from_map.Inverse();
      last.interval_s = interval_s;
    }
  }
  last_ = last;
}

}  // namespace carmap
