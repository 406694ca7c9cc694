// From a drive to a map: reader, front end, tracker, local mapper and loop closer wired together
// (paper §2).
//
// By default each stage has a thread of its own: reading and feature extraction work ahead while
// the mapper takes a keyframe in. The tracker waits for the mapper, so that it always sees the map
// that a vehicle at 10 frames a second would see, and threads never change the result: the same
// drive gives the same map to the last bit, also sequentially, where all stages run on the caller's
// thread.
#pragma once

#include <absl/status/statusor.h>

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carmap/dataset/frame_source.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/map/map.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/slam/local_mapper.h"
#include "carmap/slam/loop_closer.h"
#include "carmap/slam/tracker.h"

namespace carmap {

struct MapDriveOptions {
  FrontEndOptions front_end;
  TrackerOptions tracker;
  LocalMapperOptions mapper;
  LoopCloserOptions loops;  ///< its `sequential` follows from the one below
  /// By which places are recognized; without one they are looked for where the map has them.
  std::shared_ptr<const Vocabulary> vocabulary;
  bool sequential = false;
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
  StereoRig rig;          ///< the source's, with the disparity bias found on the way
  Trajectory trajectory;  ///< in the map's frame, one entry a frame, after all adjustments
  std::vector<LostFrame> lost_frames;
  std::vector<MapPart> parts;                ///< one if the whole map holds together
  std::vector<Loop> loops;                   ///< that were closed
  size_t rejected_loop_keyframes = 0;        ///< see LoopDetector::rejected_count
  std::optional<Georeference> georeference;  ///< where GPS fixes tell it
  std::vector<double> frame_ms;              ///< from images in memory to the frame's pose
  std::map<std::string, double> stage_ms;    ///< total of each stage
};

/// Called after each frame with the number of frames and keyframes so far.
using MapProgress = std::function<void(size_t frames, size_t keyframes)>;

/// Maps what can be tracked; frames that cannot are listed with the reason. A drive that cannot go
/// on in its map begins a new part, which lies where the vehicle must have come to, and is joined
/// to the rest when it is found there.
/// Errors: FailedPrecondition when no frame could be tracked.
absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id,
                                     const MapDriveOptions& options,
                                     const MapProgress& progress = {});

}  // namespace carmap
