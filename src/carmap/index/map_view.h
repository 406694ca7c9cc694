// Some tiles of a component as one map (paper §3.5): what localization and fitting work with.
//
// Nothing but these tiles is touched, read or copied, and indexes are built when they are asked
// for. Immutable, thread-safe. When a tile changes, or others are needed, a new view takes the
// place of the old one; poses stay what they are where both have one frame.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/geometry/cell_grid.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/tile.h"

namespace carmap {

class MapView {
 public:
  /// Of tiles of one component, none twice, in any order. The view's frame is that of the cell
  /// `frame_cell` (RootFromView), whether the view has its tile or not.
  MapView(const CellGrid& grid, uint64_t frame_cell,
          std::vector<std::shared_ptr<const Tile>> tiles);

  const CellGrid& grid() const { return grid_; }
  uint64_t frame_cell() const { return frame_cell_; }
  const Rigid3& root_from_view() const { return root_from_view_; }
  /// Ascending by id.
  const std::vector<std::shared_ptr<const Tile>>& tiles() const { return tiles_; }

  /// In the view's frame. Stubs are of keyframes whose tiles the view lacks. On the Earth every
  /// keyframe has the fix that its pose stands for.
  const LeanMap& map() const { return map_; }
  /// Index into tiles() of the tile that a keyframe of the map belongs to; its number for a stub.
  uint32_t TileOf(uint32_t keyframe_idx) const { return tile_of_keyframe_[keyframe_idx]; }

  /// The map rebuilt for a camera of this focal length; built anew each time.
  std::shared_ptr<const ReconstructedMap> Rebuild(double focal_length_px) const;

 private:
  void Assemble();

  CellGrid grid_;
  uint64_t frame_cell_ = 0;
  Rigid3 root_from_view_;
  std::vector<std::shared_ptr<const Tile>> tiles_;
  LeanMap map_;
  std::vector<uint32_t> tile_of_keyframe_;
};

}  // namespace carmap
