// What moves with what: an edit that moves part of a map, extended to the rest of it.
//
// Pure and thread-safe.
#pragma once

#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"

namespace carmap {

/// The edit, and with it all that it does not move itself: each other keyframe goes rigidly with
/// the moved one before it in its drive (or, before the first, with that), each other landmark with
/// the first keyframe that sees it. So a result that was worked out on an older version of the map
/// takes along what was added since, and an edit of poses alone takes the landmarks along.
/// Keyframes of drives of which none is moved stay.
MapEdit CarryAlong(const Map& map, MapEdit edit);

}  // namespace carmap
