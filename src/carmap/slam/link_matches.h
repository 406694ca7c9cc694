// What matches mean for the map. Pure, thread-safe on a map that nobody changes.
#pragma once

#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

/// For each corner of the keyframe (CornerOf) the landmark that one of its features belongs to, the
/// oldest if they belong to several.
std::vector<std::optional<LandmarkId>> LandmarksOfCorners(const Map& map, KeyframeId keyframe_id);

/// Records that keyframe `keyframe_id` sees the matched landmarks of `snapshot`: a feature of a
/// free corner becomes an observation; a corner that belongs to another landmark shows that the two
/// are the same, unless some keyframe sees both of them side by side.
void LinkMatches(const Map& map, const MapSnapshot& snapshot, KeyframeId keyframe_id,
                 const std::vector<LandmarkMatch>& matches, MapEdit& edit);

}  // namespace carmap
