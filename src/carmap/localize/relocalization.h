// The pose of a frame anywhere in a map (paper §3.2).
//
// A GPS fix scopes the search to keyframes around it; they are ranked by how much of the frame they
// resemble and tried in this order. Pure and deterministic, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/map_neighbourhood.h"

namespace carmap {

struct RelocalizationOptions {
  TrackingOptions tracking;
  NeighbourhoodOptions neighbourhood;
  double gps_radius_m = 50;         ///< more than GPS errs between tall buildings
  size_t ranking_features = 300;    ///< of the frame, that rank candidates
  int max_ranking_bits = 50;        ///< between a feature and the landmark that it votes for
  size_t max_candidates = 8;        ///< tried; places, not keyframes side by side
  size_t covisible_neighbours = 5;  ///< whose landmarks are tried with a candidate's
  double position_radius_px = 60;  ///< search window when the frame is taken to stand at a keyframe
  int min_inliers = 30;            ///< fewer are no pose: nothing else speaks for it
  /// A pose with fewer may sit where only distant landmarks agree: others compete with it.
  size_t sure_inliers = 80;
};

/// Indices of features that stand for the frame: evenly spread over the extraction order, hence
/// over levels.
std::vector<uint32_t> SampleFeatures(size_t feature_count, size_t max_count);

/// Keyframes where the frame can have been taken: near the fix, nearest first, then those without a
/// place on the Earth; all if there is no fix or the map has none.
std::vector<uint32_t> CandidateKeyframes(const ReconstructedMap& map,
                                         const std::optional<GpsFix>& gps, double gps_radius_m);

/// Tracks in the landmarks around a pose that may be some metres off, and from there again until it
/// stays: a pose far from where landmarks were looked for was found with those that happened to lie
/// in the windows there.
std::optional<TrackedPose> TrackAround(const ReconstructedMap& map, const FeatureGrid& grid,
                                       const StereoRig& rig, Rigid3 camera_from_map,
                                       TrackingOptions tracking,
                                       const NeighbourhoodOptions& neighbourhood);

/// The first sure pose, or else the one with most inliers. Nothing if no candidate convinces.
std::optional<TrackedPose> Relocalize(const ReconstructedMap& map, const FeatureGrid& grid,
                                      const StereoRig& rig, const std::optional<GpsFix>& gps,
                                      const RelocalizationOptions& options = {});

}  // namespace carmap
