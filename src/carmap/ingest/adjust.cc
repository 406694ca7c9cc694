#include "carmap/ingest/adjust.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <queue>
#include <string>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/index/kd_tree.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/journal.h"
#include "carmap/ingest/pose_constraints.h"

namespace carmap {
namespace {

/// The component's keyframes, and those of its drives that it does not keep, with what was measured
/// between them. Poses are in the frame of one of its cells.
class ComponentGraph {
 public:
  ComponentGraph(const Component& component, const Rigid3& root_from_frame,
                 const AdjustOptions& options)
      : component_(component), root_from_frame_(root_from_frame), options_(options) {}

  void AddTile(const Tile& tile) {
    const Rigid3 frame_from_tile =
        root_from_frame_.Inverse() * RootFromTile(component_.grid, tile.id.cell);
    for (const LeanKeyframe& keyframe : tile.map.keyframes) {
      if (keyframe.is_stub) continue;
      poses_[NodeOf(keyframe.id)] = frame_from_tile * keyframe.map_from_camera;
    }
    kept_ = poses_.size();
  }

  /// Does nothing for a contribution to another component. To be called after all tiles.
  bool AddContribution(const PoseConstraints& constraints) {
    const std::vector<LeanKeyframe>& keyframes = constraints.drive.keyframes;
    const auto is_kept = [&](KeyframeId id) {
      const auto found = node_of_.find(id);
      return found != node_of_.end() && found->second < kept_;
    };
    const bool is_here =
        std::any_of(keyframes.begin(), keyframes.end(),
                    [&](const LeanKeyframe& keyframe) { return is_kept(keyframe.id); }) ||
        std::any_of(constraints.anchors.begin(), constraints.anchors.end(),
                    [&](const AnchorConstraint& anchor) { return is_kept(anchor.reference); });
    if (!is_here) return false;
    for (const auto& [from, to, is_lost] : constraints.steps) {
      const Rigid3 to_from_from =
          keyframes[to].map_from_camera.Inverse() * keyframes[from].map_from_camera;
      edges_.push_back(StepEdge(NodeOf(keyframes[from].id), NodeOf(keyframes[to].id), to_from_from,
                                options_.step, is_lost));
    }
    steps_ += constraints.steps.size();
    for (const AnchorConstraint& anchor : constraints.anchors) {
      edges_.push_back({NodeOf(anchor.reference), NodeOf(anchor.keyframe),
                        anchor.reference_from_keyframe.Inverse(), anchor.sigma_m, anchor.sigma_rad,
                        /*is_robust=*/true});
    }
    anchors_ += constraints.anchors.size();
    AddFixes(constraints.drive);
    return true;
  }

  /// Moves all poses to where the measurements agree best.
  Adjustment Solve() {
    HoldTheLoose();
    PlaceTheOthers();
    PoseGraph graph;
    for (const auto& pose : poses_) graph.camera_from_map.push_back(pose->Inverse());
    graph.edges = edges_;
    graph.priors = priors_;
    FixWhatFloats(graph);
    const PoseGraphSummary summary = SolvePoseGraph(graph);
    const double count = static_cast<double>(std::max<size_t>(6 * edges_.size(), 1));
    Adjustment made{.component = component_.id,
                    .keyframes = kept_,
                    .steps = steps_,
                    .anchors = anchors_,
                    .misfit_before = std::sqrt(2 * summary.initial_cost / count),
                    .misfit_after = std::sqrt(2 * summary.final_cost / count)};
    std::vector<double> moves_m;
    for (size_t i = 0; i < kept_; ++i) {
      const Rigid3 after = graph.camera_from_map[i].Inverse();
      moves_m.push_back((after.translation - poses_[i]->translation).norm());
      poses_[i] = after;
    }
    const Summary moves = Summarize(std::move(moves_m));
    made.median_move_m = moves.median;
    made.largest_move_m = moves.max;
    return made;
  }

  /// The tile with its keyframes where they are now; the landmarks ride on their anchors. Stubs of
  /// keyframes that the component does not keep stay.
  Tile Moved(const Tile& tile) const {
    Tile moved = tile;
    const Rigid3 tile_from_frame =
        RootFromTile(component_.grid, tile.id.cell).Inverse() * root_from_frame_;
    for (LeanKeyframe& keyframe : moved.map.keyframes) {
      const auto node = node_of_.find(keyframe.id);
      if (node == node_of_.end() || node->second >= kept_) continue;
      keyframe.map_from_camera = tile_from_frame * *poses_[node->second];
    }
    for (LeanLandmark& landmark : moved.map.landmarks) {
      landmark.position_in_map = moved.map.keyframes[landmark.anchor_idx].map_from_camera *
                                 PositionInAnchor(tile.map, landmark);
    }
    return moved;
  }

 private:
  uint32_t NodeOf(KeyframeId id) {
    const auto [place, is_new] = node_of_.try_emplace(id, static_cast<uint32_t>(poses_.size()));
    if (is_new) poses_.emplace_back();
    return place->second;
  }

  /// Where the fixes of a drive, if they agree with the way that it took, put its keyframes. They
  /// share one error: all together they tell as much as one.
  void AddFixes(const LeanMap& drive) {
    if (!component_.grid.is_on_earth) return;
    const auto georeference = SettledGeoreferenceOf(drive, options_.gps);
    if (!georeference) return;
    const Rigid3 frame_from_map =
        root_from_frame_.Inverse() * EcefFromEnu(georeference->origin) * georeference->enu_from_map;
    // The frame is level where it has its origin: y points down.
    const Eigen::Vector3d sigma_m =
        options_.gps.sigma_m * Eigen::Vector3d(1, options_.gps.vertical_factor, 1);
    for (const LeanKeyframe& keyframe : drive.keyframes) {
      priors_.push_back({.pose_idx = NodeOf(keyframe.id),
                         .position_in_map = frame_from_map * keyframe.map_from_camera.translation,
                         .sqrt_information = sigma_m.cwiseInverse().asDiagonal(),
                         .weight = 1 / static_cast<double>(drive.keyframes.size())});
    }
  }

  std::vector<std::vector<uint32_t>> EdgesOfNodes() const {
    std::vector<std::vector<uint32_t>> edges_of(poses_.size());
    for (uint32_t i = 0; i < edges_.size(); ++i) {
      edges_of[edges_[i].from_idx].push_back(i);
      edges_of[edges_[i].to_idx].push_back(i);
    }
    return edges_of;
  }

  /// A keyframe of which nothing was measured, since its contribution was taken back, keeps to the
  /// one nearest to it.
  void HoldTheLoose() {
    std::vector<bool> is_loose(poses_.size(), true);
    for (const PoseGraphEdge& edge : edges_) {
      is_loose[edge.from_idx] = is_loose[edge.to_idx] = false;
    }
    std::vector<Eigen::Vector3d> centers;
    for (size_t i = 0; i < kept_; ++i) centers.push_back(poses_[i]->translation);
    const KdTree tree(centers);
    for (uint32_t i = 0; i < kept_; ++i) {
      if (!is_loose[i]) continue;
      for (const uint32_t near : tree.Nearest(centers[i], 2)) {
        if (near == i) continue;
        edges_.push_back(
            StepEdge(near, i, poses_[i]->Inverse() * *poses_[near], options_.step, false));
      }
    }
  }

  /// Keyframes that the base does not keep begin where what was measured from a kept one puts them;
  /// without any, they and all that hangs on them alone is left out.
  void PlaceTheOthers() {
    const auto edges_of = EdgesOfNodes();
    std::queue<uint32_t> open;
    for (uint32_t i = 0; i < kept_; ++i) open.push(i);
    while (!open.empty()) {
      const uint32_t node = open.front();
      open.pop();
      for (const uint32_t e : edges_of[node]) {
        const PoseGraphEdge& edge = edges_[e];
        const bool is_from = edge.from_idx == node;
        const uint32_t other = is_from ? edge.to_idx : edge.from_idx;
        if (poses_[other]) continue;
        poses_[other] = *poses_[node] * (is_from ? edge.to_from_from.Inverse() : edge.to_from_from);
        open.push(other);
      }
    }
    const auto is_out = [&](uint32_t node) { return !poses_[node]; };
    std::erase_if(edges_, [&](const PoseGraphEdge& edge) {
      return is_out(edge.from_idx) || is_out(edge.to_idx);
    });
    std::erase_if(priors_, [&](const PositionPrior& prior) { return is_out(prior.pose_idx); });
    for (auto& pose : poses_) {
      if (!pose) pose = Rigid3();
    }
  }

  /// Of all that hangs together, something has to say where it is: fixes, or else one pose that
  /// stays.
  void FixWhatFloats(PoseGraph& graph) const {
    std::vector<uint32_t> root(poses_.size());
    std::iota(root.begin(), root.end(), 0);
    const auto find = [&](uint32_t node) {
      while (root[node] != node) node = root[node] = root[root[node]];
      return node;
    };
    for (const PoseGraphEdge& edge : edges_) {
      const uint32_t a = find(edge.from_idx), b = find(edge.to_idx);
      root[std::max(a, b)] = std::min(a, b);  // the lowest is one that is kept, if any is
    }
    std::vector<bool> is_held(poses_.size(), false);
    for (const PositionPrior& prior : priors_) is_held[find(prior.pose_idx)] = true;
    graph.pose_is_fixed.assign(poses_.size(), false);
    for (uint32_t i = 0; i < poses_.size(); ++i) {
      if (find(i) == i && !is_held[i]) graph.pose_is_fixed[i] = true;
    }
  }

  const Component& component_;
  const Rigid3 root_from_frame_;
  const AdjustOptions& options_;
  std::map<KeyframeId, uint32_t> node_of_;
  std::vector<std::optional<Rigid3>> poses_;  ///< frame_from_camera; the kept ones come first
  size_t kept_ = 0, steps_ = 0, anchors_ = 0;
  std::vector<PoseGraphEdge> edges_;
  std::vector<PositionPrior> priors_;
};

absl::Status CommitAdjustment(const Changes& changes, BaseMap& base, Adjustment& made) {
  Commit commit;
  CARMAP_RETURN_IF_ERROR(changes.AddTo(DefaultVocabulary(), commit));
  made.tiles = VersionsAfter(commit);
  made.patch_bytes = PatchBytesOf(commit);
  commit.journal_text =
      ToJournal(LoggedChange{.kind = "adjust",
                             .time = TimeText(),
                             .name = fmt::format("{} contributions", made.contributions),
                             .component = made.component,
                             .tiles = made.tiles});
  CARMAP_ASSIGN_OR_RETURN(made.sequence, base.Apply(commit));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Adjustment> Adjust(const Component& component, BaseMap& base,
                                  const AdjustOptions& options) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> tiles, TilesOf(base.reader(), component.id));
  if (tiles.empty()) return Adjustment{.component = component.id};
  ComponentGraph graph(component, RootFromView(component.grid, tiles[tiles.size() / 2].cell),
                       options);
  for (const TileId& id : tiles) {
    CARMAP_ASSIGN_OR_RETURN(const auto tile, base.Read(id));
    if (tile) graph.AddTile(*tile);
  }
  size_t contributions = 0;
  CARMAP_RETURN_IF_ERROR(base.reader().VisitContributions(
      kContributionPrefix, [&](std::string_view key, std::string_view value) -> absl::Status {
        if (value.empty()) return absl::OkStatus();
        CARMAP_ASSIGN_OR_RETURN(
            const PoseConstraints constraints,
            DecodeConstraints(value, fmt::format("{}: contribution {}", base.name(), key)));
        contributions += graph.AddContribution(constraints);
        return absl::OkStatus();
      }));
  Adjustment made = graph.Solve();
  made.contributions = contributions;
  if (made.largest_move_m > options.max_move_m) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: component {} would move by {:.0f} m, {:.0f} m are allowed: its fixes and drives "
        "contradict each other; take back the drives with wrong fixes (`carmap base revert`)",
        base.name(), component.id, made.largest_move_m, options.max_move_m));
  }
  if (made.largest_move_m < options.min_move_m) return made;
  Changes changes(base);
  for (const TileId& id : tiles) {
    CARMAP_ASSIGN_OR_RETURN(const auto tile, base.Read(id));
    if (tile) CARMAP_RETURN_IF_ERROR(changes.Put(graph.Moved(*tile)));
  }
  CARMAP_RETURN_IF_ERROR(CommitAdjustment(changes, base, made));
  return made;
}

}  // namespace carmap
