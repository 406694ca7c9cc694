// A drive's own map while it is driven: tracker, local mapper and loop closer wired together (paper
// §2), frame by frame, without knowing the end.
//
// By default mapping has a thread of its own. The tracker waits for it, so that it always sees the
// map that a vehicle at 10 frames a second would see, and threads never change the result: the same
// drive gives the same map to the last bit, also sequentially, where all runs on the caller's
// thread. One thread calls.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/dataset/gps_use.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/semantics/keyframe_labeller.h"
#include "carmap/slam/drive_health.h"
#include "carmap/slam/fix_judgement.h"
#include "carmap/slam/frame_extraction.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/slam/local_mapper.h"
#include "carmap/slam/loop_closer.h"
#include "carmap/slam/tracker.h"

namespace carmap {

class Vocabulary;

struct MapDriveOptions {
  FrontEndOptions front_end;
  TrackerOptions tracker;
  LocalMapperOptions mapper;
  LoopCloserOptions loops;  ///< its `sequential` follows from the one below
  /// By which places are recognized; without one they are looked for where the map has them.
  std::shared_ptr<const Vocabulary> vocabulary;
  bool sequential = false;
  /// The dynamic object filter (§3.3): what labels the keyframes; null for none.
  std::shared_ptr<Segmenter> segmenter;
  LabellingOptions labelling;  ///< its `sequential` follows from the one above
};

/// What came of labelling keyframes.
struct LabellingSummary {
  size_t keyframes = 0, labelled = 0;
  std::string failure;  ///< the first, in one line; empty without any
};

struct LostFrame {
  uint32_t index = 0;  ///< frame number in the drive
  std::string reason;
};

/// A stretch of the drive that nothing but the vehicle's speed connects to the rest of the map: it
/// was blind before, and what it saw after was not found in the map.
struct MapPart {
  uint32_t first_index = 0;  ///< frame number of its first keyframe
  size_t keyframes = 0;
};

struct MappedDrive {
  Map map;
  StereoRig rig;  ///< in whose pixels features are, with the disparity bias found on the way
  Trajectory trajectory;  ///< in the map's frame, one entry a frame, after all adjustments
  std::vector<LostFrame> lost_frames;
  DriveHealth health;
  std::vector<MapPart> parts;                 ///< one if the whole map holds together
  std::vector<Loop> loops;                    ///< that were closed
  size_t rejected_loop_keyframes = 0;         ///< see LoopDetector::rejected_count
  std::optional<Georeference> georeference;   ///< where GPS fixes tell it
  std::optional<GpsUse> gps;                  ///< where there is a record of a receiver
  std::optional<LabellingSummary> labelling;  ///< where keyframes were to be labelled
  /// Why the map ends before the drive or was not adjusted as a whole: an exception, in one line.
  std::string failure;
  std::vector<double> frame_ms;            ///< from images in memory to the frame's pose
  std::map<std::string, double> stage_ms;  ///< total of each stage
  /// Changes of the map that were left out since they no longer fitted it, by stage.
  std::map<std::string, size_t> left_out;

  size_t tracked_frames() const { return trajectory.size() - lost_frames.size(); }
};

class DriveMapper {
 public:
  /// `camera_rig` is that of the drive's own images, `rig` the one in whose pixels features are.
  DriveMapper(const StereoRig& camera_rig, const StereoRig& rig, DriveId drive_id,
              const MapDriveOptions& options);
  ~DriveMapper();
  DriveMapper(const DriveMapper&) = delete;
  DriveMapper& operator=(const DriveMapper&) = delete;

  /// The next frame in the map so far, which grows by it where it shows something new. The result
  /// lives until the next call. Throws what a stage threw; then all that is left to do is Finish.
  const TrackedFrame& Take(const ExtractedFrame& frame);

  /// From images in memory to the last frame's pose, without waiting for the mapper; 0 if it could
  /// not be used.
  double last_frame_ms() const { return last_frame_ms_; }

  /// Keyframes that were made so far.
  size_t keyframe_count() const;

  /// The map so far, and the rig as far as it is known, when all keyframes are in. They change with
  /// the next frame.
  const Map& map() const;
  const StereoRig& rig() const;

  /// The verdict on the drive so far, judged by this trajectory of the frames taken.
  DriveHealth Health(const Trajectory& trajectory) const;

  /// What came of labelling so far; nothing without a segmenter.
  std::optional<LabellingSummary> labelling() const;

  /// Makes the map consistent as a whole. To be called last, once.
  /// Errors: FailedPrecondition when no frame could be tracked; what a stage threw if nothing can
  /// be saved of the map.
  absl::StatusOr<MappedDrive> Finish();

 private:
  class MappingStage;

  TrackedFrame TrackOrRecover(const ExtractedFrame& frame);
  void FollowUp(const ExtractedFrame& frame, TrackedFrame& tracked);
  std::optional<GpsFix> FreshFix(const ExtractedFrame& frame, const TrackedFrame& tracked);
  void CountTimes(const ExtractedFrame& frame, double track_ms);
  void TakeHealth(const ExtractedFrame& frame, const TrackedFrame& tracked);
  void FinishFrames();
  absl::Status NoFrameTracked() const;

  /// What is kept of a frame until its pose in the finished map is known.
  struct TakenFrame {
    uint32_t index = 0;
    std::optional<KeyframeId> reference;
    Rigid3 camera_from_reference;
    std::string lost_because;
    bool repeats_image = false;
  };

  const DriveId drive_id_;
  const double max_bias_px_;
  DriveHealthMonitor health_;
  const DisparityBias calibrated_bias_;  ///< of the rig that was given
  Tracker tracker_;
  std::optional<KeyframeLabeller> labeller_;
  std::unique_ptr<MappingStage> mapping_;
  FreezeDetector freeze_detector_;
  TrackedFrame tracked_;
  double last_frame_ms_ = 0;
  std::vector<TakenFrame> frames_;
  MappedDrive result_;
};

}  // namespace carmap
