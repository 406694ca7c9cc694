// Fits a map segment to a base map, or says why it does not fit (paper §3.4, Algorithm A.1).
//
// The base stays, the segment bends (segment_fit.h). Pure: nothing is changed; what the fit
// proposes is applied by Apply (apply_diff.h). The same maps give the same result, bit by bit.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <vector>

#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"
#include "carmap/update/keyframe_locator.h"
#include "carmap/update/overlap.h"
#include "carmap/update/segment_fit.h"

namespace carmap {

struct FitOptions {
  LocatorOptions locator;
  OverlapOptions overlap;
  BendOptions bend;
  size_t min_keyframes = 3;       ///< of the segment, that must agree on where it lies
  size_t min_anchors = 2;         ///< that then hold it
  size_t min_inliers = 30;        ///< landmarks of both maps that are the same
  double min_inlier_ratio = 0.3;  ///< of the matched landmarks
  /// Keyframes that the base's landmarks put elsewhere than the fit does, of all that see some.
  double max_contradicting_ratio = 0.2;
  double max_strain = 0.05;  ///< by which the fit may change a stretch of the segment
};

struct FitReport {
  size_t segment_keyframes_tried = 0;          ///< looked for in the base map
  size_t segment_keyframes_found = 0;          ///< of these found there
  size_t segment_keyframes_overlapping = 0;    ///< that hold the segment to the base
  size_t segment_keyframes_contradicting = 0;  ///< that the base's landmarks put elsewhere
  size_t base_keyframes_overlapping = 0;       ///< that see a landmark of the segment
  size_t matches = 0;                          ///< landmarks of both maps taken for the same ...
  size_t inliers = 0;                          ///< ... that lie in one place
  double median_distance_m = 0;  ///< of these, between the maps once the segment is bent
  /// Between where overlapping keyframes are put and where the base's landmarks see them.
  double median_misfit_m = 0;
  double largest_strain = 0;  ///< ratio by which the fit changes a stretch of 30 m, at most
  double scale = 1;           ///< lengths along the overlap, in the base by in the segment
};

struct FittedSegment {
  MapDiff diff;
  FitReport report;
  std::vector<AnchoredKeyframe> anchors;  ///< what holds the segment to the base
  std::vector<DriveStep> steps;           ///< and what holds it together
};

/// Errors, each with figures: InvalidArgument (a map is not consistent), NotFound (no overlap, or
/// too little to tell), FailedPrecondition (two places that fit, or parts that contradict each
/// other: one of the two maps is wrong).
absl::StatusOr<FittedSegment> Fit(const LeanMap& base, const LeanMap& segment,
                                  const FitOptions& options = {});

/// The same of a segment whose drive was localized in the base: where its anchors put it.
/// `base_map` is `base` rebuilt for the segment's focal length. Errors: FailedPrecondition (the
/// anchors contradict each other, with figures).
absl::StatusOr<FittedSegment> FitLocalized(const LeanMap& base, const ReconstructedMap& base_map,
                                           const LeanMap& segment,
                                           std::vector<AnchoredKeyframe> anchors,
                                           const FitOptions& options = {});

}  // namespace carmap
