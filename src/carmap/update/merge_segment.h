// Makes one map of a base map and a segment that was fitted to it (paper §3.4, Algorithm A.1).
//
// The map grows with the road, not with the driving: what both saw becomes one landmark, and a
// keyframe of the segment that stands where the base has one gives it what it saw and goes.
// Pure, deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "carmap/index/reconstruct.h"
#include "carmap/map/lean_map.h"
#include "carmap/update/landmark_pairs.h"
#include "carmap/update/segment_fit.h"

namespace carmap {

/// A landmark of both maps, and where both together put it.
struct MergedLandmark {
  LandmarkPair pair;
  Eigen::Vector3d position_in_base;
  double distance_m = 0;  ///< between where each map has it, once the segment is bent
};

/// A segment in the base's frame.
struct PlacedSegment {
  SegmentFit fit;
  std::vector<Eigen::Vector3d> positions_in_base;  ///< of the segment's landmarks
  size_t matches = 0;                              ///< landmarks of both taken for the same ...
  std::vector<MergedLandmark> merged;              ///< ... and those that lie in one place
};

/// Landmarks of the segment ride on their nearest keyframe.
PlacedSegment PlaceSegment(const ReconstructedMap& base, const ReconstructedMap& segment,
                           SegmentFit fit, const FitOptions& options);

struct MergeOptions {
  /// Nearer to a keyframe of the base that looks the same way, one of the segment shows nothing
  /// new: less than a lane.
  double same_place_m = 2.5, same_place_rad = 0.25;
  size_t max_landmarks = 2048;  ///< of a keyframe that takes others' in
};

/// The maps, and the same two rebuilt; the base for the segment's focal length. The base's
/// keyframes stay.
LeanMap MergeSegment(const LeanMap& base, const LeanMap& segment, const ReconstructedMap& base_map,
                     const ReconstructedMap& segment_map, const PlacedSegment& placed,
                     const MergeOptions& options);

}  // namespace carmap
