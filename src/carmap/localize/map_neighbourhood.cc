#include "carmap/localize/map_neighbourhood.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

namespace carmap {
namespace {

constexpr int kMaxSearches = 5;
constexpr double kSettledM = 0.3;
constexpr double kLaterRadiusPx = 12;  // of searches from a pose that was found, not guessed

}  // namespace

std::vector<uint32_t> LandmarksSeenBy(const ReconstructedMap& map,
                                      const std::vector<uint32_t>& keyframe_idxs) {
  uint32_t first = std::numeric_limits<uint32_t>::max(), last = 0;
  size_t observations = 0;
  for (const uint32_t keyframe_idx : keyframe_idxs) {
    const auto& seen = map.snapshot.keyframes[keyframe_idx].landmark_idxs;
    if (seen.empty()) continue;
    first = std::min(first, seen.front());
    last = std::max(last, seen.back());
    observations += seen.size();
  }
  std::vector<uint32_t> landmark_idxs;
  if (observations == 0) return landmark_idxs;
  // A bit each: lists of keyframes side by side are of much the same landmarks.
  std::vector<uint64_t> is_seen((last - first) / 64 + 1, 0);
  for (const uint32_t keyframe_idx : keyframe_idxs) {
    for (const uint32_t idx : map.snapshot.keyframes[keyframe_idx].landmark_idxs) {
      is_seen[(idx - first) / 64] |= uint64_t{1} << ((idx - first) % 64);
    }
  }
  for (uint32_t word = 0; word < is_seen.size(); ++word) {
    for (uint64_t bits = is_seen[word]; bits != 0; bits &= bits - 1) {
      landmark_idxs.push_back(first + 64 * word + static_cast<uint32_t>(std::countr_zero(bits)));
    }
  }
  return landmark_idxs;
}

std::vector<uint32_t> FirstThatSee(const ReconstructedMap& map, std::vector<uint32_t> keyframe_idxs,
                                   size_t max_observations) {
  size_t observations = 0;
  for (size_t i = 0; i < keyframe_idxs.size(); ++i) {
    observations += map.snapshot.keyframes[keyframe_idxs[i]].landmark_idxs.size();
    if (i > 0 && observations > max_observations) keyframe_idxs.resize(i);
  }
  return keyframe_idxs;
}

std::vector<uint32_t> WithCovisible(const ReconstructedMap& map, uint32_t keyframe_idx,
                                    size_t neighbours) {
  std::vector<uint32_t> keyframe_idxs = {keyframe_idx};
  for (const CovisibleKeyframe& neighbour : map.covisible()[keyframe_idx]) {
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
  for (const uint32_t idx : map.keyframe_centers.WithinRadius(
           map_from_camera.translation, options.radius_m, options.max_looked_at)) {
    if (keyframe_idxs.size() == options.max_keyframes) break;
    const Rigid3& keyframe = map.snapshot.keyframes[idx].map_from_camera;
    if (direction.dot(keyframe.rotation * Eigen::Vector3d::UnitZ()) < min_cosine) continue;
    keyframe_idxs.push_back(idx);
  }
  if (keyframe_idxs.empty()) return {};
  const auto covisible = WithCovisible(map, keyframe_idxs.front(), options.covisible_neighbours);
  keyframe_idxs.insert(keyframe_idxs.begin() + 1, covisible.begin() + 1, covisible.end());
  return LandmarksSeenBy(map, FirstThatSee(map, keyframe_idxs, options.max_observations));
}

std::optional<TrackedPose> TrackAround(const ReconstructedMap& map, const FeatureGrid& grid,
                                       const StereoRig& rig, Rigid3 camera_from_map,
                                       TrackingOptions tracking,
                                       const NeighbourhoodOptions& neighbourhood) {
  const double later_radius_px = std::min(tracking.first_radius_px, kLaterRadiusPx);
  std::optional<TrackedPose> best;
  for (int i = 0; i < kMaxSearches; ++i) {
    const auto landmark_idxs = LandmarksAround(map, camera_from_map.Inverse(), neighbourhood);
    auto pose =
        TrackByProjection(map.snapshot, landmark_idxs, grid, rig, camera_from_map, tracking);
    if (!pose || (best && pose->inliers.size() < best->inliers.size())) break;
    const double moved_m = (pose->camera_from_map * camera_from_map.Inverse()).translation.norm();
    camera_from_map = pose->camera_from_map;
    best = std::move(pose);
    if (moved_m < kSettledM) break;
    tracking.first_radius_px = later_radius_px;
  }
  return best;
}

}  // namespace carmap
