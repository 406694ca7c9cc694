// A world while it is being built: what is there, what is free, and how things are put there.
//
// Belongs to one thread.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "carmap/base/random.h"
#include "carmap/sim/mesh/mesh_builder.h"
#include "carmap/sim/road/road_ground.h"
#include "carmap/sim/road/road_network.h"
#include "carmap/sim/road/scene.h"
#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/town/world.h"

namespace carmap {

/// How a prop is put.
struct Setting {
  double heading_rad = 0;
  double scale = 1;
  double margin_m = 0;   ///< to everything that is there already
  double edge_m = 0.25;  ///< to carriageways, at least
  double lift_m = 0;     ///< above the ground: on a sidewalk
};

class Site {
 public:
  Site(Scene scene, const Route& route, const std::vector<Eigen::Vector3d>& heights, uint64_t seed);

  Scene scene() const { return scene_; }
  uint64_t seed() const { return seed_; }
  const RoadNetwork& roads() const { return roads_; }
  const RoadGround& ground() const { return *ground_; }
  Occupancy& occupancy() { return occupancy_; }
  const Occupancy& occupancy() const { return occupancy_; }
  /// What a car on the route sweeps over.
  const Occupancy& route_swath() const { return route_swath_; }
  std::vector<Decal>& decals() { return decals_; }

  /// On the ground.
  Eigen::Vector3d At(const Eigen::Vector2d& p_in_enu) const;
  /// True when the box is free and keeps that far away from carriageways.
  bool IsFree(const GroundBox& box, double edge_m) const;

  /// Puts a prop of kind and variant (any number; wraps) if there is room, as an object with a
  /// name. Poles and trunks need room for themselves only, not for what they carry.
  bool Place(std::string_view kind, uint32_t variant, const Eigen::Vector2d& p_in_enu,
             const Setting& setting, HashSequence& draw);
  /// Without looking whether there is room, and without claiming it.
  void PlaceAnyway(std::string_view kind, uint32_t variant, const Eigen::Vector2d& p_in_enu,
                   const Setting& setting, HashSequence& draw);

  double HeightOf(std::string_view kind, uint32_t variant) {
    return ModelOf(kind, variant).height_m;
  }

  /// The mesh of the ground's square there, and what a frame at a place in `enu` is in it. The
  /// reference stays valid until the next call.
  MeshBuilder& TileAt(const Eigen::Vector2d& p_in_enu);
  Eigen::Affine3f FrameInTile(const Eigen::Vector2d& tile_of, const Eigen::Vector3d& origin_in_enu,
                              double heading_rad) const;

  void AddParking(const ParkingPlace& place) { parking_.push_back(place); }
  const std::vector<ParkingPlace>& parking() const { return parking_; }

  /// Slope of the ground along a heading.
  double PitchAt(const Eigen::Vector2d& p_in_enu, double heading_rad) const;

  World Finish() &&;

  static constexpr double kTileM = 96;

 private:
  struct SharedModel {
    uint32_t idx;
    float length_m, width_m, height_m;
  };
  const SharedModel& ModelOf(std::string_view kind, uint32_t variant);

  Scene scene_;
  uint64_t seed_;
  RoadNetwork roads_;
  std::shared_ptr<RoadGround> ground_;
  Occupancy occupancy_, route_swath_;
  std::vector<Decal> decals_;
  std::map<std::pair<int, int>, MeshBuilder> tiles_;
  std::map<std::pair<std::string_view, uint32_t>, SharedModel> model_by_kind_;
  std::vector<Mesh> models_;
  std::vector<WorldObject> objects_;
  std::map<std::string_view, uint32_t> counts_;
  std::vector<ParkingPlace> parking_;
};

}  // namespace carmap
