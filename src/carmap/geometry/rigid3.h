// Rigid transforms in space and their tangent space.
//
// Named `b_from_a`: maps coordinates in frame a to coordinates in frame b. Plain values.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace carmap {

struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< unit length
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();         ///< metres

  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
  Rigid3 operator*(const Rigid3& other) const {
    return {(rotation * other.rotation).normalized(), rotation * other.translation + translation};
  }
};

/// Whether the numbers are finite and the rotation is one.
inline bool IsRigid(const Rigid3& transform) {
  constexpr double kUnitTolerance = 1e-6;
  return transform.translation.allFinite() &&
         std::abs(transform.rotation.norm() - 1) <= kUnitTolerance;
}

/// [w]x such that [w]x v = w × v.
inline Eigen::Matrix3d CrossMatrix(const Eigen::Vector3d& w) {
  Eigen::Matrix3d m;
  m << 0, -w.z(), w.y(), w.z(), 0, -w.x(), -w.y(), w.x(), 0;
  return m;
}

/// Rotation by |w| radians about w.
inline Eigen::Quaterniond RotationExp(const Eigen::Vector3d& w) {
  const double angle = w.norm();
  if (angle < 1e-12) return Eigen::Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2).normalized();
  return Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle));
}

/// Angle in radians, 0..pi, of the rotation.
inline double RotationAngle(const Eigen::Quaterniond& q) {
  return 2 * std::atan2(q.vec().norm(), std::abs(q.w()));
}

/// Left perturbation: first turned by `delta.tail<3>()` (radians, in b), then moved by
/// `delta.head<3>()` (metres, in b). The tangent of every pose optimisation in carmap.
inline Rigid3 Perturb(const Rigid3& b_from_a, const Eigen::Matrix<double, 6, 1>& delta) {
  const Eigen::Quaterniond turn = RotationExp(delta.tail<3>());
  return {(turn * b_from_a.rotation).normalized(), turn * b_from_a.translation + delta.head<3>()};
}

}  // namespace carmap
