#include "carmap/update/merged_position.h"

#include <Eigen/LU>

namespace carmap {
namespace {

/// Nothing if they are not of one place.
std::optional<MergedLandmark> MergePosition(const ReconstructedMap& base,
                                            const ReconstructedMap& segment,
                                            const LandmarkPair& pair,
                                            const MeasurementNoise& noise) {
  constexpr double kFitSigmaM = 0.05;         // of the bent segment, common to its landmarks there
  constexpr double kChiSquareBound = 16.266;  // 99.9 %, three degrees of freedom
  const Eigen::Matrix3d by_base = LandmarkCovariance(base, pair.base_idx, noise);
  Eigen::Matrix3d by_segment = LandmarkCovariance(segment, pair.segment_idx, noise);
  by_segment.diagonal().array() += kFitSigmaM * kFitSigmaM;
  const Eigen::Vector3d& p_by_base = base.snapshot.landmarks[pair.base_idx].position_in_map;
  const Eigen::Vector3d difference =
      segment.snapshot.landmarks[pair.segment_idx].position_in_map - p_by_base;
  const Eigen::Vector3d weighted = (by_base + by_segment).inverse() * difference;
  if (difference.dot(weighted) > kChiSquareBound) return std::nullopt;
  return MergedLandmark{pair, p_by_base + by_base * weighted, difference.norm()};
}

}  // namespace

std::vector<MergedLandmark> MergePositions(const ReconstructedMap& base,
                                           const ReconstructedMap& segment,
                                           const std::vector<LandmarkPair>& pairs,
                                           const MeasurementNoise& noise) {
  std::vector<MergedLandmark> merged;
  for (const LandmarkPair& pair : pairs) {
    if (const auto landmark = MergePosition(base, segment, pair, noise)) {
      merged.push_back(*landmark);
    }
  }
  return merged;
}

}  // namespace carmap
