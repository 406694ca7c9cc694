// Where a lean map's keyframes stand, as a tree.
//
// Pure, thread-safe.
#pragma once

#include <utility>
#include <vector>

#include "carmap/index/kd_tree.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// Of the keyframes' centres, in the map's frame and in its order.
inline KdTree TreeOfKeyframes(const LeanMap& map) {
  std::vector<Eigen::Vector3d> centers;
  centers.reserve(map.keyframes.size());
  for (const LeanKeyframe& keyframe : map.keyframes) {
    centers.push_back(keyframe.map_from_camera.translation);
  }
  return KdTree(std::move(centers));
}

}  // namespace carmap
