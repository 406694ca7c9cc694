// What matches mean for the map. Pure, thread-safe on a map that nobody changes.
#pragma once

#include <vector>

#include "carmap/base/ids.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

/// Records that keyframe `keyframe_id` sees the matched landmarks of `snapshot`: a free feature
/// becomes an observation; one that belongs to another landmark shows that the two are the same.
void LinkMatches(const Map& map, const MapSnapshot& snapshot, KeyframeId keyframe_id,
                 const std::vector<LandmarkMatch>& matches, MapEdit& edit);

}  // namespace carmap
