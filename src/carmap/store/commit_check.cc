#include "carmap/store/commit_check.h"

#include <fmt/format.h>

#include <set>

#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

absl::Status Twice(const std::string& store, const std::string& what) {
  return absl::InvalidArgumentError(
      fmt::format("{}: {} stands twice in one commit; merge its changes", store, what));
}

absl::Status CheckKey(std::string_view key, const std::string& store) {
  if (key.size() <= kMaxKeySize) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format(
      "{}: a contribution's key of {} bytes; use at most {}", store, key.size(), kMaxKeySize));
}

absl::Status CheckNames(const Commit& commit, const std::string& store) {
  std::set<TileId> tiles;
  for (const TileChange& change : commit.tiles) {
    if (!tiles.insert(change.tile).second) return Twice(store, NameOf(change.tile));
  }
  std::set<uint32_t> components;
  for (const auto& [component, bytes] : commit.components) {
    if (!components.insert(component).second) {
      return Twice(store, fmt::format("component {}", component));
    }
  }
  std::set<std::string_view> keys;
  for (const auto& [key, value] : commit.contributions) {
    CARMAP_RETURN_IF_ERROR(CheckKey(key, store));
    if (!keys.insert(key).second) return Twice(store, fmt::format("contribution {}", key));
  }
  for (const std::string& key : commit.withdrawn) {
    CARMAP_RETURN_IF_ERROR(CheckKey(key, store));
    if (!keys.insert(key).second) return Twice(store, fmt::format("contribution {}", key));
  }
  return absl::OkStatus();
}

absl::Status CheckTile(const TileChange& change, const StoreContents& contents) {
  CARMAP_ASSIGN_OR_RETURN(const TileVersion found, contents.find_tile(change.tile));
  if (found.version != change.from_version) {
    return absl::AbortedError(fmt::format("{}: {} has version {}, not {}; read it again",
                                          contents.name, NameOf(change.tile), found.version,
                                          change.from_version));
  }
  if (!change.bytes && (found.version == 0 || found.is_removed)) {
    return absl::InvalidArgumentError(
        fmt::format("{}: {} is to be removed but is not there; leave it out of the commit",
                    contents.name, NameOf(change.tile)));
  }
  return absl::OkStatus();
}

}  // namespace

std::string NameOf(TileId tile) {
  return fmt::format("tile {}/{:016x}", tile.component, tile.cell);
}

absl::Status CheckCommit(const Commit& commit, const StoreContents& contents) {
  CARMAP_RETURN_IF_ERROR(CheckNames(commit, contents.name));
  for (const TileChange& change : commit.tiles) {
    CARMAP_RETURN_IF_ERROR(CheckTile(change, contents));
  }
  for (const auto& [key, value] : commit.contributions) {
    CARMAP_ASSIGN_OR_RETURN(const bool is_there, contents.has_contribution(key));
    if (is_there) {
      return absl::AlreadyExistsError(fmt::format(
          "{}: contribution {} is there already; do not commit it again", contents.name, key));
    }
  }
  return absl::OkStatus();
}

absl::Status PatchesDropped(const std::string& store, TileId tile, uint64_t after_version) {
  return absl::OutOfRangeError(
      fmt::format("{}: the patches of {} that follow version {} are no longer kept; read the tile",
                  store, NameOf(tile), after_version));
}

}  // namespace carmap
