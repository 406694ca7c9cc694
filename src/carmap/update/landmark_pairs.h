// Landmarks of two maps that are one corner of the world, and the transform that they give.
//
// Pure and deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct LandmarkPair {
  uint32_t base_idx = 0, segment_idx = 0;
  auto operator<=>(const LandmarkPair&) const = default;
};

/// A point known in both maps, with the covariance of each position in its own map.
struct PointPair {
  Eigen::Vector3d p_in_base, p_in_segment;
  Eigen::Matrix3d base_covariance, segment_covariance;
};

/// Uncertainty of a landmark's position as its stereo views leave it: small across the line of
/// sight, growing with the square of the distance along it.
Eigen::Matrix3d LandmarkCovariance(const ReconstructedMap& map, uint32_t landmark_idx,
                                   const MeasurementNoise& noise);

std::vector<PointPair> PointsOf(const ReconstructedMap& base, const ReconstructedMap& segment,
                                const std::vector<LandmarkPair>& pairs,
                                const MeasurementNoise& noise);

struct PairAlignment {
  Rigid3 base_from_segment;
  std::vector<bool> is_inlier;  ///< one a pair: within its uncertainty at 99 %
  int inlier_count = 0;
};

/// Minimises the distances of the pairs, each weighted by its uncertainty, robustly: Gauss-Newton
/// with Huber's loss, then on the inliers alone. Nothing if the pairs do not determine a transform.
std::optional<PairAlignment> AlignPairs(const std::vector<PointPair>& pairs,
                                        const Rigid3& initial_base_from_segment);

}  // namespace carmap
