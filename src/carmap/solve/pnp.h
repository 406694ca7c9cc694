// Pose of a frame from matches of which many may be wrong: P3P, or the alignment of three points
// where stereo sees them, in a RANSAC loop.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct PnpOptions {
  int max_iterations = 300;
  double confidence = 0.999;  ///< stop when a better sample is less likely than 1 - this
  double inlier_px = 3;       ///< reprojection bound at level 0, grows with the level's scale; the
                              ///< disparity, where there is one, must agree within the same bound
  int min_inliers = 12;
  /// Where down is in the map, unit length, if that is known: cars are upright.
  std::optional<Eigen::Vector3d> down_in_map = std::nullopt;
  double max_tilt_rad = 0.4;  ///< of the camera's y axis against it
  uint64_t seed = 1;
};

/// The pose with most inliers, refined on them by RefinePose; nothing when fewer than min_inliers
/// agree.
std::optional<PoseEstimate> SolvePnpRansac(const StereoRig& rig, const MeasurementNoise& noise,
                                           const std::vector<PoseMeasurement>& measurements,
                                           const PnpOptions& options = {});

}  // namespace carmap
