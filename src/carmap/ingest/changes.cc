#include "carmap/ingest/changes.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/tile_words.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

bool AreSame(const Rigid3& a, const Rigid3& b) {
  return a.translation == b.translation && a.rotation.coeffs() == b.rotation.coeffs();
}

/// Cuts what became of a view's map into patches of tiles.
class Cutter {
 public:
  Cutter(const Component& component, const MapView& view, const LeanMap& merged)
      : component_(component),
        view_(view),
        whole_(DifferenceOf({{}, 0, view.map()}, {{}, 0, merged})),
        merged_(merged) {
    for (const LeanKeyframe& keyframe : whole_.put.keyframes) owners_.push_back(OwnerOf(keyframe));
  }

  /// Without versions and hashes.
  std::vector<Patch> Run() {
    AssignKeyframes();
    AssignLandmarks();
    std::vector<Patch> patches;
    for (const auto& [tile, share] : shares_) patches.push_back(PatchOf(tile, share));
    return patches;
  }

 private:
  /// What one tile gets: indices into what was put, and what is removed.
  struct Share {
    std::set<uint32_t> keyframe_idxs;
    std::vector<uint32_t> landmark_idxs;
    std::vector<KeyframeId> removed_keyframes;
    std::vector<LandmarkId> removed_landmarks;
  };

  /// Keyframes stay with their tiles, new ones go where they stand. Nothing for one of a tile that
  /// the view lacks.
  std::optional<TileId> OwnerOf(const LeanKeyframe& keyframe) const {
    const LeanKeyframe* known = FindById(view_.map().keyframes, keyframe.id);
    if (known == nullptr) {
      const Eigen::Vector3d center = view_.root_from_view() * keyframe.map_from_camera.translation;
      return TileId{component_.id, CellAt(component_.grid, center)};
    }
    const uint32_t tile = view_.TileOf(static_cast<uint32_t>(known - view_.map().keyframes.data()));
    if (tile == view_.tiles().size()) return std::nullopt;
    return view_.tiles()[tile]->id;
  }

  /// New and moved ones to their tiles and to those that have a stub.
  void AssignKeyframes() {
    for (uint32_t i = 0; i < whole_.put.keyframes.size(); ++i) {
      const LeanKeyframe& keyframe = whole_.put.keyframes[i];
      if (IsAsItWas(keyframe)) continue;
      if (owners_[i]) shares_[*owners_[i]].keyframe_idxs.insert(i);
      for (const auto& tile : view_.tiles()) {
        if (FindById(tile->map.keyframes, keyframe.id)) shares_[tile->id].keyframe_idxs.insert(i);
      }
    }
    for (const KeyframeId& id : whole_.removed_keyframes) {
      for (const auto& tile : view_.tiles()) {
        if (FindById(tile->map.keyframes, id)) shares_[tile->id].removed_keyframes.push_back(id);
      }
    }
  }

  /// With all that see them to the tiles of their anchors.
  void AssignLandmarks() {
    for (uint32_t i = 0; i < whole_.put.landmarks.size(); ++i) {
      const LeanLandmark& landmark = whole_.put.landmarks[i];
      const auto& owner = owners_[landmark.anchor_idx];
      if (!owner) continue;
      Share& share = shares_[*owner];
      share.landmark_idxs.push_back(i);
      share.keyframe_idxs.insert(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end());
      // Its anchor may be another than it was, of another tile.
      for (const auto& tile : view_.tiles()) {
        if (tile->id == *owner || !FindById(tile->map.landmarks, landmark.id)) continue;
        shares_[tile->id].removed_landmarks.push_back(landmark.id);
      }
    }
    for (const LandmarkId& id : whole_.removed_landmarks) {
      for (const auto& tile : view_.tiles()) {
        if (FindById(tile->map.landmarks, id)) shares_[tile->id].removed_landmarks.push_back(id);
      }
    }
  }

  bool IsAsItWas(const LeanKeyframe& keyframe) const {
    const LeanKeyframe* known = FindById(view_.map().keyframes, keyframe.id);
    return known != nullptr && AreSame(known->map_from_camera, keyframe.map_from_camera);
  }

  const Tile* TileInView(TileId id) const {
    for (const auto& tile : view_.tiles()) {
      if (tile->id == id) return tile.get();
    }
    return nullptr;
  }

  /// One that has not moved stays, to the last bit, what it is in the tile.
  LeanKeyframe KeyframeInTile(uint32_t idx, TileId tile_id, const Rigid3& tile_from_view) const {
    LeanKeyframe keyframe = whole_.put.keyframes[idx];
    const Tile* tile = TileInView(tile_id);
    const LeanKeyframe* in_tile = tile ? FindById(tile->map.keyframes, keyframe.id) : nullptr;
    if (in_tile != nullptr && IsAsItWas(keyframe)) return *in_tile;
    keyframe.map_from_camera = tile_from_view * keyframe.map_from_camera;
    keyframe.is_stub = owners_[idx] != tile_id;
    if (component_.grid.is_on_earth || keyframe.is_stub) keyframe.gps.reset();
    return keyframe;
  }

  Patch PatchOf(TileId tile, const Share& share) const {
    Patch patch{.tile = tile,
                .removed_keyframes = share.removed_keyframes,
                .removed_landmarks = share.removed_landmarks};
    const Rigid3 tile_from_view =
        RootFromTile(component_.grid, tile.cell).Inverse() * view_.root_from_view();
    std::map<uint32_t, uint32_t> place_of;
    for (const uint32_t idx : share.keyframe_idxs) {
      place_of[idx] = static_cast<uint32_t>(patch.put.keyframes.size());
      patch.put.keyframes.push_back(KeyframeInTile(idx, tile, tile_from_view));
    }
    for (const uint32_t idx : share.landmark_idxs) {
      LeanLandmark& landmark = patch.put.landmarks.emplace_back(whole_.put.landmarks[idx]);
      landmark.position_in_map = tile_from_view * landmark.position_in_map;
      for (uint32_t& keyframe_idx : landmark.keyframe_idxs) keyframe_idx = place_of[keyframe_idx];
      landmark.anchor_idx = place_of[landmark.anchor_idx];
    }
    std::sort(patch.removed_landmarks.begin(), patch.removed_landmarks.end());
    PutDrives(patch.put);
    return patch;
  }

  void PutDrives(LeanMap& put) const {
    std::set<DriveId> used;
    for (const LeanKeyframe& keyframe : put.keyframes) used.insert(keyframe.id.drive);
    for (const LeanLandmark& landmark : put.landmarks) used.insert(landmark.id.drive);
    for (const DriveId& id : used) put.drives.push_back(*FindDrive(merged_.drives, id));
  }

  const Component& component_;
  const MapView& view_;
  const Patch whole_;
  const LeanMap& merged_;
  std::vector<std::optional<TileId>> owners_;  ///< of the keyframes that are put
  std::map<TileId, Share> shares_;
};

}  // namespace

std::vector<TileVersion> VersionsAfter(const Commit& commit) {
  std::vector<TileVersion> versions;
  for (const TileChange& change : commit.tiles) {
    versions.push_back({change.tile, change.from_version + 1, !change.bytes});
  }
  return versions;
}

uint64_t PatchBytesOf(const Commit& commit) {
  uint64_t bytes = 0;
  for (const TileChange& change : commit.tiles) bytes += change.patch.size();
  return bytes;
}

absl::StatusOr<std::shared_ptr<const Tile>> Changes::Read(TileId id) const {
  const auto changed = changed_.find(id);
  if (changed == changed_.end()) return base_.Read(id);
  if (changed->second->map.keyframes.empty()) return std::shared_ptr<const Tile>();
  return changed->second;
}

absl::StatusOr<Tile> Changes::Before(TileId id) const {
  CARMAP_ASSIGN_OR_RETURN(const auto stored, base_.Read(id));
  if (stored) return *stored;
  CARMAP_ASSIGN_OR_RETURN(const uint64_t version, base_.reader().VersionOf(id));
  return Tile{id, version, {}};
}

absl::StatusOr<MapView> Changes::View(const Component& component, uint64_t frame_cell,
                                      const std::vector<TileId>& tiles) const {
  std::vector<std::shared_ptr<const Tile>> there;
  for (const TileId& id : tiles) {
    CARMAP_ASSIGN_OR_RETURN(auto tile, Read(id));
    if (tile) there.push_back(std::move(tile));
  }
  return MapView(component.grid, frame_cell, std::move(there));
}

absl::Status Changes::Put(Tile tile) {
  CARMAP_ASSIGN_OR_RETURN(const Tile before, Before(tile.id));
  tile.version = before.version + 1;
  tile.map = Quantize(tile.map);
  const TileId id = tile.id;
  changed_[id] = std::make_shared<const Tile>(std::move(tile));
  return absl::OkStatus();
}

absl::Status Changes::Replace(const Component& component, const MapView& view,
                              const LeanMap& merged) {
  for (Patch& patch : Cutter(component, view, merged).Run()) {
    CARMAP_ASSIGN_OR_RETURN(const auto present, Read(patch.tile));
    const Tile tile = present ? *present : Tile{patch.tile, 0, {}};
    patch.from_version = tile.version;
    patch.to_version = tile.version + 1;
    CARMAP_ASSIGN_OR_RETURN(Tile next, Applied(patch, tile));
    CARMAP_RETURN_IF_ERROR(Put(std::move(next)));
  }
  return absl::OkStatus();
}

std::vector<std::shared_ptr<const Tile>> Changes::Changed() const {
  std::vector<std::shared_ptr<const Tile>> tiles;
  for (const auto& [id, tile] : changed_) tiles.push_back(tile);
  return tiles;
}

absl::Status Changes::AddTo(const Vocabulary& vocabulary, Commit& commit) const {
  for (const auto& [id, changed] : changed_) {
    CARMAP_ASSIGN_OR_RETURN(const Tile before, Before(id));
    const Tile& after = *changed;
    const Patch patch = MakePatch(before, after);
    if (IsEmpty(patch)) continue;  // nothing came of it
    Tile again = before;
    again.version = after.version + 1;
    TileChange change{.tile = id, .from_version = before.version};
    CARMAP_ASSIGN_OR_RETURN(change.patch, EncodePatch(patch));
    CARMAP_ASSIGN_OR_RETURN(change.inverse, EncodePatch(MakePatch(after, again)));
    if (!after.map.keyframes.empty()) {
      CARMAP_ASSIGN_OR_RETURN(change.bytes, EncodeTile(after));
      change.words = EncodeWords(WordsOf(vocabulary, after.map));
    }
    commit.tiles.push_back(std::move(change));
  }
  return absl::OkStatus();
}

}  // namespace carmap
