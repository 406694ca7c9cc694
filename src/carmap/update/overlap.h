// Whether and where a map segment overlaps a base map (paper §3.4, Algorithm A.1, FindOverlap).
//
// The segment's reconstructed keyframes are located in the base map like frames of a camera (§3.2):
// near their GPS fix where both maps have fixes, elsewhere by appearance; or, as the baseline that
// this is compared with, by appearance alone. Deterministic, thread-safe.
#pragma once

#include <cstddef>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/update/keyframe_locator.h"

namespace carmap {

struct OverlapOptions {
  size_t max_tries = 400;       ///< keyframes looked for in the base map, spread over the segment
  size_t enough_keyframes = 8;  ///< that agree end the search, if the place is clear ...
  size_t max_keyframes = 40;    ///< ... and so many that were found at all, if it is not
  /// Keyframes that fit another place, as a part of those that agree on the best one, from which on
  /// the place is ambiguous.
  double max_dissent = 0.5;
  double agreement_m = 1.5;  ///< between the transforms of two keyframes, at the first of them ...
  double agreement_drift = 0.02;  ///< ... and so much more a metre between the keyframes
  double agreement_rad = 0.05;
};

/// Keyframes of the segment that agree on where it lies.
struct OverlapVotes {
  size_t keyframes = 0;
  size_t near_fix = 0;  ///< of the keyframes, where their GPS fixes say
};

/// Keyframes of the segment found in the base map.
struct Overlap {
  size_t tried = 0;         ///< keyframes of the segment that were looked for
  size_t found = 0;         ///< that were found in the base map at all
  OverlapVotes agreeing;    ///< of these, the largest number that agree
  OverlapVotes dissenting;  ///< the largest number that fit another place, also or only
  LocatedKeyframe best;     ///< of the agreeing keyframes the one with most matches, if any agree

  /// Another place has half as many votes, and GPS does not decide between the two.
  bool IsAmbiguous(const OverlapOptions& options) const;
};

Overlap FindOverlap(const ReconstructedMap& segment, const OverlapOptions& options,
                    KeyframeLocator& locator);

}  // namespace carmap
