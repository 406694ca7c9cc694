#include "carmap/map/propagate_edit.h"

#include <absl/container/btree_map.h>
#include <absl/container/btree_set.h>

#include <optional>
#include <utility>
#include <vector>

namespace carmap {
namespace {

/// How each keyframe of the map moves, in the map's frame: new from old.
using Moves = absl::btree_map<KeyframeId, Rigid3>;

Moves MovesOf(const Map& map, const MapEdit& edit) {
  Moves moves;
  for (const auto& [id, map_from_camera] : edit.moved_keyframes) {
    const Keyframe* keyframe = map.Find(id);
    if (keyframe) moves[id] = map_from_camera * keyframe->map_from_camera.Inverse();
  }
  return moves;
}

/// The move of the last moved keyframe of the same drive before this one, or else of the first
/// after it.
const Rigid3* MoveOfNeighbour(const Moves& moves, KeyframeId id) {
  const auto after = moves.upper_bound(id);
  if (after != moves.begin() && std::prev(after)->first.drive == id.drive) {
    return &std::prev(after)->second;
  }
  return after != moves.end() && after->first.drive == id.drive ? &after->second : nullptr;
}

template <typename Move>
void EraseOutdated(const Map& map, uint64_t base_version, std::vector<Move>& moves) {
  std::erase_if(moves, [&](const Move& move) {
    const auto* record = map.Find(move.id);
    return !record || record->placed_in > base_version;
  });
}

}  // namespace

MapEdit PropagateEdit(const Map& map, MapEdit edit) {
  EraseOutdated(map, edit.base_version, edit.moved_keyframes);
  EraseOutdated(map, edit.base_version, edit.moved_landmarks);
  edit.base_version = map.version();
  const Moves given = MovesOf(map, edit);
  Moves moves = given;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Rigid3* move = given.contains(id) ? nullptr : MoveOfNeighbour(given, id);
    if (!move) continue;
    moves[id] = *move;
    edit.moved_keyframes.push_back({id, *move * keyframe.map_from_camera});
  }
  absl::btree_set<LandmarkId> moved;
  for (const auto& [id, position] : edit.moved_landmarks) moved.insert(id);
  for (const auto& [id, landmark] : map.landmarks()) {
    const auto move = moves.find(landmark.observations.front().keyframe_id);
    if (move == moves.end() || moved.contains(id)) continue;
    edit.moved_landmarks.push_back({id, move->second * landmark.position_in_map});
  }
  return edit;
}

}  // namespace carmap
