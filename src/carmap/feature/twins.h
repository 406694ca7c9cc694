// One corner is often found at several levels of the pyramid: which features of a frame are one.
//
// All of them serve matching, as a camera elsewhere may see the corner at any of these levels; but
// it is one point of the world, and makes one landmark. Pure function.
#pragma once

#include <algorithm>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"

namespace carmap {

/// How near to a feature at this level the same corner lies at other, finer ones, at most, in
/// pixels of the full-size image.
inline double TwinRadiusPx(int level) { return std::max(3.0, 1.5 * ScaleOfLevel(level)); }

/// By how much the signatures of one corner at two levels differ, at most.
inline constexpr int kMaxTwinBits = 38;

/// Sets twin_idx of each feature that shows a corner which a feature at a finer level shows too.
/// Features in the order of their levels.
void LinkTwins(const PinholeCamera& camera, std::vector<Feature>& features);

}  // namespace carmap
