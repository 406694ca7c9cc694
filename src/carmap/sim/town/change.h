// What differs between two drives of the same world: things removed, things added, a lane closed.
//
// Written to and read from JSON, so that a change drawn from a seed can be edited and used again.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "carmap/sim/road/route.h"
#include "carmap/sim/town/world.h"

namespace carmap {

struct Change {
  enum class What : uint8_t { kRemoved, kAdded };
  What what = What::kRemoved;
  std::string name;  ///< of the object; added ones get "new-KIND-NNNNN"
  std::string kind;  ///< of models.h; a lane closure is many: cones, barriers, a lorry
  Eigen::Vector3d position_in_enu = Eigen::Vector3d::Zero();
  float heading_rad = 0;
  Eigen::Vector3f size_m = Eigen::Vector3f::Zero();  ///< bounding box along x, y, z of the model
};

/// About one change in 60 m of road, and one closed lane of 30 m in 500 m: billboards, kiosks and
/// trees go; scaffolding and containers come.
std::vector<Change> DrawChanges(const World& world, const Route& route, uint64_t seed);

/// Errors: NotFound for a removed object that the world has not (the message lists some that it
/// has), InvalidArgument for an unknown kind.
absl::Status ApplyChanges(const std::vector<Change>& changes, World& world);

nlohmann::ordered_json ToJson(const std::vector<Change>& changes);
/// `{"changes": [{"what": "removed", "name": …}, {"what": "added", "kind": …, "position_in_enu":
/// [x, y, z], "heading_rad": …}, …]}`. Errors: InvalidArgument naming the entry and what is wrong.
absl::StatusOr<std::vector<Change>> ChangesFromJson(const std::string& text);

}  // namespace carmap
