// Where a vehicle or a person would run into something that stands in the world: poles, trunks,
// barriers, parked cars. Seen from above, in cells of 0.2 m; what is higher than a tall person or
// lower than a step is no obstacle. Safe to read from many threads.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_set>

#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/town/world.h"

namespace carmap {

class ObstacleMap {
 public:
  ObstacleMap() = default;
  /// Of the world's objects (not its tiles).
  explicit ObstacleMap(const World& world);

  void Add(const GroundBox& box);
  bool IsBlocked(const Eigen::Vector2d& p_in_enu) const;
  /// How far a thing whose middle follows a line may reach to both sides at this place of it;
  /// `max_m` where it is free so far. `heading_rad` is the line's.
  double FreeHalfWidth(const Eigen::Vector2d& p_in_enu, double heading_rad, double max_m) const;

 private:
  static constexpr double kCellM = 0.2;
  void AddPoint(const Eigen::Vector2d& p_in_enu);
  static uint64_t KeyOf(const Eigen::Vector2d& p_in_enu);

  std::unordered_set<uint64_t> cells_;  // looked up, never iterated
};

}  // namespace carmap
