// What a drive proposes to the base map (paper §3.4): what it saw, placed in the base, and which
// of its landmarks the base has.
//
// A segment becomes one when it is fitted (update/fit.h). It says what was seen, not what becomes
// of the base: that is a Patch. Proposals may come late, twice, in any order: each has a name. A
// plain value.
#pragma once

#include <cstdint>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// One corner of the world under two names.
struct SameLandmark {
  LandmarkId in_base, in_drive;
  auto operator<=>(const SameLandmark&) const = default;
};

/// Named by its drives and its part of them.
struct MapDiff {
  uint32_t part = 0;  ///< from 0, of what the drive proposes
  TileId frame;       ///< tile in whose frame all is; none of a base of one map
  LeanMap drive;
  std::vector<SameLandmark> seen_again;  ///< ascending; each landmark at most once
};

}  // namespace carmap
