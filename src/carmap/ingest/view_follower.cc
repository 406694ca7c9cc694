#include "carmap/ingest/view_follower.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/ingest/tile_words.h"

namespace carmap {

ViewFollower::ViewFollower(const BaseMap& base, double focal_length_px,
                           std::shared_ptr<const Vocabulary> vocabulary,
                           const FollowerOptions& options)
    : base_(base),
      tiles_(base),
      focal_length_px_(focal_length_px),
      vocabulary_(std::move(vocabulary)),
      options_(options),
      view_(MapView({.is_on_earth = false}, 0, {})),
      map_(view_->Rebuild(focal_length_px)) {}

void ViewFollower::Take(Patch patch) {
  is_stale_ |= component_ && patch.tile.component == component_->id;
  tiles_.Add(std::move(patch));
}

absl::StatusOr<ViewFollower::Change> ViewFollower::Follow(
    const std::optional<Rigid3>& view_from_camera, const std::optional<GpsFix>& gps,
    const std::vector<Feature>& features) {
  if (view_from_camera) {
    lost_frames_ = 0;
    return FollowPose(*view_from_camera);
  }
  return LookAround(gps, features);
}

absl::StatusOr<ViewFollower::Change> ViewFollower::FollowPose(const Rigid3& view_from_camera) {
  const Eigen::Vector3d p_in_root = view_->root_from_view() * view_from_camera.translation;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> needed,
                          tiles_.Near(*component_, {p_in_root}, options_.needed_m));
  if (HasAll(needed) && !std::exchange(is_stale_, false)) return Change::kNone;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> around,
                          tiles_.Near(*component_, {p_in_root}, options_.loaded_m));
  CARMAP_RETURN_IF_ERROR(Load(*component_, view_->frame_cell(), around));
  return Change::kTiles;
}

bool ViewFollower::HasAll(const std::vector<TileId>& tiles) const {
  return std::all_of(tiles.begin(), tiles.end(), [&](const TileId& tile) {
    return loaded_.contains(tile) || unreadable_.contains(tile);
  });
}

absl::StatusOr<ViewFollower::Change> ViewFollower::LookAround(
    const std::optional<GpsFix>& gps, const std::vector<Feature>& features) {
  const bool is_due = lost_frames_++ % options_.frames_of_component == 0;
  if (!is_due) return Change::kNone;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<CandidateTiles> candidates, Candidates(gps, features));
  if (candidates.empty()) return Change::kNone;
  const CandidateTiles& candidate = candidates[next_candidate_++ % candidates.size()];
  const bool stays = component_ && component_->id == candidate.component.id;
  if (stays && HasAll(candidate.tiles) && !std::exchange(is_stale_, false)) return Change::kNone;
  const uint64_t frame_cell = stays ? view_->frame_cell() : candidate.tiles.front().cell;
  if (!stays) used_.clear();
  CARMAP_RETURN_IF_ERROR(Load(candidate.component, frame_cell, candidate.tiles));
  component_ = candidate.component;
  return stays ? Change::kTiles : Change::kComponent;
}

absl::StatusOr<std::vector<CandidateTiles>> ViewFollower::Candidates(
    const std::optional<GpsFix>& gps, const std::vector<Feature>& features) const {
  std::vector<CandidateTiles> candidates;
  if (gps) {
    LeanMap here;
    here.keyframes.emplace_back().gps = gps;
    CARMAP_ASSIGN_OR_RETURN(candidates, CandidatesByGps(here, base_, options_.needed_m));
    // The fix may be wrong, and a component may lie nowhere on the Earth.
    if (next_candidate_ < candidates.size()) return candidates;
  }
  CARMAP_ASSIGN_OR_RETURN(auto by_words,
                          CandidatesByWords({WordsOf(*vocabulary_, features)}, base_, *vocabulary_,
                                            options_.max_word_tiles, /*on_earth_too=*/true));
  std::move(by_words.begin(), by_words.end(), std::back_inserter(candidates));
  return candidates;
}

absl::Status ViewFollower::Load(const Component& component, uint64_t frame_cell,
                                const std::vector<TileId>& tiles) {
  std::vector<std::shared_ptr<const Tile>> there;
  loaded_.clear();
  for (const TileId& id : tiles) {
    auto tile = tiles_.Read(id);
    if (absl::IsDataLoss(tile.status())) {
      if (unreadable_.insert(id).second) damaged_.emplace_back(tile.status().message());
      continue;
    }
    CARMAP_RETURN_IF_ERROR(tile.status());
    loaded_.insert(id);
    if (!*tile) continue;
    used_.insert(id);
    there.push_back(*std::move(tile));
  }
  view_.emplace(component.grid, frame_cell, std::move(there));
  map_ = view_->Rebuild(focal_length_px_);
  return absl::OkStatus();
}

absl::StatusOr<MapView> ViewFollower::Used() const {
  std::vector<std::shared_ptr<const Tile>> tiles;
  for (const TileId& id : used_) {
    CARMAP_ASSIGN_OR_RETURN(auto tile, tiles_.Read(id));
    if (tile) tiles.push_back(std::move(tile));
  }
  return MapView(view_->grid(), view_->frame_cell(), std::move(tiles));
}

}  // namespace carmap
