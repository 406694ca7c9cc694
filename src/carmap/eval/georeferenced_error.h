// How far a georeferenced trajectory is from the truth on the Earth, without any alignment.
//
// Pure function, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

/// Horizontal distances, metres, of the frames that have both poses. The estimate is moved by
/// `enu_from_estimate` to east-north-up coordinates about `origin`; the truth is in such
/// coordinates about `truth_origin`. Errors: as MatchTrajectories.
absl::StatusOr<std::vector<double>> GeoreferencedErrorsM(const Trajectory& estimate,
                                                         const Rigid3& enu_from_estimate,
                                                         const GpsFix& origin,
                                                         const Trajectory& truth,
                                                         const GpsFix& truth_origin);

}  // namespace carmap
