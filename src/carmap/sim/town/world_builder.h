// Builds a world along a route: roads, buildings, gardens and what stands beside the road (§5.1).
//
// A pure function: the same scene, route and seed give the same world.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "carmap/sim/road/route.h"
#include "carmap/sim/road/scene.h"
#include "carmap/sim/town/world.h"

namespace carmap {

/// `heights` may be empty: then the ground is gently rolling from the seed.
World BuildWorld(Scene scene, const Route& route, const std::vector<Eigen::Vector3d>& heights,
                 uint64_t seed);

}  // namespace carmap
