// The pose of one frame in a map around which it is roughly known (paper §2, pose estimation).
//
// Shared by the vehicle's tracker (in the map it builds) and the localizer (in a given map).
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct TrackingOptions {
  MeasurementNoise noise;
  double first_radius_px = 12;  ///< search window while the pose is a prediction
  double final_radius_px = 4;   ///< once it is refined
  int min_inliers = 20;         ///< fewer matches that agree are no pose
};

/// A frame's pose and the landmarks that agree with it.
struct TrackedPose {
  Rigid3 camera_from_map;
  std::vector<LandmarkMatch> inliers;
  /// Of the pose, see PoseEstimate.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// Matches landmarks around their projections from `predicted`, refines the pose, and repeats both
/// in a narrower window. Nothing if too few matches agree.
std::optional<TrackedPose> TrackByProjection(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const Rigid3& predicted_camera_from_map,
                                             const TrackingOptions& options);

/// Without a prediction: matches by appearance, PnP with RANSAC (§3.2), then TrackByProjection.
std::optional<TrackedPose> TrackByAppearance(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const TrackingOptions& options, uint64_t seed);

/// Root mean square of the standard deviations along the axes of a pose's covariance, in metres,
/// and about them, in radians.
double SigmaM(const Eigen::Matrix<double, 6, 6>& covariance);
double SigmaRad(const Eigen::Matrix<double, 6, 6>& covariance);

/// How far a pose found in a single frame may truly be off, of its TrackedPose::covariance, which
/// knows nothing of the errors that its landmarks share.
Eigen::Matrix<double, 6, 6> WithSharedErrors(const Eigen::Matrix<double, 6, 6>& covariance);

}  // namespace carmap
