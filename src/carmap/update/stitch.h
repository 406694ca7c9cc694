// Stitching a map segment to a base map (paper §3.4, Algorithm A.1).
//
// Pure: the base map is never changed. The same maps give the same result, bit by bit.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>

#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"
#include "carmap/update/overlap.h"

namespace carmap {

struct StitchOptions {
  OverlapOptions overlap;
  size_t min_keyframes = 3;       ///< of the segment, that must agree on where it lies
  int min_inliers = 50;           ///< landmarks of both maps that are the same
  double min_inlier_ratio = 0.3;  ///< of the matched landmarks
};

struct StitchReport {
  size_t segment_keyframes_tried = 0;  ///< looked for in the base map
  size_t segment_keyframes_found = 0;  ///< of these found there
  size_t segment_keyframes_overlapping = 0;
  size_t base_keyframes_overlapping = 0;  ///< that see a landmark of the segment
  size_t matches = 0;                     ///< landmarks of both maps taken for the same ...
  size_t inliers = 0;                     ///< ... that lie in one place
  size_t duplicates_removed = 0;
  double median_distance_m = 0;  ///< of the inliers, between the maps after the transform
  /// Between where an overlapping keyframe is put and where the base's landmarks see it, at most:
  /// what a rigid move leaves of two maps that differ in scale or shape.
  double largest_misfit_m = 0;
  Rigid3 base_from_segment;
};

struct StitchedMap {
  LeanMap map;
  StitchReport report;
};

/// The base map with the segment in it, moved rigidly to where it overlaps. Ids stay. A landmark
/// that both saw stays once, where the base had it, and is seen by the keyframes of both. An empty
/// base (no keyframes) takes the segment as it is. Errors: InvalidArgument (a map is not
/// consistent), AlreadyExists (the segment's drive is in the base map), FailedPrecondition (no
/// overlap, too few matches, or two places that fit), each with figures.
absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options = {});

}  // namespace carmap
