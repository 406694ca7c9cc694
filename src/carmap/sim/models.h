// The things that a simulated world is furnished with, as meshes (frame of sim/mesh.h).
//
// All are procedural: the same seed gives the same mesh. Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "carmap/sim/mesh.h"

namespace carmap {

/// A prototype that placements share.
struct Model {
  std::string_view kind;  ///< "tree", "lamp", "billboard", …: the name of a kind below
  Mesh mesh;
  float length_m = 0, width_m = 0, height_m = 0;  ///< of its bounding box along x, y, z
};

/// Kinds of things beside the road: "tree" (broad-leaved), "young-tree" (thin, staked), "conifer",
/// "bush", "hedge" (2 m of it), "fence" (2 m of it: pickets), "wire-fence", "lamp", "pole" (wooden,
/// with arms for wires), "traffic-sign", "traffic-light", "street-name", "billboard", "kiosk",
/// "bin", "bollard", "bench", "bus-stop", "mailbox", "planter", "scaffolding" (6 m of it),
/// "container", "cone", "road-barrier", "gantry" (over 4 lanes), "guard-rail" (4 m of it),
/// "sound-wall" (4 m of it), "concrete-barrier" (4 m of it), "electric-box", "advertising-column".
/// Several variants of most; `variant` counts from 0 and wraps.
Model MakeProp(std::string_view kind, uint32_t variant);
uint32_t PropVariants(std::string_view kind);
std::vector<std::string_view> PropKinds();

/// Kinds of traffic: "hatchback", "saloon", "estate", "suv", "van", "lorry", "bus", "cyclist",
/// "pedestrian", "motorcycle". Pedestrians and cyclists have a pose in each variant (phases of a
/// step), so that they walk by changing variant.
Model MakeVehicle(std::string_view kind, uint32_t variant);
uint32_t VehicleVariants(std::string_view kind);

}  // namespace carmap
