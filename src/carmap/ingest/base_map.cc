#include "carmap/ingest/base_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/format/tile_codec.h"

namespace carmap {
namespace {

constexpr int kBaseVersion = 1;
constexpr size_t kRememberedTiles = 64;

absl::Status Damaged(const std::string& name, const char* what) {
  return absl::DataLossError(
      fmt::format("{}: {} cannot be read; `carmap base verify {} --repair` rebuilds what it can",
                  name, what, name));
}

absl::StatusOr<Component> DecodeComponent(uint32_t id, const std::string& text,
                                          const std::string& name) {
  const auto json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("on_earth") || !json["on_earth"].is_boolean() ||
      !json.contains("level") || !json["level"].is_number_integer() || !json.contains("sigma_m") ||
      !json["sigma_m"].is_number()) {
    return Damaged(name, "the list of components");
  }
  Component component{
      .id = id, .grid = {json["on_earth"], json["level"]}, .sigma_m = json["sigma_m"]};
  if (component.grid.level < 0 || component.grid.level > 30) {
    return Damaged(name, "the list of components");
  }
  return component;
}

}  // namespace

std::string EncodeComponent(const Component& component) {
  return nlohmann::json{{"on_earth", component.grid.is_on_earth},
                        {"level", component.grid.level},
                        {"sigma_m", component.sigma_m}}
      .dump();
}

std::string BaseMap::NewHeader() {
  return nlohmann::json{{"carmap_base", kBaseVersion}, {"cell_level", CellGrid().level}}.dump();
}

absl::StatusOr<std::unique_ptr<BaseMap>> BaseMap::Create(const std::filesystem::path& folder) {
  CARMAP_ASSIGN_OR_RETURN(auto store, CreateRocksStore(folder, NewHeader()));
  return Over(std::move(store), folder.string());
}

absl::StatusOr<std::unique_ptr<BaseMap>> BaseMap::Open(const std::filesystem::path& folder,
                                                       StoreAccess access) {
  CARMAP_ASSIGN_OR_RETURN(auto store, OpenRocksStore(folder, access));
  return Over(std::move(store), folder.string());
}

absl::StatusOr<std::unique_ptr<BaseMap>> BaseMap::Over(std::unique_ptr<MapStore> store,
                                                       std::string name) {
  CARMAP_ASSIGN_OR_RETURN(const std::string header, store->Header());
  const auto json = nlohmann::json::parse(header, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("carmap_base") ||
      !json["carmap_base"].is_number_integer() || !json.contains("cell_level") ||
      !json["cell_level"].is_number_integer()) {
    return Damaged(name, "the base's header");
  }
  if (json["carmap_base"] > kBaseVersion) {
    return absl::UnimplementedError(
        fmt::format("{}: was made by a newer carmap; upgrade carmap", name));
  }
  const int cell_level = json["cell_level"];
  return std::unique_ptr<BaseMap>(new BaseMap(std::move(store), std::move(name), cell_level));
}

absl::StatusOr<std::vector<Component>> BaseMap::Components() const {
  CARMAP_ASSIGN_OR_RETURN(const auto stored, store_->ReadComponents());
  std::vector<Component> components;
  for (const auto& [id, text] : stored) {
    CARMAP_ASSIGN_OR_RETURN(const Component component, DecodeComponent(id, text, name_));
    components.push_back(component);
  }
  return components;
}

absl::StatusOr<std::shared_ptr<const Tile>> BaseMap::Read(TileId id) const {
  CARMAP_ASSIGN_OR_RETURN(const uint64_t version, store_->VersionOf(id));
  {
    const absl::MutexLock lock(&mutex_);
    if (const auto found = remembered_.find(id);
        found != remembered_.end() && found->second.tile->version == version) {
      newest_first_.splice(newest_first_.begin(), newest_first_, found->second.place);
      return found->second.tile;
    }
  }
  CARMAP_ASSIGN_OR_RETURN(const std::optional<StoredTile> stored, store_->ReadTile(id));
  if (!stored) return std::shared_ptr<const Tile>();
  const std::string tile_name = fmt::format("{}: tile {}/{:016x}", name_, id.component, id.cell);
  CARMAP_ASSIGN_OR_RETURN(Tile decoded, DecodeTile(stored->bytes, tile_name));
  if (decoded.id != id || decoded.version != stored->version) {
    return absl::DataLossError(
        fmt::format("{}: another tile, or another version, lies in its place; "
                    "`carmap base verify {} --repair` rebuilds it",
                    tile_name, name_));
  }
  auto tile = std::make_shared<const Tile>(std::move(decoded));
  const absl::MutexLock lock(&mutex_);
  if (const auto old = remembered_.find(id); old != remembered_.end()) {
    newest_first_.erase(old->second.place);
    remembered_.erase(old);
  }
  newest_first_.push_front(id);
  remembered_[id] = {tile, newest_first_.begin()};
  if (remembered_.size() > kRememberedTiles) {
    remembered_.erase(newest_first_.back());
    newest_first_.pop_back();
  }
  return tile;
}

absl::Status BaseMap::ListEarthTiles() const {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, Components());
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, store_->ListTiles());
  std::set<uint32_t> on_earth;
  for (const Component& component : components) {
    if (component.grid.is_on_earth) on_earth.insert(component.id);
  }
  earth_tiles_.emplace();
  for (const TileVersion& tile : tiles) {
    if (tile.is_removed || !on_earth.contains(tile.tile.component)) continue;
    (*earth_tiles_)[tile.tile.cell].insert(tile.tile.component);
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<TileId>> BaseMap::EarthTilesAt(uint64_t cell) const {
  const absl::MutexLock lock(&mutex_);
  if (!earth_tiles_) CARMAP_RETURN_IF_ERROR(ListEarthTiles());
  std::vector<TileId> tiles;
  const auto found = earth_tiles_->find(cell);
  if (found == earth_tiles_->end()) return tiles;
  for (const uint32_t component : found->second) tiles.push_back({component, cell});
  return tiles;
}

absl::StatusOr<uint64_t> BaseMap::Apply(const Commit& commit) {
  CARMAP_ASSIGN_OR_RETURN(const uint64_t sequence, store_->Apply(commit));
  const absl::MutexLock lock(&mutex_);
  if (!earth_tiles_) return sequence;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, Components());
  for (const TileChange& change : commit.tiles) {
    const auto component = std::find_if(components.begin(), components.end(), [&](const auto& c) {
      return c.id == change.tile.component;
    });
    auto& there = (*earth_tiles_)[change.tile.cell];
    if (change.bytes && component != components.end() && component->grid.is_on_earth) {
      there.insert(change.tile.component);
    } else {
      there.erase(change.tile.component);
    }
  }
  return sequence;
}

absl::StatusOr<std::vector<TileId>> TilesOf(const MapReader& reader, uint32_t component) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> all, reader.ListTiles());
  std::vector<TileId> tiles;
  for (const TileVersion& tile : all) {
    if (tile.tile.component == component && !tile.is_removed) tiles.push_back(tile.tile);
  }
  return tiles;
}

absl::StatusOr<std::vector<TileId>> TilesNear(const MapReader& reader, const Component& component,
                                              const std::vector<Eigen::Vector3d>& places_in_root,
                                              double radius_m) {
  std::set<uint64_t> cells;
  for (const Eigen::Vector3d& place : places_in_root) {
    for (const uint64_t cell : CellsNear(component.grid, place, radius_m)) cells.insert(cell);
  }
  std::vector<TileId> tiles;
  for (const uint64_t cell : cells) {
    const TileId id{component.id, cell};
    CARMAP_ASSIGN_OR_RETURN(const uint64_t version, reader.VersionOf(id));
    if (version > 0) tiles.push_back(id);
  }
  return tiles;
}

}  // namespace carmap
