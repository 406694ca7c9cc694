#include "carmap/localize/frame_tracking.h"

#include <cmath>

#include "carmap/solve/pnp.h"

namespace carmap {
namespace {

/// A predicted pose is usually off by less than a fourth of the window that it is given.
constexpr double kErrorByRadius = 0.25;

struct MatchedPose {
  PoseEstimate estimate;
  std::vector<LandmarkMatch> matches;
};

MatchedPose MatchAndRefine(const MapSnapshot& map, const std::vector<uint32_t>& landmark_idxs,
                           const FeatureGrid& grid, const StereoRig& rig,
                           const Rigid3& camera_from_map, double radius_px,
                           const MeasurementNoise& noise) {
  MatchedPose result;
  result.matches =
      MatchByProjection(map, landmark_idxs, grid, rig, camera_from_map, {.radius_px = radius_px});
  result.estimate =
      RefinePose(rig, noise, MeasurementsOf(map, grid.features(), rig, result.matches),
                 camera_from_map, kErrorByRadius * radius_px);
  return result;
}

}  // namespace

std::optional<TrackedPose> TrackByProjection(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const Rigid3& predicted_camera_from_map,
                                             const TrackingOptions& options) {
  const MatchedPose first = MatchAndRefine(map, landmark_idxs, grid, rig, predicted_camera_from_map,
                                           options.first_radius_px, options.noise);
  if (first.estimate.inlier_count < options.min_inliers) return std::nullopt;
  const MatchedPose final =
      MatchAndRefine(map, landmark_idxs, grid, rig, first.estimate.camera_from_map,
                     options.final_radius_px, options.noise);
  if (final.estimate.inlier_count < options.min_inliers) return std::nullopt;

  TrackedPose tracked{final.estimate.camera_from_map, {}, final.estimate.covariance};
  for (size_t i = 0; i < final.matches.size(); ++i) {
    if (final.estimate.is_inlier[i]) tracked.inliers.push_back(final.matches[i]);
  }
  return tracked;
}

std::optional<TrackedPose> TrackByAppearance(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const TrackingOptions& options, uint64_t seed) {
  const auto matches = MatchByAppearance(map, landmark_idxs, grid.features());
  PnpOptions pnp;
  pnp.seed = seed;
  const auto pose =
      SolvePnpRansac(rig, options.noise, MeasurementsOf(map, grid.features(), rig, matches), pnp);
  if (!pose) return std::nullopt;
  return TrackByProjection(map, landmark_idxs, grid, rig, pose->camera_from_map, options);
}

double SigmaM(const Eigen::Matrix<double, 6, 6>& covariance) {
  return std::sqrt(covariance.topLeftCorner<3, 3>().trace() / 3);
}
double SigmaRad(const Eigen::Matrix<double, 6, 6>& covariance) {
  return std::sqrt(covariance.bottomRightCorner<3, 3>().trace() / 3);
}

Eigen::Matrix<double, 6, 6> WithSharedErrors(const Eigen::Matrix<double, 6, 6>& covariance) {
  constexpr double kFactor = 25, kFloorM = 0.1, kFloorRad = 0.004;
  Eigen::Matrix<double, 6, 6> result = kFactor * covariance;
  result.diagonal().head<3>().array() += kFloorM * kFloorM;
  result.diagonal().tail<3>().array() += kFloorRad * kFloorRad;
  return result;
}

}  // namespace carmap
