#include "carmap/slam/loop_correction.h"

#include <absl/container/btree_set.h>
#include <absl/container/flat_hash_map.h>

#include <algorithm>
#include <utility>

#include "carmap/feature/feature_grid.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/map/propagate_edit.h"
#include "carmap/slam/link_matches.h"
#include "carmap/solve/pose_graph.h"

namespace carmap {
namespace {

class GraphOfMap {
 public:
  GraphOfMap(const Map& map, const LoopCorrectionOptions& options) : map_(map), options_(options) {
    for (const auto& [id, keyframe] : map.keyframes()) {
      idx_of_[id] = static_cast<uint32_t>(ids_.size());
      ids_.push_back(id);
      graph_.camera_from_map.push_back(keyframe.map_from_camera.Inverse());
    }
    graph_.pose_is_fixed.assign(ids_.size(), false);
    graph_.pose_is_fixed.front() = true;
    for (uint32_t i = 1; i < ids_.size(); ++i) AddEdgesToEarlier(i);
  }

  void AddLoop(const Loop& loop) {
    for (const LoopMatch& match : loop) {
      graph_.edges.push_back({idx_of_.at(match.place_id), idx_of_.at(match.keyframe_id),
                              match.keyframe_from_place, SigmaM(match.covariance),
                              SigmaRad(match.covariance), /*is_robust=*/true});
    }
  }
  void AddFixes(const std::vector<PositionPrior>& fixes) {
    graph_.priors = fixes;
    graph_.pose_is_fixed.front() = fixes.empty();
  }

  MapEdit Solve() {
    SolvePoseGraph(graph_);
    MapEdit edit{.base_version = map_.version()};
    for (size_t i = 0; i < ids_.size(); ++i) {
      edit.moved_keyframes.push_back({ids_[i], graph_.camera_from_map[i].Inverse()});
    }
    KeepFirstKeyframe(map_, edit);
    return edit;
  }

 private:
  /// To the keyframe before, and to those long before that see the same.
  void AddEdgesToEarlier(uint32_t idx) {
    constexpr size_t kMaxFarEdges = 2;
    const auto covisible = CovisibleKeyframes(map_, ids_[idx], 1);
    const bool is_lost = std::none_of(covisible.begin(), covisible.end(),
                                      [&](const auto& other) { return other.id < ids_[idx]; });
    AddPresentEdge(idx - 1, idx, is_lost);
    size_t far_edges = 0;
    for (const auto& [id, shared] : covisible) {
      if (shared < options_.min_shared_landmarks || far_edges == kMaxFarEdges) return;
      const uint32_t other = idx_of_.at(id);
      if (other + options_.min_keyframes_between > idx) continue;
      AddPresentEdge(other, idx, false);
      ++far_edges;
    }
  }

  void AddPresentEdge(uint32_t from, uint32_t to, bool is_lost) {
    const Rigid3 to_from_from = graph_.camera_from_map[to] * graph_.camera_from_map[from].Inverse();
    graph_.edges.push_back(StepEdge(from, to, to_from_from, options_.step, is_lost));
  }

  const Map& map_;
  const LoopCorrectionOptions& options_;
  PoseGraph graph_;
  std::vector<KeyframeId> ids_;  ///< of the poses
  absl::flat_hash_map<KeyframeId, uint32_t> idx_of_;
};

/// All keyframes around those of the loop, on its `side`: the places or the newest.
template <typename Side>
std::vector<KeyframeId> WindowsOf(const Map& map, const Loop& loop, const WindowOptions& options,
                                  Side&& side) {
  absl::btree_set<KeyframeId> ids;
  for (const LoopMatch& match : loop) {
    const std::vector<KeyframeId> window = WindowAround(map, side(match), options);
    ids.insert(window.begin(), window.end());
  }
  return {ids.begin(), ids.end()};
}

}  // namespace

void KeepFirstKeyframe(const Map& map, MapEdit& edit) {
  const auto& [first_id, first] = *map.keyframes().begin();
  const auto moved = std::find_if(edit.moved_keyframes.begin(), edit.moved_keyframes.end(),
                                  [id = first_id](const auto& pose) { return pose.id == id; });
  if (moved == edit.moved_keyframes.end()) return;
  const Rigid3 map_from_moved = first.map_from_camera * moved->map_from_camera.Inverse();
  for (auto& [id, pose] : edit.moved_keyframes) pose = map_from_moved * pose;
  for (auto& [id, position] : edit.moved_landmarks) position = map_from_moved * position;
  moved->map_from_camera = first.map_from_camera;
}

MapEdit CorrectPoses(const Map& map, const Loop& loop, const std::vector<PositionPrior>& fixes,
                     const LoopCorrectionOptions& options) {
  GraphOfMap graph(map, options);
  graph.AddLoop(loop);
  graph.AddFixes(fixes);
  return PropagateEdit(map, graph.Solve());
}

MapEdit FuseLoop(const Map& map, const StereoRig& rig, const Loop& loop,
                 const LoopCorrectionOptions& options) {
  MapEdit edit{.base_version = map.version()};
  const auto newest_ids =
      WindowsOf(map, loop, options.window, [](const LoopMatch& m) { return m.keyframe_id; });
  auto place_ids =
      WindowsOf(map, loop, options.window, [](const LoopMatch& m) { return m.place_id; });
  std::erase_if(place_ids, [&](KeyframeId id) {
    return std::binary_search(newest_ids.begin(), newest_ids.end(), id);
  });
  const MapSnapshot place = SnapshotOf(map, place_ids);
  const std::vector<uint32_t> landmark_idxs = AllLandmarks(place);
  const LoopMatch& newest = loop.back();
  const Rigid3 place_from_map =
      newest.map_from_keyframe * map.Find(newest.keyframe_id)->map_from_camera.Inverse();
  for (const KeyframeId& id : newest_ids) {
    const Keyframe& keyframe = *map.Find(id);
    const FeatureGrid grid(*keyframe.features, rig.camera.width, rig.camera.height);
    const Rigid3 camera_from_place = (place_from_map * keyframe.map_from_camera).Inverse();
    LinkMatches(map, place, id,
                MatchByProjection(place, landmark_idxs, grid, rig, camera_from_place,
                                  {.radius_px = options.fuse_radius_px}),
                edit);
  }
  return edit;
}

}  // namespace carmap
