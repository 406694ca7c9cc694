#include "carmap/ingest/street_changes.h"

#include <Eigen/Core>
#include <algorithm>
#include <map>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/index/kd_tree.h"
#include "carmap/ingest/evidence.h"

namespace carmap {
namespace {

struct ChangedLandmark {
  Eigen::Vector3d p_in_root;
  double probability = 0;
  int64_t since_s = 0;
};

/// Landmarks that are near each other, each in one group.
std::vector<std::vector<uint32_t>> GroupsOf(const std::vector<ChangedLandmark>& landmarks,
                                            double near_m) {
  std::vector<Eigen::Vector3d> places;
  for (const ChangedLandmark& landmark : landmarks) places.push_back(landmark.p_in_root);
  const KdTree tree(std::move(places));
  std::vector<bool> is_taken(landmarks.size(), false);
  std::vector<std::vector<uint32_t>> groups;
  for (uint32_t first = 0; first < landmarks.size(); ++first) {
    if (is_taken[first]) continue;
    is_taken[first] = true;
    std::vector<uint32_t> group = {first};
    for (size_t next = 0; next < group.size(); ++next) {
      for (const uint32_t i : tree.WithinRadius(landmarks[group[next]].p_in_root, near_m)) {
        if (is_taken[i]) continue;
        is_taken[i] = true;
        group.push_back(i);
      }
    }
    groups.push_back(std::move(group));
  }
  return groups;
}

StreetChange ChangeOf(const std::vector<ChangedLandmark>& landmarks,
                      const std::vector<uint32_t>& group) {
  StreetChange change{.landmarks = group.size(), .since_s = landmarks[group.front()].since_s};
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const uint32_t i : group) {
    middle += landmarks[i].p_in_root / static_cast<double>(group.size());
    change.probability += landmarks[i].probability / static_cast<double>(group.size());
    change.since_s = std::min(change.since_s, landmarks[i].since_s);
  }
  for (const uint32_t i : group) {
    change.radius_m = std::max(change.radius_m, (landmarks[i].p_in_root - middle).norm());
  }
  change.place = GpsOfEcef(middle);
  return change;
}

/// What a component's tiles tell.
struct ComponentChanges {
  std::vector<ChangedLandmark> appeared, vanished;
};

void AddVanished(const TileEvidence& evidence, const Rigid3& root_from_tile, int64_t since_s,
                 ComponentChanges& changes) {
  for (const VanishedLandmark& gone : evidence.vanished()) {
    if (gone.time_s < since_s) continue;
    changes.vanished.push_back({root_from_tile * gone.position_in_tile.cast<double>(),
                                ProbabilityOf(gone.log_odds), gone.time_s});
  }
}

/// Landmarks of drives that came after the tile's first.
void AddAppeared(const Tile& tile, const TileEvidence& evidence, const Rigid3& root_from_tile,
                 int64_t since_s, ComponentChanges& changes) {
  constexpr double kOneDrive = 0.45;  // of what one drive told, others confirmed so much
  const int64_t first_s = evidence.OldestPassS();
  for (const LeanLandmark& landmark : tile.map.landmarks) {
    const auto time_s = evidence.TimeOf(landmark.id.drive);
    if (!time_s || *time_s < since_s || *time_s <= first_s) continue;
    changes.appeared.push_back({root_from_tile * landmark.position_in_map,
                                evidence.IsAwaited(landmark.id) ? kOneDrive : 1, *time_s});
  }
}

}  // namespace

absl::StatusOr<std::vector<StreetChange>> FindStreetChanges(const BaseMap& base, int64_t since_s,
                                                            const StreetChangeOptions& options) {
  std::map<uint32_t, CellGrid> grids;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base.Components());
  for (const Component& component : components) {
    if (component.grid.is_on_earth) grids[component.id] = component.grid;
  }
  std::vector<TileId> tiles;
  CARMAP_RETURN_IF_ERROR(VisitEvidence(base.reader(), [&](TileId tile) { tiles.push_back(tile); }));
  std::map<uint32_t, ComponentChanges> of_component;
  for (const TileId& id : tiles) {
    const auto grid = grids.find(id.component);
    if (grid == grids.end()) continue;
    const Rigid3 root_from_tile = RootFromTile(grid->second, id.cell);
    CARMAP_ASSIGN_OR_RETURN(const StoredEvidence stored, ReadEvidence(base.reader(), id));
    CARMAP_ASSIGN_OR_RETURN(const auto tile, base.Read(id));
    ComponentChanges& changes = of_component[id.component];
    AddVanished(stored.evidence, root_from_tile, since_s, changes);
    if (tile) AddAppeared(*tile, stored.evidence, root_from_tile, since_s, changes);
  }
  std::vector<StreetChange> found;
  for (const auto& [component, changes] : of_component) {
    for (const bool has_vanished : {false, true}) {
      const auto& landmarks = has_vanished ? changes.vanished : changes.appeared;
      for (const auto& group : GroupsOf(landmarks, options.thing_m)) {
        if (group.size() < options.min_landmarks) continue;
        StreetChange change = ChangeOf(landmarks, group);
        change.has_vanished = has_vanished;
        change.component = component;
        found.push_back(change);
      }
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const StreetChange& a, const StreetChange& b) {
    return a.since_s < b.since_s;
  });
  return found;
}

}  // namespace carmap
