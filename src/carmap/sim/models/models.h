// The things that a simulated world is furnished with, as meshes (frame of sim/mesh/mesh.h).
//
// All are procedural: the same kind and variant give the same mesh. Pure functions, thread-safe.
//
// Props are made as they stand on the right of a road that runs along x: long ones (hedges,
// fences, walls, benches, shelters) along x with their front to the road, +y; faces of signs,
// signals and billboards look to -x, to who comes along; arms of lamps and signals reach to +y. So
// one on the right has the road's heading, one on the left the opposite. The origin is where a
// pole or trunk stands, else below the middle. What stands in the earth goes 0.4 m below z = 0, so
// that slopes do not lift it off.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "carmap/sim/mesh/mesh.h"

namespace carmap {

/// A prototype that placements share.
struct Model {
  std::string_view kind;  ///< "tree", "lamp", "billboard", …: the name of a kind below
  Mesh mesh;
  /// Of its bounding box along x, y, z; the height from the ground.
  float length_m = 0, width_m = 0, height_m = 0;
};

/// Kinds of things beside the road: "tree" (broad-leaved), "young-tree" (thin, staked), "conifer",
/// "bush", "hedge" (2 m of it), "fence" (2 m of it: pickets), "wire-fence", "lamp", "pole" (wooden,
/// with arms for wires), "traffic-sign", "traffic-light", "street-name", "billboard", "kiosk",
/// "bin", "bollard", "bench", "bus-stop", "mailbox", "planter", "scaffolding" (6 m of it),
/// "container", "cone", "road-barrier", "gantry" (over 4 lanes), "guard-rail" (4 m of it),
/// "sound-wall" (4 m of it), "concrete-barrier" (4 m of it), "electric-box", "advertising-column".
/// Several variants of most; `variant` counts from 0 and wraps. The kind must be one of
/// PropKinds().
Model MakeProp(std::string_view kind, uint32_t variant);
/// 0 for what is no kind of prop.
uint32_t PropVariants(std::string_view kind);
std::vector<std::string_view> PropKinds();

/// Kinds of traffic: "hatchback", "saloon", "estate", "suv", "van", "lorry", "bus", "cyclist",
/// "pedestrian", "motorcycle". The kind must be one of VehicleKinds().
///
/// Pedestrians and cyclists walk and pedal by changing variant = look * VehiclePhases + phase: a
/// whole cycle of phases goes with VehicleCycleM of way. In phase 0 a pedestrian's legs pass each
/// other: it serves for one who stands.
Model MakeVehicle(std::string_view kind, uint32_t variant);
/// 0 for what is no kind of vehicle.
uint32_t VehicleVariants(std::string_view kind);
std::vector<std::string_view> VehicleKinds();
/// Divides VehicleVariants; 1 for those that do not change.
uint32_t VehiclePhases(std::string_view kind);
/// How far one moves while its phases go round once; 0 for those that do not change.
float VehicleCycleM(std::string_view kind);

}  // namespace carmap
