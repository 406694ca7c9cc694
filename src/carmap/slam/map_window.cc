#include "carmap/slam/map_window.h"

#include <absl/container/btree_map.h>

#include <algorithm>
#include <tuple>

namespace carmap {

std::vector<Covisibility> CovisibleKeyframes(const Map& map, KeyframeId id, int min_shared) {
  absl::btree_map<KeyframeId, int> shared;
  for (const auto& link : map.LandmarksOf(id)) {
    if (!link) continue;
    for (const Observation& observation : map.Find(*link)->observations)
      ++shared[observation.keyframe_id];
  }
  shared.erase(id);
  std::vector<Covisibility> ranked;
  for (const auto& [other, count] : shared) {
    if (count >= min_shared) ranked.push_back({other, count});
  }
  std::sort(ranked.begin(), ranked.end(), [](const Covisibility& a, const Covisibility& b) {
    return std::tie(b.shared_landmarks, b.id) < std::tie(a.shared_landmarks, a.id);
  });
  return ranked;
}

std::vector<KeyframeId> WindowAround(const Map& map, KeyframeId id, const WindowOptions& options) {
  std::vector<KeyframeId> window = {id};
  for (const Covisibility& other : CovisibleKeyframes(map, id, options.min_shared_landmarks)) {
    if (window.size() >= options.keyframes) break;
    window.push_back(other.id);
  }
  std::sort(window.begin(), window.end());
  return window;
}

}  // namespace carmap
