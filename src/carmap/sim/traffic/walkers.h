// People on the sidewalks beside the route.
//
// Pure functions; all follows from the seed.
#pragma once

#include <memory>
#include <vector>

#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/scene.h"
#include "carmap/sim/traffic/ego_track.h"
#include "carmap/sim/traffic/fleet.h"
#include "carmap/sim/traffic/obstacle_map.h"
#include "carmap/sim/traffic/traffic_flow.h"

namespace carmap {

/// A stretch of sidewalk without a road across it.
struct Sidewalk {
  std::unique_ptr<const Route> middle;  ///< in the route's direction
  double begin_m = 0, end_m = 0;        ///< along the route
  double width_m = 0;                   ///< where it is narrowest
};

/// Right beyond the carriageway's edge, on both sides of the route.
std::vector<Sidewalk> FindSidewalks(const Route& route, const RoadProfile& profile,
                                    const GroundMap& ground);

/// One for about each `spacing_m` of sidewalk that ego passes: most of them walk, some in twos,
/// some stand. They stop where something is in their way and where the sidewalk ends.
std::vector<Course> SimulateWalkers(const std::vector<Sidewalk>& sidewalks, const Route& route,
                                    const ObstacleMap& obstacles, const EgoTrack& ego,
                                    const Fleet& fleet, double spacing_m, HashSequence random);

}  // namespace carmap
