// Landmarks of two maps that are one corner of the world.
//
// Pure and deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/index/reconstruct.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct LandmarkPair {
  uint32_t base_idx = 0, segment_idx = 0;
  auto operator<=>(const LandmarkPair&) const = default;
};

/// Of the matches of all keyframes, those that are the most frequent one of both landmarks: one
/// that keyframes match with another more often is another corner. Ascending; each landmark in at
/// most one, of equally frequent ones the first.
std::vector<LandmarkPair> MostFrequent(std::vector<LandmarkPair> matches, size_t base_count,
                                       size_t segment_count);

/// Uncertainty of a landmark's position as its stereo views leave it: small across the line of
/// sight, growing with the square of the distance along it. Views of one drive share its errors,
/// drives do not; all drives that saw it count, whether the map keeps their keyframes or not.
Eigen::Matrix3d LandmarkCovariance(const ReconstructedMap& map, uint32_t landmark_idx,
                                   const MeasurementNoise& noise);

}  // namespace carmap
