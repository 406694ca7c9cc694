// Where a map segment overlaps a base map (paper §3.4, Algorithm A.1, FindOverlap and
// FindTransform).
//
// The segment's reconstructed keyframes are located in the base map like frames of a camera (§3.2):
// near their GPS fix where both maps have fixes, elsewhere by appearance; or, as the baseline that
// this is compared with, by appearance alone. Deterministic, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/place_search.h"
#include "carmap/update/landmark_pairs.h"

namespace carmap {

struct OverlapOptions {
  TrackingOptions tracking;
  NeighbourhoodOptions neighbourhood;
  PlaceSearchOptions place_search;
  size_t min_inliers = 30;  ///< of a keyframe that is found
  /// The baseline: keyframes are found by appearance alone (AppearanceLocalizer).
  bool by_appearance = false;
  size_t max_tries = 400;       ///< keyframes looked for in the base map, spread over the segment
  size_t enough_keyframes = 8;  ///< that agree end the search, if the place is clear ...
  size_t max_keyframes = 40;    ///< ... and so many that were found at all, if it is not
  /// Of a keyframe that fits several places: the inliers of one that counts, as a part of those of
  /// the best.
  double min_rival_share = 0.5;
  /// Keyframes that fit another place, as a part of those that agree on the best one, from which on
  /// the place is ambiguous.
  double max_dissent = 0.5;
  double agreement_m = 1.5;  ///< between the transforms of two keyframes, at the first of them ...
  double agreement_drift = 0.02;  ///< ... and so much more a metre between the keyframes
  double agreement_rad = 0.05;
};

/// First, coarse answer: keyframes of the segment found in the base map.
struct CoarseOverlap {
  size_t tried = 0;          ///< keyframes of the segment that were looked for
  size_t found = 0;          ///< that were found in the base map at all
  size_t agreeing = 0;       ///< of these, the largest number that agree on where the segment lies
  size_t dissenting = 0;     ///< the largest number that fit another place, also or only
  Rigid3 base_from_segment;  ///< of the agreeing keyframe with most matches; if agreeing > 0

  bool IsAmbiguous(const OverlapOptions& options) const;
};

CoarseOverlap FindOverlap(const ReconstructedMap& base, const ReconstructedMap& segment,
                          const OverlapOptions& options);

/// Given about where the segment lies, all that both maps saw.
struct FineOverlap {
  std::vector<uint32_t> segment_keyframes;         ///< tracked in the base map, ascending
  std::vector<Eigen::Vector3d> positions_in_base;  ///< of these, by the base's landmarks
  std::vector<LandmarkPair> pairs;                 ///< ascending; each landmark in at most one
};

/// Matches every keyframe of the segment that stands near the base map with the base's landmarks
/// around it. A landmark goes with the one that most keyframes match it with, if that goes with it:
/// one that they match with another more often is another corner.
FineOverlap MatchOverlap(const ReconstructedMap& base, const ReconstructedMap& segment,
                         const Rigid3& base_from_segment, const OverlapOptions& options);

}  // namespace carmap
