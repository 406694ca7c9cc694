#include "carmap/localize/map_neighbourhood.h"

#include <algorithm>
#include <cmath>

namespace carmap {

std::vector<uint32_t> LandmarksSeenBy(const ReconstructedMap& map,
                                      const std::vector<uint32_t>& keyframe_idxs) {
  std::vector<uint32_t> landmark_idxs;
  for (const uint32_t keyframe_idx : keyframe_idxs) {
    const auto& seen = map.snapshot.keyframes[keyframe_idx].landmark_idxs;
    landmark_idxs.insert(landmark_idxs.end(), seen.begin(), seen.end());
  }
  std::sort(landmark_idxs.begin(), landmark_idxs.end());
  landmark_idxs.erase(std::unique(landmark_idxs.begin(), landmark_idxs.end()), landmark_idxs.end());
  return landmark_idxs;
}

std::vector<uint32_t> WithCovisible(const ReconstructedMap& map, uint32_t keyframe_idx,
                                    size_t neighbours) {
  std::vector<uint32_t> keyframe_idxs = {keyframe_idx};
  for (const CovisibleKeyframe& neighbour : map.covisible[keyframe_idx]) {
    if (keyframe_idxs.size() > neighbours) break;
    keyframe_idxs.push_back(neighbour.keyframe_idx);
  }
  return keyframe_idxs;
}

std::vector<uint32_t> LandmarksAround(const ReconstructedMap& map, const Rigid3& map_from_camera,
                                      const NeighbourhoodOptions& options) {
  const double min_cosine = std::cos(options.max_turn_rad);
  const Eigen::Vector3d direction = map_from_camera.rotation * Eigen::Vector3d::UnitZ();
  std::vector<uint32_t> keyframe_idxs;
  for (const uint32_t idx :
       map.keyframe_centers.WithinRadius(map_from_camera.translation, options.radius_m)) {
    if (keyframe_idxs.size() == options.max_keyframes) break;
    const Rigid3& keyframe = map.snapshot.keyframes[idx].map_from_camera;
    if (direction.dot(keyframe.rotation * Eigen::Vector3d::UnitZ()) < min_cosine) continue;
    keyframe_idxs.push_back(idx);
  }
  if (keyframe_idxs.empty()) return {};
  const auto covisible = WithCovisible(map, keyframe_idxs.front(), options.covisible_neighbours);
  keyframe_idxs.insert(keyframe_idxs.end(), covisible.begin(), covisible.end());
  return LandmarksSeenBy(map, keyframe_idxs);
}

}  // namespace carmap
