// How far localized poses are from the truth.
//
// The map is aligned to the truth once, rigidly, by its own keyframes and never by the localized
// poses: an error that the localizer makes everywhere shows in full. Pure functions, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <vector>

#include "carmap/base/summary.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"

namespace carmap {

struct MapAlignment {
  Rigid3 world_from_map;
  size_t keyframes = 0;  ///< that have a true pose
  double rmse_m = 0;     ///< of their positions, after the alignment
};

/// As FindTrueKeyframes and AlignTrajectories. Errors: FailedPrecondition when fewer than three
/// keyframes have a true pose.
absl::StatusOr<MapAlignment> AlignMapToTruth(const LeanMap& map, const Trajectory& truth);

struct LocalizationError {
  size_t frames = 0;  ///< localized, with a true pose
  Summary position_m, rotation_deg;
};

/// Of one frame; errors are NaN where the frame was not localized or has no true pose.
struct FrameError {
  double path_m = 0;  ///< driven up to here along the truth
  double position_m = 0, rotation_deg = 0;
};
std::vector<FrameError> LocalizationErrors(const Trajectory& map_from_camera,
                                           const Trajectory& truth, const Rigid3& world_from_map);

/// `map_from_camera` and `truth` have one entry a frame, of the same frames.
LocalizationError EvaluateLocalization(const Trajectory& map_from_camera, const Trajectory& truth,
                                       const Rigid3& world_from_map);

}  // namespace carmap
