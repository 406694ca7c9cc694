// The simulated world: models, where they stand, and the ground below them.
//
// Frame `enu`: x east, y north, z up, metres, about a stated point of the Earth. All drives of one
// world share it. Immutable once built; safe to read from many threads.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "carmap/geometry/geodesy.h"
#include "carmap/sim/mesh/mesh.h"

namespace carmap {

class GroundMap;

/// What may have moved when the next vehicle comes by.
enum class PlacementMobility : uint8_t { kStatic, kParked, kMoving };

/// A model set into the world: scaled, turned about the vertical, tilted with the ground, moved.
struct Placement {
  uint32_t model_idx = 0;
  Eigen::Vector3d position_in_enu = Eigen::Vector3d::Zero();  ///< of the model's origin
  float heading_rad = 0;  ///< of the model's x axis, from east towards north
  float pitch_rad = 0;    ///< nose up is positive
  float scale = 1;
  float shade = 1;            ///< multiplies the albedo of its surfaces
  uint32_t texture_seed = 0;  ///< shifts and chooses its patterns
  PlacementMobility mobility = PlacementMobility::kStatic;
  uint16_t instance = 0;  ///< unique among parked and moving ones of a drive; static: 0
};

/// A thing that stands in the world by itself and has a name, so that a change can name it.
struct WorldObject {
  std::string name;  ///< "tree-00012": kind and number, the same for the same scene, path and seed
  Placement placement;
};

/// A place beside the road where cars park, on the carriageway or next to it.
struct ParkingPlace {
  Eigen::Vector3d position_in_enu = Eigen::Vector3d::Zero();
  float heading_rad = 0, pitch_rad = 0;
  float length_m = 5;
};

struct World {
  std::vector<Mesh> models;          ///< tiles of the town first (placed once), then shared ones
  std::vector<Placement> tiles;      ///< ground, kerbs, buildings: what no change touches
  std::vector<WorldObject> objects;  ///< trees, poles, signs, kiosks: what a change may
  std::vector<ParkingPlace> parking;
  std::shared_ptr<const GroundMap> ground;
  GpsFix origin;  ///< of `enu`
};

}  // namespace carmap
