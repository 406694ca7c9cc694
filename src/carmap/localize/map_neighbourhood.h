// The part of a map that a camera can see from about where it is.
//
// Pure functions, thread-safe. Landmarks come as ascending indices into the map's snapshot.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/frame_tracking.h"

namespace carmap {

/// Landmarks that at least one of these keyframes sees.
std::vector<uint32_t> LandmarksSeenBy(const ReconstructedMap& map,
                                      const std::vector<uint32_t>& keyframe_idxs);

/// As many of these keyframes, from the first on, as see so many landmarks together, each counted
/// once a keyframe; at least the first.
std::vector<uint32_t> FirstThatSee(const ReconstructedMap& map, std::vector<uint32_t> keyframe_idxs,
                                   size_t max_observations);

/// The keyframe and those, at most `neighbours`, that share most landmarks with it.
std::vector<uint32_t> WithCovisible(const ReconstructedMap& map, uint32_t keyframe_idx,
                                    size_t neighbours);

struct NeighbourhoodOptions {
  double radius_m = 30;               ///< in which keyframes count as near
  double max_turn_rad = 1.2;          ///< between a keyframe's viewing direction and the camera's
  size_t covisible_neighbours = 5;    ///< of the nearest keyframe, wherever they stand
  size_t max_keyframes = 40;          ///< nearest first ...
  size_t max_looked_at = 640;         ///< ... of so many, whichever way they look
  size_t max_observations = 1 << 15;  ///< of the keyframes together, but for the nearest one's
};

/// Landmarks seen by keyframes near the pose that look the same way, and by those covisible with
/// the nearest of them.
std::vector<uint32_t> LandmarksAround(const ReconstructedMap& map, const Rigid3& map_from_camera,
                                      const NeighbourhoodOptions& options = {});

/// Tracks in the landmarks around a pose that may be some metres off, and from there again until it
/// stays: a pose far from where landmarks were looked for was found with those that happened to lie
/// in the windows there.
std::optional<TrackedPose> TrackAround(const ReconstructedMap& map, const FeatureGrid& grid,
                                       const StereoRig& rig, Rigid3 camera_from_map,
                                       TrackingOptions tracking,
                                       const NeighbourhoodOptions& neighbourhood);

}  // namespace carmap
