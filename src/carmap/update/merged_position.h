// Where a landmark is that two maps have (paper §3.4).
//
// Pure and deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "carmap/index/reconstruct.h"
#include "carmap/solve/pose_refinement.h"
#include "carmap/update/landmark_pairs.h"

namespace carmap {

/// A landmark of both maps, and where both together put it.
struct MergedLandmark {
  LandmarkPair pair;
  Eigen::Vector3d position_in_base;
  double distance_m = 0;  ///< between where each map has it
};

/// Both positions weighted by what is known of them, of the pairs that may well be of one place, in
/// their order. `segment` lies in the base's frame.
std::vector<MergedLandmark> MergePositions(const ReconstructedMap& base,
                                           const ReconstructedMap& segment,
                                           const std::vector<LandmarkPair>& pairs,
                                           const MeasurementNoise& noise);

}  // namespace carmap
