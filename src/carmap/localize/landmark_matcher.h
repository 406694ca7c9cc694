// Matching of a frame's features with landmarks of a map (paper §3.2).
//
// Robust matching goes by position first, appearance second: what lies where a landmark must appear
// is compared with its signature. Appearance-only matching is for a frame whose pose is unknown.
// All functions are pure and thread-safe.
#pragma once

#include <cstdint>
#include <vector>

#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct LandmarkMatch {
  uint32_t landmark_idx = 0;  ///< into MapSnapshot::landmarks
  uint32_t feature_idx = 0;
};

struct ProjectionMatchOptions {
  /// Half the side of the search window at level 0; grows with the level's scale.
  double radius_px = 4;
  /// What is not known of the camera's place, metres: the window of a landmark is as much larger as
  /// this makes at its distance.
  double position_radius_m = 0;
  int max_distance_bits = 38;  ///< of the signatures
  double max_ratio = 0.8;      ///< to the best at another place in the window
  double max_level_difference = 1.6;
  /// Between the landmark's mean viewing direction and this one.
  double max_viewing_angle_rad = 1.2;
};

/// Whether a camera there must see the landmark unless something hides it: within the image, from a
/// distance and a direction from which it can be recognised.
bool IsInSight(const SnapshotLandmark& landmark, const StereoRig& rig,
               const Rigid3& camera_from_map, const ProjectionMatchOptions& options = {});

/// Landmarks (those of `landmark_idxs`) matched with features near their projections, at the
/// pyramid level that their distance predicts, with a disparity that agrees. A corner of the frame,
/// at whatever levels it was found, goes to the landmark that resembles it most.
std::vector<LandmarkMatch> MatchByProjection(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const Rigid3& camera_from_map,
                                             const ProjectionMatchOptions& options);

struct AppearanceMatchOptions {
  int max_distance_bits = 38;
  double max_ratio = 0.8;  ///< to the best feature at another place
};

/// Landmarks matched with features anywhere in the image, each with the one nearest in appearance;
/// a corner goes to the landmark that resembles it most.
std::vector<LandmarkMatch> MatchByAppearance(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const std::vector<Feature>& features,
                                             const AppearanceMatchOptions& options = {});

/// What RefinePose and SolvePnpRansac take, in the order of the matches.
std::vector<PoseMeasurement> MeasurementsOf(const MapSnapshot& map,
                                            const std::vector<Feature>& features,
                                            const StereoRig& rig,
                                            const std::vector<LandmarkMatch>& matches);

}  // namespace carmap
