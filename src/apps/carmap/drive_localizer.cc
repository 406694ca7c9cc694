#include "apps/carmap/drive_localizer.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

constexpr size_t kMinFeatures = 50;  // fewer come of a black or blinded image

absl::Status CheckHasLandmarks(const LeanMap& map, const std::string& path) {
  if (!map.landmarks.empty()) return absl::OkStatus();
  return absl::FailedPreconditionError(
      fmt::format("{}: holds no landmark to localize by; map a longer drive", path));
}

/// Of the drive's own map only the motion from frame to frame is used, and what it adds.
MapDriveOptions OwnMapOptions(std::shared_ptr<Segmenter> segmenter) {
  MapDriveOptions options;
  options.segmenter = std::move(segmenter);
  options.loops.close_loops = false;
  return options;
}

}  // namespace

absl::StatusOr<LoadedMap> LoadMap(const std::string& path, const StereoRig& rig) {
  LoadedMap loaded;
  loaded.rig = StereoFrontEnd(rig).rig();
  const Stopwatch read_watch;
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    CARMAP_ASSIGN_OR_RETURN(loaded.base, BaseMap::Open(path, StoreAccess::kReadOnly));
    CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, loaded.base->Components());
    if (components.empty()) {
      return absl::FailedPreconditionError(
          fmt::format("{}: is empty; `carmap base add {} SEGMENT.cmap` fills it", path, path));
    }
    loaded.read_ms = read_watch.ElapsedMs();
    return loaded;
  }
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxLeanFileBytes));
  loaded.read_ms = read_watch.ElapsedMs();
  loaded.bytes = bytes.size();
  const Stopwatch decode_watch;
  CARMAP_ASSIGN_OR_RETURN(loaded.lean, DecodeLeanMap(bytes, path));
  loaded.decode_ms = decode_watch.ElapsedMs();
  CARMAP_RETURN_IF_ERROR(CheckHasLandmarks(loaded.lean, path));
  const Stopwatch rebuild_watch;
  loaded.map =
      std::make_shared<const ReconstructedMap>(Reconstruct(loaded.lean, loaded.rig.camera.fx));
  loaded.rebuild_ms = rebuild_watch.ElapsedMs();
  return loaded;
}

std::shared_ptr<const Vocabulary> ProgramVocabulary() {
  return {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()};
}

DriveLocalizer::DriveLocalizer(const LoadedMap& loaded, const StereoRig& camera_rig,
                               const StereoFrontEnd& front_end,
                               std::shared_ptr<Segmenter> segmenter, DriveId drive_id)
    : front_end_(front_end),
      own_map_(camera_rig, loaded.rig, drive_id, OwnMapOptions(std::move(segmenter))),
      rig_(loaded.rig) {
  if (loaded.base) follower_.emplace(*loaded.base, rig_.camera.fx, ProgramVocabulary());
  tracker_.emplace(follower_ ? follower_->map() : loaded.map, rig_, ProgramVocabulary());
}

void DriveLocalizer::Take(const ExtractedFrame& frame) {
  own_frame_ = own_map_.Take(frame);
  TakeOdometry(frame.timestamp);
  const Stopwatch watch;
  if (follower_) Follow(frame);
  newest_ = tracker_->Take(frame, own_frame_);
  FrameResult result{frame.index, newest_, 0};
  TimedPose& pose = drive_.trajectory.emplace_back();
  pose.timestamp = frame.timestamp;
  if (follower_ && result.pose.pose) {
    Rigid3& camera_from_base = result.pose.pose->camera_from_base;
    camera_from_base = camera_from_base * first_from_view_.Inverse();
  }
  if (result.pose.pose) pose.world_from_camera = result.pose.pose->camera_from_base.Inverse();
  if (frame.features) {
    result.frame_ms = own_map_.last_frame_ms() + watch.ElapsedMs();
    drive_.frame_ms.push_back(result.frame_ms);
    RememberIfBest(frame, result.pose.inliers);
  }
  Count(frame, result.pose);
  drive_.frames.push_back(std::move(result));
}

void DriveLocalizer::TakeOdometry(Timestamp timestamp) {
  odometry_.push_back({.timestamp = timestamp});
  if (own_frame_.camera_from_previous) {
    odometry_newest_ = odometry_newest_ * own_frame_.camera_from_previous->Inverse();
  }
  if (own_frame_.reference) odometry_.back().world_from_camera = odometry_newest_;
}

/// Reads the tiles around the vehicle before it needs them. What the store denies ends the run.
void DriveLocalizer::Follow(const ExtractedFrame& frame) {
  static const std::vector<Feature> kNothing;
  const bool had_tiles = !follower_->view().tiles().empty();
  const Rigid3 root_from_view = follower_->view().root_from_view();
  const bool was_on_earth = follower_->view().grid().is_on_earth;
  std::optional<Rigid3> last_pose;
  if (newest_.pose) last_pose = newest_.pose->camera_from_base.Inverse();
  const auto change =
      follower_->Follow(last_pose, frame.gps, frame.features ? *frame.features : kNothing);
  if (!change.ok()) throw std::runtime_error(std::string(change.status().message()));
  if (*change == ViewFollower::Change::kNone) return;
  ++drive_.views;
  if (*change == ViewFollower::Change::kTiles) {
    tracker_->Swap(follower_->map());
    return;
  }
  tracker_.emplace(follower_->map(), rig_, ProgramVocabulary());
  // Poses of the drive stay in its first frame. Only the Earth connects two components.
  if (had_tiles && was_on_earth && follower_->view().grid().is_on_earth) {
    first_from_view_ =
        first_from_view_ * root_from_view.Inverse() * follower_->view().root_from_view();
  } else if (drive_.localized() == 0) {
    first_from_view_ = Rigid3();
  } else {
    throw std::runtime_error(
        "it leads into a part of the base that lies nowhere in relation to the part before; "
        "localize the rest by itself, with --first");
  }
}

void DriveLocalizer::RememberIfBest(const ExtractedFrame& frame,
                                    const std::vector<LandmarkMatch>& inliers) {
  if (inliers.size() <= most_inliers_) return;
  most_inliers_ = inliers.size();
  drive_.best_frame = {fmt::format("Frame {} in the map", frame.index),
                       front_end_.AtFeatureSize(frame.left), *frame.features,
                       std::vector<bool>(frame.features->size())};
  for (const LandmarkMatch& match : inliers) drive_.best_frame.in_map[match.feature_idx] = true;
}

void DriveLocalizer::Count(const ExtractedFrame& frame, const VehiclePose& pose) {
  drive_.by_map += pose.known_by == KnownBy::kMap;
  drive_.by_dead_reckoning += pose.known_by == KnownBy::kDeadReckoning;
  drive_.longest_dead_reckoning_m = std::max(drive_.longest_dead_reckoning_m, pose.dead_reckoned_m);
  std::string unusable = frame.unusable_because;
  if (frame.features && frame.features->size() < kMinFeatures) {
    unusable = fmt::format("only {} features in the image", frame.features->size());
  }
  if (!unusable.empty()) drive_.unusable_frames.push_back({frame.index, unusable});
  if (pose.known_by != KnownBy::kLost) return;
  drive_.lost_frames.push_back(
      {frame.index, unusable.empty() ? "it was not found in the map" : unusable});
}

}  // namespace carmap
