// The shape of the ground: terrain, kerbs and raised sidewalks.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "carmap/sim/road/road_ground.h"
#include "carmap/sim/town/site.h"

namespace carmap {

/// Into the site's tiles; out to the skyline.
void AddTerrain(Site& site);

/// Along the edges of all carriageways, which have sidewalks of their road's width.
void AddKerbs(Site& site);

/// The edges of the carriageways' union: closed lines with the carriageway on their left, straight
/// parts of several metres, exact to a centimetre.
std::vector<std::vector<Eigen::Vector2d>> CarriagewayEdges(const RoadGround& ground);

}  // namespace carmap
