// Of the landmarks of a drive on a known road, those that show what the base has not: what a diff
// carries (paper §3.4).
//
// Corners that a drive finds where the base has others of the same things are no news: detectors
// choose differently each time, in other light most of all. News are things of which the drive
// recognises much less than of what stands around them. Pure, deterministic, thread-safe.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "carmap/index/reconstruct.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"

namespace carmap {

struct NewLandmarkOptions {
  /// A thing is so many landmarks, one of these numbers, that lie nearest to each other, and so
  /// near.
  std::vector<size_t> thing_landmarks = {6, 12, 20};
  double thing_m = 4;
  /// Within that radius the light, and so the share of landmarks that are recognised, is the same;
  /// that of the whole stretch counts like so many landmarks more.
  double light_m = 12;
  double light_prior = 20;
  double false_share = 0.02;  ///< that is recognised of a thing that is new, falsely
  double min_log_ratio = 3;   ///< of the likelihoods that a thing is new and that it is known
  double max_share = 0.06;    ///< of the stretch's landmarks, the likeliest first
  /// Nearer to one of the base's that was seen, one is the same corner, with another signature.
  double same_m = 0.06, same_ratio = 0.004;  ///< so much more by the distance from the camera
  double max_distance_m = 40;                ///< farther away nothing new is placed well enough
};

/// Indices of the landmarks of `drive`, which lies in the base's frame, ascending. `seen_again`
/// tells which the base has; `is_seen` of a landmark of the base whether the drive saw it
/// otherwise.
std::vector<uint32_t> NewLandmarks(const ReconstructedMap& base, const LeanMap& drive,
                                   const std::vector<SameLandmark>& seen_again,
                                   const std::function<bool(LandmarkId)>& is_seen,
                                   const NewLandmarkOptions& options = {});

}  // namespace carmap
