#include "apps/carmap/base_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "apps/carmap/reports.h"
#include "carmap/base/status_macros.h"
#include "carmap/eval/map_picture.h"
#include "carmap/geometry/cell_grid.h"
#include "carmap/ingest/changes.h"

namespace carmap {
namespace {

constexpr Rgb kTileColour{190, 200, 215}, kAddedColour{220, 50, 32};

bool IsOf(const LeanKeyframe& keyframe, const std::vector<DriveId>& drives) {
  return std::find(drives.begin(), drives.end(), keyframe.id.drive) != drives.end();
}

absl::StatusOr<MapView> Choose(const BaseMap& base, std::optional<uint32_t> wanted,
                               const std::vector<DriveId>& drives) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base.Components());
  std::optional<MapView> largest;
  for (const Component& component : components) {
    if (wanted && component.id != *wanted) continue;
    CARMAP_ASSIGN_OR_RETURN(MapView view, WholeComponent(base, component));
    const bool has_drive =
        std::any_of(view.map().keyframes.begin(), view.map().keyframes.end(),
                    [&](const LeanKeyframe& keyframe) { return IsOf(keyframe, drives); });
    if (has_drive) return view;
    if (!largest || largest->map().landmarks.size() < view.map().landmarks.size()) {
      largest = std::move(view);
    }
  }
  if (largest) return *std::move(largest);
  return absl::NotFoundError(fmt::format(
      "{}: has no such component; `carmap base info {}` lists them", base.name(), base.name()));
}

/// Lines have no gaps, so each tile is a path of its own; the legend names the first.
void AddTiles(const MapView& view, std::vector<PicturePath>& paths) {
  const Rigid3 view_from_root = view.root_from_view().Inverse();
  for (const auto& tile : view.tiles()) {
    PicturePath outline{paths.empty() ? "tiles" : "", kTileColour, {}};
    for (const Eigen::Vector3d& corner : CornersOf(view.grid(), tile->id.cell)) {
      outline.positions_in_map.push_back(view_from_root * corner);
    }
    outline.positions_in_map.push_back(outline.positions_in_map.front());
    paths.push_back(std::move(outline));
  }
}

}  // namespace

absl::StatusOr<MapView> WholeComponent(const BaseMap& base, const Component& component) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> tiles, TilesOf(base.reader(), component.id));
  if (tiles.empty()) return MapView(component.grid, 0, {});
  return Changes(base).View(component, tiles.front().cell, tiles);
}

absl::Status WriteBasePicture(const std::string& path, const BaseMap& base,
                              std::optional<uint32_t> component,
                              const std::vector<DriveId>& drives) {
  CARMAP_ASSIGN_OR_RETURN(const MapView view, Choose(base, component, drives));
  std::vector<PicturePath> paths;
  AddTiles(view, paths);
  MapPicture picture =
      PictureOf(view.map(),
                fmt::format("{}, component {}", NameOf(base.name()),
                            view.tiles().empty() ? 0 : view.tiles().front()->id.component),
                std::move(paths));
  PicturePath added{"added", kAddedColour, {}, /*as_dots=*/true};
  for (const LeanKeyframe& keyframe : view.map().keyframes) {
    if (IsOf(keyframe, drives))
      added.positions_in_map.push_back(keyframe.map_from_camera.translation);
  }
  if (!added.positions_in_map.empty()) picture.paths.push_back(std::move(added));
  return WriteMapPicture(path, picture);
}

}  // namespace carmap
