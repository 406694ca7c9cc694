// Builds a world along a route: roads, buildings, gardens and what stands beside the road (§5.1).
//
// Pure functions: the same scene, route, seed and changes give the same world.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/sim/change.h"
#include "carmap/sim/route.h"
#include "carmap/sim/world.h"

namespace carmap {

enum class Scene : uint8_t { kSuburb, kDowntown, kFreeway };

/// What the road looks like, for traffic and for the vehicle itself. Lanes are counted from the
/// route's own (0) to the left; negative ones lie to the right.
struct RoadProfile {
  double lane_width_m = 3.5;
  int first_lane = 0, last_lane = 1;  ///< all that may be driven in the route's direction ...
  int first_oncoming = 1, last_oncoming = 1;  ///< ... and against it
  double speed_mps = 10;                      ///< usual on it
};
RoadProfile ProfileOf(Scene scene);

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

/// `heights` may be empty: then the ground is gently rolling from the seed.
World BuildWorld(Scene scene, const Route& route, const std::vector<Eigen::Vector3d>& heights,
                 uint64_t seed);

}  // namespace carmap
