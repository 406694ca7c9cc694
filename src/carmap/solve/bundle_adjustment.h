// Bundle adjustment: keyframe poses and landmark positions together (paper §2, error minimization),
// of a window or of a whole drive. Landmarks are eliminated (Schur complement); what is left is
// solved by blocks, as sparse as covisibility is.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/solve/pose_refinement.h"
#include "carmap/solve/position_prior.h"

namespace carmap {

struct BundleObservation {
  uint32_t pose_idx = 0, point_idx = 0;
  Eigen::Vector2d px = Eigen::Vector2d::Zero();
  double disparity_px = -1;  ///< as measured; not positive: seen by the left camera only
  double scale = 1;          ///< of the feature's pyramid level
};

/// The problem, and after AdjustBundle its solution.
struct Bundle {
  StereoRig rig;
  MeasurementNoise noise;
  std::vector<Rigid3> camera_from_map;  ///< poses
  std::vector<bool> pose_is_fixed;  ///< one a pose; at least one should be, unless there are priors
  std::vector<Eigen::Vector3d> points_in_map;
  std::vector<BundleObservation> observations;
  std::vector<PositionPrior> priors;  ///< robust, so that wrong fixes do not bend the map
};

struct BundleOptions {
  int robust_iterations = 5;            ///< with all observations
  int final_iterations = 8;             ///< after outliers were taken out
  double min_relative_decrease = 1e-4;  ///< of the cost; stops a phase early
  /// Also estimates the rig's disparity bias, starting at bundle.rig's: depths must agree with the
  /// motion wherever in the image a landmark is seen.
  bool estimate_disparity_bias = false;
  double bias_step_sigma_px = 0.1;  ///< how far its coefficients are expected to move
  double max_bias_px = 1;           ///< bound on each of its coefficients
  /// When it becomes true the best state so far is returned.
  const std::atomic<bool>* stop = nullptr;
};

struct BundleSummary {
  /// Half the sum of squared weighted residuals, Huber, over all observations (also the outliers).
  double initial_cost = 0, final_cost = 0;
  int iterations = 0;            ///< linear systems solved
  std::vector<bool> is_outlier;  ///< one an observation
};

/// Levenberg-Marquardt, Huber cost at the 95 % chi-square bounds. Observations of a point that ends
/// behind its camera count as outliers. Points without inlier observations stay where they were.
/// Throws std::invalid_argument when an index does not fit the bundle: a bug of the caller.
/// Deterministic: the same bundle gives the same bits.
BundleSummary AdjustBundle(Bundle& bundle, const BundleOptions& options = {});

}  // namespace carmap
