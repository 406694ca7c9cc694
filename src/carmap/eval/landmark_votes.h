// What the landmarks of a map are by the votes of its keyframes (paper §3.3, figures 17 and A.6),
// against what they truly are.
//
// Pure functions.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "carmap/eval/segmentation_score.h"
#include "carmap/map/map.h"
#include "carmap/semantics/mobility.h"

namespace carmap {

/// Mobility of each feature, by frame number.
using FrameLabels = std::map<uint32_t, std::vector<Mobility>>;

/// The landmarks that at least `min_observations` keyframes saw: what they are by the votes of
/// `truth`, and what by `told` of every `cycle`-th keyframe (1 or more; the paper's segmentation
/// cycle), by the majority that a map asks for (MobilityVotes::Elected); unknown where nobody
/// votes. Labels must be of the map's own drive: of each keyframe that has some, one a feature.
MobilityConfusion VoteOnLandmarks(const Map& map, const FrameLabels& truth, const FrameLabels& told,
                                  size_t cycle, size_t min_observations);

}  // namespace carmap
