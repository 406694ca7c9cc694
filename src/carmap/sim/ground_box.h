// The outline of a vehicle on the ground, seen from above. Plain values.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace carmap {

struct GroundBox {
  Eigen::Vector2d centre_in_enu = Eigen::Vector2d::Zero();
  double heading_rad = 0;
  double half_length_m = 0, half_width_m = 0;

  Eigen::Vector2d Forward() const { return {std::cos(heading_rad), std::sin(heading_rad)}; }
  GroundBox GrownBy(double ahead_and_behind_m, double aside_m) const {
    return {centre_in_enu, heading_rad, half_length_m + ahead_and_behind_m, half_width_m + aside_m};
  }
};

/// Half the extent of the box along a direction of unit length.
inline double HalfExtent(const GroundBox& box, const Eigen::Vector2d& direction) {
  const Eigen::Vector2d forward = box.Forward(), left(-forward.y(), forward.x());
  return box.half_length_m * std::abs(forward.dot(direction)) +
         box.half_width_m * std::abs(left.dot(direction));
}

/// By the separating axes: convex shapes are apart if they are along one of their sides' normals.
inline bool Overlap(const GroundBox& a, const GroundBox& b) {
  const Eigen::Vector2d between = b.centre_in_enu - a.centre_in_enu;
  const double reach =
      std::hypot(a.half_length_m, a.half_width_m) + std::hypot(b.half_length_m, b.half_width_m);
  if (between.squaredNorm() > reach * reach) return false;
  for (const GroundBox* box : {&a, &b}) {
    const Eigen::Vector2d forward = box->Forward(), left(-forward.y(), forward.x());
    for (const Eigen::Vector2d& axis : {forward, left}) {
      if (std::abs(between.dot(axis)) > HalfExtent(a, axis) + HalfExtent(b, axis)) return false;
    }
  }
  return true;
}

}  // namespace carmap
