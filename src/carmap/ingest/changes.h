// What a contribution makes of the base before it is committed: tiles that differ from the stored
// ones, and the commit that makes them so, all or none.
//
// Nobody else sees it. Not thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "carmap/feature/vocabulary.h"
#include "carmap/index/map_view.h"
#include "carmap/ingest/base_map.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/tile.h"
#include "carmap/store/map_store.h"

namespace carmap {

/// What the commit makes of its tiles.
std::vector<TileVersion> VersionsAfter(const Commit& commit);
/// What vehicles will fetch for it.
uint64_t PatchBytesOf(const Commit& commit);

class Changes : public TileSource {
 public:
  /// The base must outlive the changes.
  explicit Changes(const BaseMap& base) : base_(base) {}

  /// As changed; null if there is none, or nothing is left of it.
  absl::StatusOr<std::shared_ptr<const Tile>> Read(TileId id) const override;

  /// The tiles that are there, as one. Errors: those of Read.
  absl::StatusOr<MapView> View(const Component& component, uint64_t frame_cell,
                               const std::vector<TileId>& tiles) const;

  /// The view's map became `merged`, in its frame. Keyframes that are new belong to the tile of the
  /// cell where they stand; the view must have all tiles there that exist. Errors: InvalidArgument
  /// (what a tile becomes is not consistent), those of Read.
  absl::Status Replace(const Component& component, const MapView& view, const LeanMap& merged);

  /// The tile becomes this; its version does not matter.
  absl::Status Put(Tile tile);

  /// Tiles that differ from the base's, ascending. Their versions are those that they will have.
  std::vector<std::shared_ptr<const Tile>> Changed() const;

  /// Fills commit.tiles. The vocabulary is that of the words kept beside the tiles. Errors: those
  /// of Read and of encoding.
  absl::Status AddTo(const Vocabulary& vocabulary, Commit& commit) const;

 private:
  absl::StatusOr<Tile> Before(TileId id) const;

  const BaseMap& base_;
  std::map<TileId, std::shared_ptr<const Tile>> changed_;
};

}  // namespace carmap
