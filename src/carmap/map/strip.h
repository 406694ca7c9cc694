// From the working map to the lean map (paper §3.1): what a vehicle sends of what it built.
//
// Pure and thread-safe. The lean map is consistent in the sense of CheckConsistency.
#pragma once

#include <cstddef>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map.h"

namespace carmap {

struct StripOptions {
  /// Keyframes that must have seen a landmark. Fewer make a position that nobody checked.
  size_t min_observations = 3;
};

struct StrippedMap {
  LeanMap lean;
  /// For each landmark of `lean` the one of the working map that it was.
  std::vector<LandmarkId> sources;
};

/// All keyframes of the map, also those that see no landmark kept, and the landmarks that stay, of
/// which none was voted non-static (§3.3).
/// Landmarks get new ids (drive, 0 … n-1) in the order of their keyframe lists, then of their
/// levels: so ids, lists and levels cost next to nothing in a file. All keyframes must be of
/// `drive`.
StrippedMap Strip(const Map& map, const LeanDrive& drive, const StripOptions& options = {});

/// The part of it from one keyframe to another, both of the map: what these saw, and nothing of the
/// rest is looked at. Lists of keyframes hold those of the stretch; `min_observations` counts all.
StrippedMap StripStretch(const Map& map, const LeanDrive& drive, KeyframeId first, KeyframeId last,
                         const StripOptions& options = {});

}  // namespace carmap
