// Pose of one stereo frame from landmarks of known position (motion-only bundle adjustment).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

/// Standard deviations of a measurement at pyramid level 0, in pixels; they grow with the level's
/// scale.
struct MeasurementNoise {
  double pixel_px = 0.25;      ///< of u and of v
  double disparity_px = 0.25;  ///< of u_left - u_right
};

/// A landmark and where the frame sees it.
struct PoseMeasurement {
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  Eigen::Vector2d px = Eigen::Vector2d::Zero();
  double disparity_px = -1;  ///< not positive: seen by the left camera only
  double scale = 1;          ///< of the feature's pyramid level
};

struct PoseEstimate {
  Rigid3 camera_from_map;
  std::vector<bool> is_inlier;  ///< one a measurement
  int inlier_count = 0;
  /// Inverse of the Gauss-Newton normal matrix at the solution over the inliers, in the tangent of
  /// Perturb (metres, radians). Zero if it could not be estimated.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Minimises the Huber-robust, noise-weighted errors of (u, v, disparity) by Gauss-Newton on the
/// tangent of Perturb, in rounds; after each, measurements outside the 95 % chi-square bound (of 2
/// or 3 degrees of freedom) or behind the camera count as outliers, and may come back in the next
/// round. The last round is without Huber. If fewer than three measurements agree, the initial pose
/// comes back without inliers. Measurements that are not finite count as outliers.
PoseEstimate RefinePose(const StereoRig& rig, const MeasurementNoise& noise,
                        const std::vector<PoseMeasurement>& measurements,
                        const Rigid3& initial_camera_from_map);

}  // namespace carmap
