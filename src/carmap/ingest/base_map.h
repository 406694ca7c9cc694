// The base map as one thing: components, tiles and the store that keeps them.
//
// Reads only the tiles that are asked for and remembers the last ones. What changes it goes through
// Changes (changes.h) and is committed at once. Thread-safe but for Commit, of which one thread at
// a time makes use.
#pragma once

#include <absl/base/thread_annotations.h>
#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <absl/synchronization/mutex.h>

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/cell_grid.h"
#include "carmap/map/tile.h"
#include "carmap/store/map_store.h"

namespace carmap {

/// A part of the base that hangs together visually.
struct Component {
  uint32_t id = 0;
  CellGrid grid;
  double sigma_m = 0;  ///< of its place on the Earth, each horizontal axis; 0 without GPS
};

/// Puts it into the store.
std::string EncodeComponent(const Component& component);

class BaseMap : public TileSource {
 public:
  /// Makes the folder and an empty base in it. Errors: as CreateRocksStore.
  static absl::StatusOr<std::unique_ptr<BaseMap>> Create(const std::filesystem::path& folder);
  /// Errors: as OpenRocksStore; Unimplemented for a base of a newer version.
  static absl::StatusOr<std::unique_ptr<BaseMap>> Open(const std::filesystem::path& folder,
                                                       StoreAccess access);
  /// Of a store that was made with NewHeader.
  static absl::StatusOr<std::unique_ptr<BaseMap>> Over(std::unique_ptr<MapStore> store,
                                                       std::string name);
  /// What a store of a base is made with.
  static std::string NewHeader();

  const std::string& name() const { return name_; }
  int cell_level() const { return cell_level_; }
  const MapReader& reader() const { return *store_; }
  MapStore& store() { return *store_; }

  /// Ascending by id. Errors: those of the store.
  absl::StatusOr<std::vector<Component>> Components() const;

  /// Null if there is no such tile.
  absl::StatusOr<std::shared_ptr<const Tile>> Read(TileId id) const override;

  /// Tiles of this cell of components on the Earth, ascending; those that are there. The first call
  /// lists all tiles, without reading one. Errors: those of the store.
  absl::StatusOr<std::vector<TileId>> EarthTilesAt(uint64_t cell) const;

  /// As MapStore::Apply.
  absl::StatusOr<uint64_t> Apply(const Commit& commit);

 private:
  BaseMap(std::unique_ptr<MapStore> store, std::string name, int cell_level)
      : store_(std::move(store)), name_(std::move(name)), cell_level_(cell_level) {}

  struct Remembered {
    std::shared_ptr<const Tile> tile;
    std::list<TileId>::iterator place;
  };

  const std::unique_ptr<MapStore> store_;
  const std::string name_;
  const int cell_level_;
  absl::Status ListEarthTiles() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable absl::Mutex mutex_;
  /// Of each cell the components with GPS that have a tile there.
  mutable std::optional<std::map<uint64_t, std::set<uint32_t>>> earth_tiles_
      ABSL_GUARDED_BY(mutex_);
  mutable std::map<TileId, Remembered> remembered_ ABSL_GUARDED_BY(mutex_);
  mutable std::list<TileId> newest_first_ ABSL_GUARDED_BY(mutex_);
};

/// All tiles of the component that are there, ascending. Lists all tiles of the base and reads
/// none. Errors: those of the store.
absl::StatusOr<std::vector<TileId>> TilesOf(const MapReader& reader, uint32_t component);

/// The component's tiles with a point within `radius_m` of one of the places, ascending, each once:
/// those that are, or once were, there. Errors: those of the store.
absl::StatusOr<std::vector<TileId>> TilesNear(const MapReader& reader, const Component& component,
                                              const std::vector<Eigen::Vector3d>& places_in_root,
                                              double radius_m);

}  // namespace carmap
