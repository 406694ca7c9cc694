// What a loop means for the map: the drift since the place is spread over the way from there, and
// landmarks that were mapped twice become one (paper §5.4).
//
// Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/slam/loop_detector.h"
#include "carmap/slam/map_window.h"
#include "carmap/solve/pose_graph.h"
#include "carmap/solve/position_prior.h"

namespace carmap {

struct LoopCorrectionOptions {
  StepNoise step;

  int min_shared_landmarks = 30;      ///< of keyframes far apart in time that hold each other
  size_t min_keyframes_between = 20;  ///< that make them far apart
  double fuse_radius_px = 6;
  WindowOptions window;  ///< keyframes around the newest, and around the place, that are fused
};

/// Poses of all keyframes such that steps, loops closed before, `loop` and `fixes` (either may be
/// empty; FixesAsPriors) agree best. Landmarks move with their keyframes. The first keyframe,
/// where the map begins, stays.
MapEdit CorrectPoses(const Map& map, const Loop& loop, const std::vector<PositionPrior>& fixes,
                     const LoopCorrectionOptions& options);

/// Observations of the place's landmarks by the newest keyframes, and mergers of those seen twice.
/// The map is as the loop was found in.
MapEdit FuseLoop(const Map& map, const StereoRig& rig, const Loop& loop,
                 const LoopCorrectionOptions& options);

/// Moves all that the edit moves such that the map's first keyframe stays where it is.
void KeepFirstKeyframe(const Map& map, MapEdit& edit);

}  // namespace carmap
