// What a GPS fix says about a pose: where its camera is, if the fix can be trusted.
//
// The loss is Geman and McClure's: it levels off, so that a fix tens of standard deviations away
// pulls no more than one that is not there. Plain functions; safe from any thread.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "carmap/geometry/rigid3.h"
#include "carmap/solve/reprojection.h"

namespace carmap {

struct PositionPrior {
  uint32_t pose_idx = 0;
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();  ///< of the camera's centre
  /// Turns an error in the map's frame, metres, into standard deviations.
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();
  /// Less than 1 where many priors share one error, as fixes of a minute do: together they must not
  /// pass for as many independent ones.
  double weight = 1;
};

/// Squared error at which a fix has lost three quarters of its weight: three standard deviations.
inline constexpr double kPriorSquareScale = 9;

/// In standard deviations, (estimated - measured).
inline Eigen::Vector3d PriorError(const PositionPrior& prior, const Rigid3& camera_from_map) {
  return prior.sqrt_information * (camera_from_map.Inverse().translation - prior.position_in_map);
}

/// Adds the prior to the normal equations of its pose. A turn of the camera does not move its
/// centre. `robust_weight` is the loss's.
inline void AddPrior(const PositionPrior& prior, const Rigid3& camera_from_map,
                     double robust_weight, Matrix6d& hessian, Vector6d& gradient) {
  const double weight = prior.weight * robust_weight;
  const Eigen::Matrix3d jacobian =
      -prior.sqrt_information * camera_from_map.rotation.conjugate().toRotationMatrix();
  hessian.topLeftCorner<3, 3>() += weight * jacobian.transpose() * jacobian;
  gradient.head<3>() += weight * jacobian.transpose() * PriorError(prior, camera_from_map);
}

}  // namespace carmap
