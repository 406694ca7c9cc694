// Where a frame was taken that tracking cannot place: anywhere in the map that is being built.
//
// First the keyframes around where the vehicle should be, then the whole map, searched as a given
// map is (localize/place_search). Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/place_search.h"
#include "carmap/map/map.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/slam/map_window.h"

namespace carmap {

struct RecoveryOptions {
  TrackingOptions tracking;
  WindowOptions window;  ///< around a place, in which the frame's pose is told
  PlaceSearchOptions search;
  double near_m = 40;        ///< keyframes this close to the prediction are tried first
  size_t near_inliers = 20;  ///< landmarks that must agree there
  size_t far_inliers = 50;   ///< nothing else speaks for such a place
};

struct FoundPlace {
  KeyframeId keyframe_id;
  MapSnapshot snapshot;  ///< of the window around the keyframe
  TrackedPose pose;      ///< of the frame in it
};

/// The frame among those of the candidates that are near the prediction.
std::optional<FoundPlace> FindNear(const Map& map, const std::vector<KeyframeId>& candidates,
                                   const FeatureGrid& grid, const StereoRig& rig,
                                   const Rigid3& predicted_map_from_camera,
                                   const RecoveryOptions& options);

/// The frame among all candidates. Takes time in proportion to what they see.
std::optional<FoundPlace> FindAnywhere(const Map& map, const std::vector<KeyframeId>& candidates,
                                       const FeatureGrid& grid, const StereoRig& rig,
                                       const RecoveryOptions& options);

}  // namespace carmap
