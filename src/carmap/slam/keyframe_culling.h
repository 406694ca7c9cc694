// Which keyframes a map can do without: memory grows with the road, not with how often it is
// driven.
//
// Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/map.h"

namespace carmap {

struct KeyframeCullingOptions {
  double min_redundant_ratio = 0.9;  ///< of a keyframe's landmarks that others see as well
  int min_other_viewers = 3;         ///< at the same pyramid level or a finer one
  /// Without the keyframe, those before and behind it that look the same way must be this close
  /// together: a vehicle finds its place from the keyframes.
  double max_gap_m = 5;
  double max_lateral_m = 1.8;
  double max_turn_rad = 0.25;
};

/// Those of the candidates, in their order, that may all be culled together.
std::vector<KeyframeId> RedundantKeyframes(const Map& map,
                                           const std::vector<KeyframeId>& candidates,
                                           const KeyframeCullingOptions& options);

}  // namespace carmap
