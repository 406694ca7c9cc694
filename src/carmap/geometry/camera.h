// Rectified cameras: one pinhole camera, and a stereo pair of them.
//
// Camera frame: x right, y down, z forward. Image: u right, v down, pixel centres at whole numbers.
// Plain values.
#pragma once

#include <Eigen/Core>

namespace carmap {

struct PinholeCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  int width = 0, height = 0;              ///< pixels
  bool operator==(const PinholeCamera&) const = default;

  /// Needs p.z() > 0.
  Eigen::Vector2d Project(const Eigen::Vector3d& p_in_camera) const {
    return {fx * p_in_camera.x() / p_in_camera.z() + cx,
            fy * p_in_camera.y() / p_in_camera.z() + cy};
  }
  Eigen::Vector3d Unproject(const Eigen::Vector2d& px, double depth_m) const {
    return {(px.x() - cx) / fx * depth_m, (px.y() - cy) / fy * depth_m, depth_m};
  }
  bool Contains(const Eigen::Vector2d& px) const {
    return px.x() >= 0 && px.y() >= 0 && px.x() <= width - 1 && px.y() <= height - 1;
  }
};

/// What is left of lens distortion after rectification, as far as it bends depths: a disparity is
/// measured too large by a quadratic in x = (u - cx) / fx. Zero for a perfect rig.
struct DisparityBias {
  Eigen::Vector3d coefficients_px = Eigen::Vector3d::Zero();  ///< of 1, x and x²
  bool operator==(const DisparityBias&) const = default;

  double At(double x) const { return coefficients_px.dot(Eigen::Vector3d(1, x, x * x)); }
};

/// Two equal, row-aligned cameras; the right one stands `baseline_m` along x of the left one.
struct StereoRig {
  PinholeCamera camera;
  double baseline_m = 0;
  DisparityBias disparity_bias;
  bool operator==(const StereoRig&) const = default;

  /// Disparity = u_left - u_right of a point at this depth.
  double DisparityAt(double depth_m) const { return camera.fx * baseline_m / depth_m; }
  double DepthAt(double disparity_px) const { return camera.fx * baseline_m / disparity_px; }
  /// The disparity that a perfect rig would have measured at this column.
  double WithoutBias(double u_px, double measured_disparity_px) const {
    return measured_disparity_px - disparity_bias.At((u_px - camera.cx) / camera.fx);
  }
  /// (u, v, disparity without bias). Needs p.z() > 0.
  Eigen::Vector3d Project(const Eigen::Vector3d& p_in_camera) const {
    const Eigen::Vector2d px = camera.Project(p_in_camera);
    return {px.x(), px.y(), DisparityAt(p_in_camera.z())};
  }
  /// Needs a disparity without bias > 0.
  Eigen::Vector3d Triangulate(const Eigen::Vector2d& px, double disparity_px) const {
    return camera.Unproject(px, DepthAt(disparity_px));
  }
};

/// d(u, v, disparity) / d(p_in_camera).
inline Eigen::Matrix3d StereoProjectionJacobian(const StereoRig& rig, const Eigen::Vector3d& p) {
  const PinholeCamera& camera = rig.camera;
  const double inverse_z = 1 / p.z(), inverse_z2 = inverse_z * inverse_z;
  Eigen::Matrix3d jacobian;
  jacobian << camera.fx * inverse_z, 0, -camera.fx * p.x() * inverse_z2,  //
      0, camera.fy * inverse_z, -camera.fy * p.y() * inverse_z2,          //
      0, 0, -camera.fx * rig.baseline_m * inverse_z2;
  return jacobian;
}

}  // namespace carmap
