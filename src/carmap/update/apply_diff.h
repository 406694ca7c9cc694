// What the base map becomes by what a drive proposes (paper §3.4, Algorithm A.1).
//
// The map grows with the road, not with the driving: what both saw becomes one landmark, a keyframe
// of the drive that stands where the base has one gives it what it saw and goes, and where there
// are landmarks enough those that the fewest drives saw make way. Pure, deterministic, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>

#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct ApplyOptions {
  /// Nearer to a keyframe of the base that looks the same way, one of the drive shows nothing new:
  /// less than a lane.
  double same_place_m = 2.5, same_place_rad = 0.25;
  size_t max_landmarks = 2048;  ///< of a keyframe that takes others' in
  /// Where the base has keyframes, landmarks that hang on one of them by those that a single drive
  /// would hang there: what few drives saw makes way for what is new.
  double max_growth = 1.35;
  double min_new_share = 0.25;  ///< of a drive's own landmarks there, that find a place
  MeasurementNoise noise;
};

/// The base's keyframes stay where they are. What the base has of the drive by now is not added
/// again; pairs whose base landmark has gone since make a new landmark. Errors: InvalidArgument
/// (the diff or what it leads to is not consistent).
absl::StatusOr<LeanMap> Apply(const MapDiff& diff, const LeanMap& base,
                              const ApplyOptions& options = {});

}  // namespace carmap
