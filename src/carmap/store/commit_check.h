// What every store refuses, in the same words. Stateless, thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "carmap/base/ids.h"
#include "carmap/store/map_store.h"

namespace carmap {

/// How messages name a tile: its component, and its cell in hexadecimal digits.
std::string NameOf(TileId tile);

/// What a commit is checked against.
struct StoreContents {
  std::string name;  ///< of the store, for messages
  /// Version 0 if there never was such a tile.
  std::function<absl::StatusOr<TileVersion>(TileId)> find_tile;
  std::function<absl::StatusOr<bool>(std::string_view)> has_contribution;
};

/// Errors: those of MapStore::Apply that do not come from a disk.
absl::Status CheckCommit(const Commit& commit, const StoreContents& contents);

/// OutOfRange: the patches that follow that version are no longer kept.
absl::Status PatchesDropped(const std::string& store, TileId tile, uint64_t after_version);

}  // namespace carmap
