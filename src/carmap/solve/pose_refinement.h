// Pose of one stereo frame from landmarks of known position (motion-only bundle adjustment).
#pragma once

#include <Eigen/Core>
#include <optional>
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
  /// What the landmark's own uncertainty adds to (u, v, disparity): standard deviations, pixels.
  Eigen::Vector3d landmark_sigma_px = Eigen::Vector3d::Zero();
};

/// What is known of a pose beforehand.
struct PosePrior {
  Rigid3 camera_from_map;
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();  ///< of Perturb
};

struct PoseEstimate {
  Rigid3 camera_from_map;
  std::vector<bool> is_inlier;  ///< one a measurement
  int inlier_count = 0;
  /// Inverse of the Gauss-Newton normal matrix at the solution over the inliers, in the tangent of
  /// Perturb (metres, radians). Zero if it could not be estimated.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Where most measurements are when the initial pose is a good prediction, in pixels at pyramid
/// level 0 around the projected landmarks.
inline constexpr double kInitialErrorPx = 3;

/// Minimises the noise-weighted errors of (u, v, disparity) on the tangent of Perturb with Geman
/// and McClure's loss, which is as wide as `initial_error_px` at first and narrows to twice the
/// chi-square bound (95 %, 2 or 3 degrees of freedom): graduated non-convexity (Blake and Zisserman
/// 1987). A lorry that drives by, with most of the measurements on it, so does not draw the pose
/// from where it should be. Then once without a robust loss over what is within the bounds; what is
/// outside in the end, behind the camera or not finite is an outlier. If fewer than three
/// measurements agree, the initial pose comes back without inliers. A prior counts like
/// measurements that are right.
PoseEstimate RefinePose(const StereoRig& rig, const MeasurementNoise& noise,
                        const std::vector<PoseMeasurement>& measurements,
                        const Rigid3& initial_camera_from_map,
                        double initial_error_px = kInitialErrorPx,
                        const std::optional<PosePrior>& prior = std::nullopt);

}  // namespace carmap
