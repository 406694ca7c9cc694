// A tile of the base map, and the patches that make one version of it another.
//
// A tile is a component's share of a cell (geometry/cell_grid.h), a lean map in the cell's own
// frame: the keyframes that belong to it, the landmarks that are anchored at them, and stubs, the
// poses of keyframes of other tiles that see these landmarks too. So it is whole by itself. A patch
// carries values, never computations: whoever applies it gets the same tile. Plain values; the
// functions are pure and thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// A tile without keyframes is none: it is not kept.
struct Tile {
  TileId id;
  uint64_t version = 0;  ///< 0: before the first
  LeanMap map;
};

/// What a tile became.
struct Patch {
  TileId tile;
  uint64_t from_version = 0, to_version = 0;
  /// Records as they are afterwards, with all keyframes that the landmarks refer to, in the tile's
  /// frame.
  LeanMap put;
  std::vector<KeyframeId> removed_keyframes;  ///< ascending; lists that name them are put, too
  std::vector<LandmarkId> removed_landmarks;  ///< ascending
  uint64_t hash = 0;                          ///< HashOf the tile afterwards
};

/// The tile as the patch leaves it; its hash is not looked at (format/tile_codec.h). Landmarks ride
/// on their anchors: one whose anchor moves, moves along. Stubs that see nothing, and drives that
/// nothing refers to, go by themselves. Errors: FailedPrecondition (the patch is of another tile or
/// starts from another version), InvalidArgument (what it leaves is not consistent, or it removes
/// what is not there).
absl::StatusOr<Tile> Applied(const Patch& patch, const Tile& tile);

/// Whether it changes nothing but the version.
bool IsEmpty(const Patch& patch);

/// The smallest patch that makes `to` of `from`, two versions of a tile. Its hash is 0.
Patch DifferenceOf(const Tile& from, const Tile& to);

/// Where tiles come from. Errors: those of reading it, naming the tile; nothing if there is none.
class TileSource {
 public:
  virtual ~TileSource() = default;
  virtual absl::StatusOr<std::shared_ptr<const Tile>> Read(TileId id) const = 0;
};

}  // namespace carmap
