// The error of a measured (u, v, disparity) against a point in the camera's frame, in standard
// deviations, with its derivatives, and the robust losses of all solvers.
//
// Plain functions; safe from any thread.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// 95 % bounds of the chi-square distribution with two and three degrees of freedom.
inline constexpr double kChiSquareBound2 = 5.991, kChiSquareBound3 = 7.815;

/// Squared error that a measurement counts with whose point cannot be projected: a thousand
/// standard deviations, so that no step gains by moving a point behind its camera.
inline constexpr double kInvisibleChiSquare = 1e6;

/// A measurement with the weights that turn its error into standard deviations. A missing disparity
/// has weight zero.
struct WhitenedMeasurement {
  Eigen::Vector3d uvd = Eigen::Vector3d::Zero();
  Eigen::Vector3d inverse_sigma = Eigen::Vector3d::Zero();
  double chi_square_bound = kChiSquareBound2;
};

inline WhitenedMeasurement Whiten(const MeasurementNoise& noise, const Eigen::Vector2d& px,
                                  double disparity_px, double scale) {
  const double pixel_weight = 1 / (noise.pixel_px * scale);
  if (disparity_px > 0) {
    return {{px.x(), px.y(), disparity_px},
            {pixel_weight, pixel_weight, 1 / (noise.disparity_px * scale)},
            kChiSquareBound3};
  }
  return {{px.x(), px.y(), 0}, {pixel_weight, pixel_weight, 0}, kChiSquareBound2};
}

inline WhitenedMeasurement Whiten(const MeasurementNoise& noise, const PoseMeasurement& m) {
  WhitenedMeasurement whitened = Whiten(noise, m.px, m.disparity_px, m.scale);
  for (int i = 0; i < 3; ++i) {
    double& weight = whitened.inverse_sigma[i];
    if (weight > 0) weight = 1 / std::hypot(1 / weight, m.landmark_sigma_px[i]);
  }
  return whitened;
}

/// Error in standard deviations, (projected - measured). False, and the error undefined, when the
/// point is behind the camera or a number is not finite.
inline bool WhitenedError(const StereoRig& rig, const WhitenedMeasurement& measurement,
                          const Eigen::Vector3d& p_in_camera, Eigen::Vector3d& error) {
  constexpr double kMinDepthM = 1e-3;
  if (!(p_in_camera.z() > kMinDepthM)) return false;
  error = (rig.Project(p_in_camera) - measurement.uvd).cwiseProduct(measurement.inverse_sigma);
  return std::isfinite(error.squaredNorm());
}

/// Whether the measurement agrees with the point, at 95 %.
inline bool IsInlier(const StereoRig& rig, const WhitenedMeasurement& measurement,
                     const Eigen::Vector3d& p_in_camera) {
  Eigen::Vector3d error;
  return WhitenedError(rig, measurement, p_in_camera, error) &&
         error.squaredNorm() <= measurement.chi_square_bound;
}

/// d WhitenedError / d p_in_camera.
inline Eigen::Matrix3d WhitenedErrorJacobian(const StereoRig& rig,
                                             const WhitenedMeasurement& measurement,
                                             const Eigen::Vector3d& p_in_camera) {
  return measurement.inverse_sigma.asDiagonal() * StereoProjectionJacobian(rig, p_in_camera);
}

/// Huber's loss of a squared error: quadratic up to the bound, then linear in the error.
inline double HuberCost(double chi_square, double bound) {
  return chi_square <= bound ? chi_square / 2 : std::sqrt(bound * chi_square) - bound / 2;
}
/// Factor on the squared error that gives Huber's gradient.
inline double HuberWeight(double chi_square, double bound) {
  return chi_square <= bound ? 1 : std::sqrt(bound / chi_square);
}

inline constexpr double kNotRobust = std::numeric_limits<double>::infinity();

/// Geman and McClure's loss of a squared error: levels off at half of `square_scale`, so that what
/// is far off hardly pulls. With the scale kNotRobust, half the squared error.
inline double GemanMcClureCost(double chi_square, double square_scale) {
  return chi_square / (1 + chi_square / square_scale) / 2;
}
/// Factor on the squared error that gives its gradient.
inline double GemanMcClureWeight(double chi_square, double square_scale) {
  const double ratio = 1 / (1 + chi_square / square_scale);
  return ratio * ratio;
}

/// One measurement's part of the normal equations in its point's position in the camera.
struct PointTerm {
  Eigen::Matrix3d hessian;
  Eigen::Vector3d gradient;
};

/// J^T J and J^T error of J = WhitenedErrorJacobian, whose zeros are left out: this and what
/// follows runs once an observation and iteration.
inline PointTerm MakePointTerm(const StereoRig& rig, const WhitenedMeasurement& measurement,
                               const Eigen::Vector3d& p_in_camera, const Eigen::Vector3d& error,
                               double weight) {
  const double inverse_z = 1 / p_in_camera.z();
  const double u_x = measurement.inverse_sigma.x() * rig.camera.fx * inverse_z;
  const double v_y = measurement.inverse_sigma.y() * rig.camera.fy * inverse_z;
  const double u_z = -u_x * p_in_camera.x() * inverse_z;
  const double v_z = -v_y * p_in_camera.y() * inverse_z;
  const double d_z =
      -measurement.inverse_sigma.z() * rig.camera.fx * rig.baseline_m * inverse_z * inverse_z;
  const Eigen::Vector3d e = weight * error;
  const double xx = weight * u_x * u_x, yy = weight * v_y * v_y;
  const double xz = weight * u_x * u_z, yz = weight * v_y * v_z;
  const double zz = weight * (u_z * u_z + v_z * v_z + d_z * d_z);
  PointTerm term;
  term.hessian << xx, 0, xz, 0, yy, yz, xz, yz, zz;
  term.gradient << u_x * e.x(), v_y * e.y(), u_z * e.x() + v_z * e.y() + d_z * e.z();
  return term;
}

/// The tangent that leads from one pose to another: b = Perturb(a, PoseDifference(a, b)).
inline Vector6d PoseDifference(const Rigid3& a, const Rigid3& b) {
  const Eigen::AngleAxisd turn((b.rotation * a.rotation.conjugate()).normalized());
  Vector6d difference;
  difference << b.translation - turn * a.translation, turn.angle() * turn.axis();
  return difference;
}

/// How a perturbation of `a` shows after the motion: Perturb(m * a) = m * Perturb(a).
inline Matrix6d AdjointOf(const Rigid3& motion) {
  const Eigen::Matrix3d rotation = motion.rotation.toRotationMatrix();
  Matrix6d adjoint = Matrix6d::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = rotation;
  adjoint.topRightCorner<3, 3>() = CrossMatrix(motion.translation) * rotation;
  return adjoint;
}

/// [p]x m.
inline Eigen::Matrix3d CrossColumns(const Eigen::Vector3d& p, const Eigen::Matrix3d& m) {
  Eigen::Matrix3d result;
  for (int c = 0; c < 3; ++c) result.col(c) = p.cross(m.col(c));
  return result;
}

/// Normal equations of one pose in the tangent of Perturb. Only the blocks of the lower triangle of
/// the Hessian are filled.
struct PoseNormal {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();

  /// Since d p_in_camera / d delta = [I, -[p]x], a point's term spreads to the blocks
  /// H, [p]x H and [p]x H [p]x^T = [p]x ([p]x H)^T.
  void Add(const PointTerm& term, const Eigen::Vector3d& p_in_camera) {
    const Eigen::Matrix3d turned = CrossColumns(p_in_camera, term.hessian);
    hessian.topLeftCorner<3, 3>() += term.hessian;
    hessian.bottomLeftCorner<3, 3>() += turned;
    hessian.bottomRightCorner<3, 3>() += CrossColumns(p_in_camera, turned.transpose());
    gradient.head<3>() += term.gradient;
    gradient.tail<3>() += p_in_camera.cross(term.gradient);
  }
};

}  // namespace carmap
