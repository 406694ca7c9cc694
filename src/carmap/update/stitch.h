// Stitching a map segment to a base map (paper §3.4, Algorithm A.1): fitted, then applied.
//
// Pure: the base map is never changed. The same maps give the same result, bit by bit.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>

#include "carmap/map/lean_map.h"
#include "carmap/update/apply_diff.h"
#include "carmap/update/fit.h"

namespace carmap {

struct StitchOptions {
  FitOptions fit;
  ApplyOptions apply;
};

struct StitchedMap {
  LeanMap map;
  FitReport report;
  size_t keyframes_added = 0;  ///< the segment's others stand where the base has one
};

/// The base map with the segment in it, bent to where it overlaps. Ids and the base's keyframes
/// stay. A landmark that both saw stays once, where both together put it, and is seen by the
/// keyframes of both. An empty base (no keyframes) takes the segment as it is. Errors: those of
/// Fit and Apply; AlreadyExists (the segment's drive is in the base map).
absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options = {});

}  // namespace carmap
