// Which parts of the ground are taken, by rectangles of any direction.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace carmap {

struct GroundBox {
  Eigen::Vector2d centre_in_enu = Eigen::Vector2d::Zero();
  double heading_rad = 0;
  double half_length_m = 0, half_width_m = 0;

  Eigen::Vector2d Forward() const;
  /// At shares of the half sizes, -1..1.
  Eigen::Vector2d At(double forward, double left) const;
  GroundBox Grown(double margin_m) const { return Grown(margin_m, margin_m); }
  GroundBox Grown(double ahead_and_behind_m, double aside_m) const;
};

bool Overlap(const GroundBox& a, const GroundBox& b);

class Occupancy {
 public:
  void Add(const GroundBox& box);
  bool IsFree(const GroundBox& box) const;

 private:
  std::vector<GroundBox> boxes_;
  std::unordered_map<uint64_t, std::vector<uint32_t>> cells_;  ///< looked up only
};

}  // namespace carmap
