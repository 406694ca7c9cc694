// A drive's way through a map, or through a base map, frame by frame: what `carmap localize` and
// `carmap drive` have in common.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carmap/dataset/gps_use.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/eval/frame_picture.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/view_follower.h"
#include "carmap/map/lean_map.h"
#include "carmap/semantics/segmenter.h"
#include "carmap/slam/drive_mapper.h"
#include "carmap/slam/frame_extraction.h"
#include "carmap/vehicle/base_tracker.h"

namespace carmap {

/// What the vehicle localizes in: one map, or a base of which it reads the tiles around it.
struct LoadedMap {
  LeanMap lean;   ///< of a base, once the drive is over: the tiles that were read
  StereoRig rig;  ///< of the vehicle that localizes
  std::shared_ptr<const ReconstructedMap> map;  ///< null of a base
  std::unique_ptr<const BaseMap> base;
  size_t bytes = 0;
  double read_ms = 0, decode_ms = 0, rebuild_ms = 0;
};

/// Of a file or a folder of a base. Errors: those of reading it; FailedPrecondition if it is empty.
absl::StatusOr<LoadedMap> LoadMap(const std::string& path, const StereoRig& rig);

/// The program's own, for as long as it runs.
std::shared_ptr<const Vocabulary> ProgramVocabulary();

/// What became of one frame.
struct FrameResult {
  uint32_t index = 0;
  VehiclePose pose;
  double frame_ms = 0;
};

struct LocalizedDrive {
  Trajectory trajectory;  ///< in the map's frame, one entry a frame
  std::vector<FrameResult> frames;
  std::vector<LostFrame> unusable_frames;  ///< whose images are at fault; dead reckoned or lost
  std::vector<LostFrame> lost_frames;      ///< without a pose
  std::vector<double> frame_ms;
  size_t by_map = 0, by_dead_reckoning = 0;
  double longest_dead_reckoning_m = 0;
  FramePicture best_frame;                    ///< the one with most landmarks
  std::optional<LabellingSummary> labelling;  ///< of the vehicle's own keyframes
  DriveHealth health;
  RowMisalignment undone;     ///< of the right images
  std::optional<GpsUse> gps;  ///< by where the map lies on the Earth
  std::string failure;        ///< why it ends before the drive: an exception, in one line
  /// Of a base: those read, how often the view of them changed, those that cannot be read.
  size_t tiles_read = 0, views = 0;
  std::vector<std::string> damaged_tiles;

  size_t localized() const { return by_map + by_dead_reckoning; }
};

class DriveLocalizer {
 public:
  /// All must outlive the localizer. `drive_id` names the keyframes of its own map.
  DriveLocalizer(const LoadedMap& loaded, const StereoRig& camera_rig,
                 const StereoFrontEnd& front_end, std::shared_ptr<Segmenter> segmenter,
                 DriveId drive_id = {});

  /// Of a base: what became of it meanwhile.
  void TakePatch(Patch patch) { follower_->Take(std::move(patch)); }

  /// Throws what a stage threw, and what the store denies.
  void Take(const ExtractedFrame& frame);

  LocalizedDrive& drive() { return drive_; }
  const std::optional<ViewFollower>& follower() const { return follower_; }
  /// The map that the frames are looked for in now.
  const std::shared_ptr<const ReconstructedMap>& map() const { return tracker_->base(); }
  /// From the frame of the follower's view to that of the poses.
  const Rigid3& first_from_view() const { return first_from_view_; }
  const DriveMapper& own_map() const { return own_map_; }
  /// What the newest frame's own tracking made of it.
  const TrackedFrame& own_frame() const { return own_frame_; }
  /// The newest frame's pose in the view.
  const VehiclePose& newest() const { return newest_; }
  /// By its own motion alone: where the map corrects it, it does not jump.
  DriveHealth Health() const { return own_map_.Health(odometry_); }
  std::optional<LabellingSummary> labelling() const { return own_map_.labelling(); }

 private:
  void Follow(const ExtractedFrame& frame);
  void TakeOdometry(Timestamp timestamp);
  void RememberIfBest(const ExtractedFrame& frame, const std::vector<LandmarkMatch>& inliers);
  void Count(const ExtractedFrame& frame, const VehiclePose& pose);

  const StereoFrontEnd& front_end_;
  DriveMapper own_map_;
  const StereoRig rig_;
  std::optional<ViewFollower> follower_;  ///< in a base
  std::optional<BaseTracker> tracker_;    ///< never empty
  Rigid3 first_from_view_;                ///< from the view's frame to that of the first view
  TrackedFrame own_frame_;
  Trajectory odometry_;     ///< its own steps, one after the other, one entry a frame
  Rigid3 odometry_newest_;  ///< of the last frame that was tracked
  VehiclePose newest_;
  size_t most_inliers_ = 0;
  LocalizedDrive drive_;
};

}  // namespace carmap
