// How well a base map follows a street that changed: what of vanished and of new things it holds,
// and what it lost of what still stands.
//
// Against the truth of a simulated drive, which tells in its world.json what was changed in its
// world. Pure but for reading, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// A thing that was removed or added: a box that stands upright.
struct ChangedThing {
  std::string name;
  bool is_added = false;  ///< else it was removed
  Eigen::Vector3d foot_in_world = Eigen::Vector3d::Zero();
  double heading_rad = 0;
  Eigen::Vector3d size_m = Eigen::Vector3d::Zero();  ///< along its heading, across, up
};

/// Of the drive's world.json; none where it has no changes. Errors: NotFound without such a file,
/// InvalidArgument for one that is none.
absl::StatusOr<std::vector<ChangedThing>> ReadChangedThings(const std::filesystem::path& drive);

/// Whether the place is in the thing, or so near to it.
bool IsOn(const ChangedThing& thing, const Eigen::Vector3d& p_in_world, double near_m);

/// A map, and where in the world it lies.
struct PlacedMap {
  const LeanMap& map;
  Rigid3 world_from_map;
};

struct ThingScore {
  std::string name;
  bool is_added = false;
  size_t before = 0;  ///< landmarks on it before
  size_t after =
      0;  ///< of a removed one: of these, that are still there; of an added one: new ones
  size_t fresh = 0;  ///< on an added one, in a map made afterwards
};

struct StreetChangeScore {
  std::vector<ThingScore> things;
  size_t standing = 0;       ///< landmarks before that are on nothing that was removed
  size_t standing_lost = 0;  ///< of these, that are not there after

  /// Of all removed things together.
  size_t removed_before() const;
  size_t removed_left() const;
};

/// `before` and `after` are two states of one base, whose landmarks keep their names. `fresh` may
/// be empty.
StreetChangeScore ScoreStreetChanges(const std::vector<ChangedThing>& things,
                                     const PlacedMap& before, const PlacedMap& after,
                                     const std::vector<PlacedMap>& fresh);

}  // namespace carmap
