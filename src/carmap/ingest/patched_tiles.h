// The tiles of a base as patches that came since have made them: what a vehicle drives in that
// opened the base a while ago.
//
// A patch that does not follow on its tile's version waits for those between. Not thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/ingest/base_map.h"
#include "carmap/map/tile.h"

namespace carmap {

class PatchedTiles : public TileSource {
 public:
  /// The base must outlive it.
  explicit PatchedTiles(const BaseMap& base) : base_(base) {}

  /// In any order, and more than once.
  void Add(Patch patch);

  /// The base's tile with the patches that follow on it; null if there is none. A patch that leaves
  /// another tile than it should is left out, with all after it, and told of in faults(). Errors:
  /// as BaseMap::Read.
  absl::StatusOr<std::shared_ptr<const Tile>> Read(TileId id) const override;

  /// As TilesNear, with tiles that patches tell of alone.
  absl::StatusOr<std::vector<TileId>> Near(const Component& component,
                                           const std::vector<Eigen::Vector3d>& places_in_root,
                                           double radius_m) const;

  const BaseMap& base() const { return base_; }
  /// Patches that could not be applied, a line each.
  const std::vector<std::string>& faults() const { return faults_; }
  size_t applied() const { return applied_; }

 private:
  const BaseMap& base_;
  std::map<TileId, std::map<uint64_t, Patch>> patches_;  ///< by the version that they lead to
  mutable std::map<TileId, std::shared_ptr<const Tile>> patched_;
  mutable std::vector<std::string> faults_;
  mutable size_t applied_ = 0;
};

}  // namespace carmap
