// Stitching a map segment to a base map (paper §3.4, Algorithm A.1).
//
// Pure: the base map is never changed. The same maps give the same result, bit by bit.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>

#include "carmap/map/lean_map.h"
#include "carmap/update/keyframe_locator.h"
#include "carmap/update/merge_segment.h"
#include "carmap/update/overlap.h"
#include "carmap/update/segment_fit.h"

namespace carmap {

struct StitchOptions {
  LocatorOptions locator;
  OverlapOptions overlap;
  FitOptions fit;
  MergeOptions merge;
  size_t min_keyframes = 3;       ///< of the segment, that must agree on where it lies
  size_t min_inliers = 30;        ///< landmarks of both maps that are the same
  double min_inlier_ratio = 0.3;  ///< of the matched landmarks
  /// Keyframes that the base's landmarks put elsewhere than the fit does, of all that see some.
  double max_contradicting_ratio = 0.2;
  double max_strain = 0.05;  ///< by which the fit may change a stretch of the segment
};

struct StitchReport {
  size_t segment_keyframes_tried = 0;          ///< looked for in the base map
  size_t segment_keyframes_found = 0;          ///< of these found there
  size_t segment_keyframes_overlapping = 0;    ///< that hold the segment to the base
  size_t segment_keyframes_contradicting = 0;  ///< that the base's landmarks put elsewhere
  size_t segment_keyframes_added = 0;          ///< the others stand where the base has one
  size_t base_keyframes_overlapping = 0;       ///< that see a landmark of the segment
  size_t matches = 0;                          ///< landmarks of both maps taken for the same ...
  size_t inliers = 0;                          ///< ... that lie in one place, and became one
  double median_distance_m = 0;  ///< of these, between the maps once the segment is bent
  /// Between where overlapping keyframes are put and where the base's landmarks see them.
  double median_misfit_m = 0;
  double largest_strain = 0;  ///< ratio by which the fit changes a stretch of 30 m, at most
  double scale = 1;           ///< lengths along the overlap, in the base by in the segment
};

struct StitchedMap {
  LeanMap map;
  StitchReport report;
};

/// The base map with the segment in it, bent to where it overlaps (segment_fit.h). Ids and the
/// base's keyframes stay. A landmark that both saw stays once, where both together put it, and is
/// seen by the keyframes of both. An empty base (no keyframes) takes the segment as it is. Errors:
/// InvalidArgument (a map is not consistent), AlreadyExists (the segment's drive is in the base
/// map), FailedPrecondition (no overlap, too few matches, two places that fit, or parts that
/// contradict each other), each with figures.
absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options = {});

}  // namespace carmap
