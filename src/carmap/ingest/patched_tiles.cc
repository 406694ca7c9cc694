#include "carmap/ingest/patched_tiles.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/format/tile_codec.h"
#include "carmap/geometry/cell_grid.h"

namespace carmap {

void PatchedTiles::Add(Patch patch) {
  const TileId tile = patch.tile;
  const uint64_t version = patch.to_version;
  patches_[tile].try_emplace(version, std::move(patch));
}

absl::StatusOr<std::shared_ptr<const Tile>> PatchedTiles::Read(TileId id) const {
  const auto patches = patches_.find(id);
  if (patches == patches_.end()) return base_.Read(id);
  std::shared_ptr<const Tile> tile;
  if (const auto patched = patched_.find(id); patched != patched_.end()) {
    tile = patched->second;
  } else {
    CARMAP_ASSIGN_OR_RETURN(tile, base_.Read(id));
    if (!tile) {
      CARMAP_ASSIGN_OR_RETURN(const uint64_t version, base_.reader().VersionOf(id));
      tile = std::make_shared<const Tile>(Tile{id, version, {}});
    }
  }
  for (auto next = patches->second.find(tile->version + 1); next != patches->second.end();
       next = patches->second.find(tile->version + 1)) {
    auto after = AppliedAndVerified(next->second, *tile);
    if (!after.ok()) {
      const std::string fault = fmt::format("tile {}/{:016x}: {}", id.component, id.cell,
                                            std::string(after.status().message()));
      if (std::find(faults_.begin(), faults_.end(), fault) == faults_.end()) {
        faults_.push_back(fault);
      }
      break;
    }
    ++applied_;
    tile = std::make_shared<const Tile>(*std::move(after));
  }
  patched_[id] = tile;
  if (tile->map.keyframes.empty()) return std::shared_ptr<const Tile>();
  return tile;
}

absl::StatusOr<std::vector<TileId>> PatchedTiles::Near(
    const Component& component, const std::vector<Eigen::Vector3d>& places_in_root,
    double radius_m) const {
  CARMAP_ASSIGN_OR_RETURN(std::vector<TileId> tiles,
                          TilesNear(base_.reader(), component, places_in_root, radius_m));
  if (patches_.empty()) return tiles;
  std::set<TileId> near(tiles.begin(), tiles.end());
  for (const Eigen::Vector3d& place : places_in_root) {
    for (const uint64_t cell : CellsNear(component.grid, place, radius_m)) {
      const TileId id{component.id, cell};
      if (patches_.contains(id)) near.insert(id);
    }
  }
  return std::vector<TileId>(near.begin(), near.end());
}

}  // namespace carmap
