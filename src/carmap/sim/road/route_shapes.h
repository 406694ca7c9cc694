// Where the roads of a world lead: routes drawn from a seed, or along a recorded drive (§5.1).
//
// Pure functions: the same shape, scene, length and seed give the same route.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/sim/road/route.h"
#include "carmap/sim/road/scene.h"

namespace carmap {

enum class RouteShape : uint8_t { kStraight, kCurves, kBlock };

/// The route of a scene: about `length_m` long (a block: a closed loop of that length).
Route MakeRoute(RouteShape shape, Scene scene, double length_m, uint64_t seed);

/// The route along ground-truth poses in KITTI's frame (x right, y down, z forward of the first
/// camera), laid into `enu` with z to the north, and what the poses say of the ground's height.
struct RecordedPath {
  Route route;
  std::vector<Eigen::Vector3d> positions_in_enu;  ///< smoothed, of the ground below the camera
};
/// Errors: InvalidArgument for fewer than two poses, none far enough apart, a jump (more than 5 m
/// between neighbours), or a slope of more than 35 %.
absl::StatusOr<RecordedPath> RouteAlong(const Trajectory& poses);

}  // namespace carmap
