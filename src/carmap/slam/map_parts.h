// Parts of a map that nothing holds together: a drive begins a new one where it was blind for too
// long.
//
// All parts lie in the map's one frame. A new one is put where the vehicle must have come to in the
// meantime, and moved to where it belongs once something tells: a keyframe that is found in the map
// from before, or a loop. Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"

namespace carmap {

/// What is known of the vehicle before it was lost.
struct Gap {
  KeyframeId reference;          ///< a keyframe before the gap ...
  Rigid3 camera_from_reference;  ///< ... and the last pose, relative to it
  Rigid3 motion_before;          ///< motion between the last two poses
  double motion_before_s = 0;    ///< that it took; 0 if it is not known
  double duration_s = 0;         ///< from the last pose to the first one after
};

/// Where the first camera after the gap was, if the vehicle kept its speed and turn for the first
/// half of the time, and had those from after the gap for the second.
Rigid3 BridgeGap(const Gap& gap, const Rigid3& map_from_reference, const Rigid3& motion_after,
                 double motion_after_s);

/// Moves the keyframes from `first` on, and the landmarks that only they see, as one.
MapEdit MovePart(const Map& map, KeyframeId first, const Rigid3& moved_from_map);

/// The keyframes of each part, ascending; of two parts the one that begins earlier comes first.
/// Keyframes that share a landmark are of one part.
std::vector<std::vector<KeyframeId>> ConnectedParts(const Map& map);

}  // namespace carmap
