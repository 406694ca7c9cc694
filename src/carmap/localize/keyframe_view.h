// What a camera at a keyframe would see of the map around it.
//
// A lean keyframe keeps some dozens of features: what tracking held on to. The keyframes around it
// saw other landmarks of the same place, and together they show a place several times as densely,
// which is what two maps made in different traffic and light need to know each other by.
// Pure, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/index/reconstruct.h"

namespace carmap {

struct KeyframeView {
  std::vector<Feature> features;        ///< as the keyframe's rig would measure them
  std::vector<uint32_t> landmark_idxs;  ///< of each feature
};

/// Of the keyframe and those, at most `neighbours`, that share most landmarks with it, the
/// landmarks that a camera at the keyframe must see unless something hides them. At most as many
/// as a keyframe may see (kMaxLandmarksOfKeyframe).
KeyframeView ViewFrom(const ReconstructedMap& map, uint32_t keyframe_idx, size_t neighbours);

}  // namespace carmap
