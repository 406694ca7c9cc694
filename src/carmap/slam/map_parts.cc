#include "carmap/slam/map_parts.h"

#include <absl/container/btree_map.h>

#include <algorithm>
#include <utility>

#include "carmap/localize/motion_model.h"

namespace carmap {

Rigid3 BridgeGap(const Gap& gap, const Rigid3& map_from_reference, const Rigid3& motion_after,
                 double motion_after_s) {
  Rigid3 camera_from_map = gap.camera_from_reference * map_from_reference.Inverse();
  for (const auto& [motion, seconds] :
       {std::pair(gap.motion_before, gap.motion_before_s), {motion_after, motion_after_s}}) {
    if (seconds > 0) {
      camera_from_map = Extrapolate(motion, gap.duration_s / 2 / seconds) * camera_from_map;
    }
  }
  return camera_from_map.Inverse();
}

MapEdit MovePart(const Map& map, KeyframeId first, const Rigid3& moved_from_map) {
  MapEdit edit{.base_version = map.version()};
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (id < first) continue;
    edit.moved_keyframes.push_back({id, moved_from_map * keyframe.map_from_camera});
  }
  for (const auto& [id, landmark] : map.landmarks()) {
    if (landmark.observations.front().keyframe_id < first) continue;
    edit.moved_landmarks.push_back({id, moved_from_map * landmark.position_in_map});
  }
  return edit;
}

namespace {

/// Disjoint sets of keyframes; each is named by its earliest.
class KeyframeSets {
 public:
  explicit KeyframeSets(const Map& map) {
    for (const auto& [id, keyframe] : map.keyframes()) parent_[id] = id;
  }
  KeyframeId Find(KeyframeId id) {
    KeyframeId root = id;
    while (parent_.at(root) != root) root = parent_.at(root);
    while (parent_.at(id) != root) id = std::exchange(parent_.at(id), root);
    return root;
  }
  void Join(KeyframeId a, KeyframeId b) {
    const KeyframeId root_a = Find(a), root_b = Find(b);
    parent_.at(std::max(root_a, root_b)) = std::min(root_a, root_b);
  }

 private:
  absl::btree_map<KeyframeId, KeyframeId> parent_;
};

}  // namespace

std::vector<std::vector<KeyframeId>> ConnectedParts(const Map& map) {
  KeyframeSets sets(map);
  for (const auto& [id, landmark] : map.landmarks()) {
    for (const Observation& observation : landmark.observations) {
      sets.Join(landmark.observations.front().keyframe_id, observation.keyframe_id);
    }
  }
  absl::btree_map<KeyframeId, std::vector<KeyframeId>> parts;
  for (const auto& [id, keyframe] : map.keyframes()) parts[sets.Find(id)].push_back(id);
  std::vector<std::vector<KeyframeId>> result;
  for (auto& [first, ids] : parts) result.push_back(std::move(ids));
  return result;
}

}  // namespace carmap
