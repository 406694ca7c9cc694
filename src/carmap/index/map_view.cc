#include "carmap/index/map_view.h"

#include <algorithm>
#include <utility>

#include "carmap/map/by_id.h"

namespace carmap {
namespace {

constexpr auto kSameId = [](const auto& a, const auto& b) { return a.id == b.id; };

/// A keyframe as one of the tiles has it.
struct TileKeyframe {
  LeanKeyframe keyframe;  ///< in the view's frame
  uint32_t tile = 0;      ///< that it belongs to; their number for a stub

  /// A tile's own keyframe comes before stubs of it.
  bool operator<(const TileKeyframe& other) const {
    return std::pair(keyframe.id, keyframe.is_stub) <
           std::pair(other.keyframe.id, other.keyframe.is_stub);
  }
};

}  // namespace

MapView::MapView(const CellGrid& grid, uint64_t frame_cell,
                 std::vector<std::shared_ptr<const Tile>> tiles)
    : grid_(grid),
      frame_cell_(frame_cell),
      root_from_view_(RootFromView(grid, frame_cell)),
      tiles_(std::move(tiles)) {
  std::sort(tiles_.begin(), tiles_.end(),
            [](const auto& a, const auto& b) { return a->id < b->id; });
  Assemble();
}

void MapView::Assemble() {
  const auto stub_of_none = static_cast<uint32_t>(tiles_.size());
  std::vector<TileKeyframe> keyframes;
  for (uint32_t t = 0; t < tiles_.size(); ++t) {
    const Tile& tile = *tiles_[t];
    const Rigid3 view_from_tile = root_from_view_.Inverse() * RootFromTile(grid_, tile.id.cell);
    for (LeanKeyframe keyframe : tile.map.keyframes) {
      keyframe.map_from_camera = view_from_tile * keyframe.map_from_camera;
      keyframes.push_back({keyframe, keyframe.is_stub ? stub_of_none : t});
    }
    map_.drives.insert(map_.drives.end(), tile.map.drives.begin(), tile.map.drives.end());
  }
  std::stable_sort(map_.drives.begin(), map_.drives.end(), kById);
  map_.drives.erase(std::unique(map_.drives.begin(), map_.drives.end(), kSameId),
                    map_.drives.end());
  std::stable_sort(keyframes.begin(), keyframes.end());
  for (TileKeyframe& candidate : keyframes) {
    if (!map_.keyframes.empty() && map_.keyframes.back().id == candidate.keyframe.id) continue;
    if (grid_.is_on_earth) {
      candidate.keyframe.gps =
          GpsOfEcef(root_from_view_ * candidate.keyframe.map_from_camera.translation);
    }
    map_.keyframes.push_back(candidate.keyframe);
    tile_of_keyframe_.push_back(candidate.tile);
  }

  for (const auto& tile : tiles_) {
    const Rigid3 view_from_tile = root_from_view_.Inverse() * RootFromTile(grid_, tile->id.cell);
    std::vector<uint32_t> places;
    auto place = map_.keyframes.begin();
    for (const LeanKeyframe& keyframe : tile->map.keyframes) {
      place = std::lower_bound(place, map_.keyframes.end(), keyframe, kById);
      places.push_back(static_cast<uint32_t>(place - map_.keyframes.begin()));
    }
    for (LeanLandmark landmark : tile->map.landmarks) {
      landmark.position_in_map = view_from_tile * landmark.position_in_map;
      for (uint32_t& idx : landmark.keyframe_idxs) idx = places[idx];
      landmark.anchor_idx = places[landmark.anchor_idx];
      map_.landmarks.push_back(std::move(landmark));
    }
  }
  std::sort(map_.landmarks.begin(), map_.landmarks.end(), kById);
}

std::shared_ptr<const ReconstructedMap> MapView::Rebuild(double focal_length_px) const {
  return std::make_shared<const ReconstructedMap>(Reconstruct(map_, focal_length_px));
}

}  // namespace carmap
