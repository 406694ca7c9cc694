// Where a frame was taken that tracking cannot place: anywhere in the map that is being built.
//
// First the keyframes around where the vehicle should be, then those of the whole map that resemble
// the frame most. Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/map/map.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/slam/map_window.h"

namespace carmap {

struct RecoveryOptions {
  TrackingOptions tracking;
  WindowOptions window;            ///< of landmarks that are tried together
  double position_radius_px = 60;  ///< search window when the frame is taken to stand at a keyframe
  double near_m = 40;              ///< keyframes this close to the prediction are tried first ...
  size_t near_places = 4;          ///< ... at most so many places
  int near_inliers = 30;           ///< landmarks that must agree there
  size_t far_places = 4;           ///< tried by appearance
  int far_inliers = 80;            ///< nothing else speaks for such a place
  size_t ranking_features = 300;   ///< of the frame, that rank far places
  int max_ranking_bits = 50;       ///< between a feature and the landmark that it votes for
};

struct FoundPlace {
  KeyframeId keyframe_id;
  MapSnapshot snapshot;  ///< of the window around the keyframe
  TrackedPose pose;      ///< of the frame in it
};

/// The frame among those of the candidates that are near the prediction, nearest first.
std::optional<FoundPlace> FindNear(const Map& map, const std::vector<KeyframeId>& candidates,
                                   const FeatureGrid& grid, const StereoRig& rig,
                                   const Rigid3& predicted_map_from_camera,
                                   const RecoveryOptions& options);

/// The frame among all candidates, those first that resemble it most. Takes time in proportion to
/// what they see.
std::optional<FoundPlace> FindAnywhere(const Map& map, const std::vector<KeyframeId>& candidates,
                                       const FeatureGrid& grid, const StereoRig& rig,
                                       const RecoveryOptions& options);

}  // namespace carmap
