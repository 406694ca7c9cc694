// An edit that moves part of a map, propagated to the rest of it.
//
// Pure and thread-safe.
#pragma once

#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"

namespace carmap {

/// The edit, and the same rigid motions for all that it does not move itself: each other keyframe
/// moves as the moved one before it in its drive (or, before the first, as that), each other
/// landmark as the first keyframe that sees it. So a result that was worked out on an older version
/// of the map moves what was added since, and an edit of poses alone moves the landmarks.
/// What got another place since that version is newer than the edit's and moves like the rest.
/// Keyframes of drives of which none is moved stay. The result is an edit of the present version.
MapEdit PropagateEdit(const Map& map, MapEdit edit);

}  // namespace carmap
