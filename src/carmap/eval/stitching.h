// How well a map segment is placed in a base map, in the ways that the paper compares (§A.6).
//
// Each way tells where it puts the segment's keyframes in the base's frame; the truth tells how far
// off that is. Pure functions, deterministic but for times, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <optional>
#include <vector>

#include "carmap/base/summary.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/eval/full_map.h"
#include "carmap/eval/map_truth.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"
#include "carmap/update/stitch.h"

namespace carmap {

/// Where a way of stitching puts the segment's keyframes.
struct PlacedSegment {
  LeanMap keyframes;  ///< those that are placed, in the base's frame, without landmarks
  double ms = 0;      ///< that the whole operation takes
};

/// CarMap's way, by position or, with options.fit.locator.by_appearance, by appearance: fitted and
/// applied. Errors: as Stitch.
absl::StatusOr<PlacedSegment> StitchSegment(const LeanMap& base, const LeanMap& segment,
                                            const StitchOptions& options);

/// Progressive relocalization: from the keyframe that overlaps best, the others one after the other
/// are found anew in the base with what of the segment is in it by then. The map's growing is not
/// counted as time, the searches are. Errors: NotFound (no overlap).
absl::StatusOr<PlacedSegment> RelocalizeProgressively(const LeanMap& base, const LeanMap& segment,
                                                      const StitchOptions& options);

/// QuickSketch's way (Ahmad, Qiu, Liu, Bai and Govindan 2018): of a camera trace, all its features,
/// one keyframe is found in a full map by appearance; the others follow as the trace has them.
/// Errors: NotFound (none is found).
absl::StatusOr<PlacedSegment> StitchTrace(const FullMap& base, const FullMap& trace);

/// What a segment may be off: so much near the base, and a part of the way beyond.
inline constexpr double kMaxNearErrorM = 0.10, kNearBaseM = 50, kMaxErrorPerM = 0.001;

struct StitchingScore {
  size_t keyframes = 0;      ///< placed, with a true pose
  Summary error_m;           ///< against the truth, to which the base is aligned as a whole
  Summary map_error_m;       ///< against where the base's own trajectory has the truth
  size_t within_bounds = 0;  ///< of the keyframes, by map_error_m
  double farthest_m = 0;     ///< from the base, of all keyframes
};

/// `truth` is the segment's. Nothing if no keyframe has a true pose.
std::optional<StitchingScore> ScoreStitching(const LeanMap& placed, const Trajectory& truth,
                                             const LeanMap& base, const MapTruth& base_truth,
                                             const Rigid3& world_from_base);

}  // namespace carmap
