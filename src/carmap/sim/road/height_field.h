// The height of the ground: a smooth surface over the plane, through the roads.
//
// Twice differentiable everywhere, as roads are. Immutable, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace carmap {

/// Slopes beside a road, up and down: how high, and between which distances from centre lines.
struct GroundBanks {
  double height_m = 0, from_m = 0, to_m = 1;
};

class HeightField {
 public:
  /// `roads` are points on all roads, a few metres apart: far from them hills rise, which close
  /// the view. `heights` are positions on the ground along some of the roads; where there are
  /// none the ground rolls gently.
  HeightField(const std::vector<Eigen::Vector2d>& roads,
              const std::vector<Eigen::Vector3d>& heights, uint64_t seed,
              const GroundBanks& banks = {});

  double At(const Eigen::Vector2d& p_in_enu) const;
  /// Metres to the nearest road, by the cell of the grid.
  double RoadDistanceAt(const Eigen::Vector2d& p_in_enu) const;

  Eigen::Vector2d min_corner() const { return min_corner_; }
  Eigen::Vector2d max_corner() const;

 private:
  std::vector<double> RoadDistances(const std::vector<Eigen::Vector2d>& roads) const;
  void AddRoads(const std::vector<Eigen::Vector3d>& heights);
  void AddRolling(uint64_t seed);
  void AddHills(uint64_t seed);
  void AddBanks(uint64_t seed, const GroundBanks& banks);
  std::vector<double> Blurred(const std::vector<double>& grid, int radius) const;
  Eigen::Vector2d Centre(int column, int row) const;
  size_t Index(int column, int row) const;

  Eigen::Vector2d min_corner_;  ///< centre of the first cell
  int columns_ = 0, rows_ = 0;
  std::vector<float> heights_;         ///< control points of a cubic B-spline, row by row
  std::vector<float> road_distances_;  ///< by cell
};

}  // namespace carmap
