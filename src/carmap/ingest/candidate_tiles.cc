#include "carmap/ingest/candidate_tiles.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/ingest/tile_words.h"

namespace carmap {
namespace {

struct ScoredTile {
  double score = 0;
  TileId tile;
};

/// How much more of a keyframe's words the tile shows than any tile with so many words does.
double Score(const Vocabulary& vocabulary, const std::vector<std::vector<uint32_t>>& along,
             const std::vector<uint32_t>& of_tile) {
  const double by_chance =
      static_cast<double>(of_tile.size()) / static_cast<double>(vocabulary.word_count());
  double best = 0;
  for (const auto& of_keyframe : along) {
    best = std::max(best, ShareOfWords(vocabulary, of_keyframe, of_tile) - by_chance);
  }
  return best;
}

}  // namespace

std::vector<std::vector<uint32_t>> WordsAlong(const LeanMap& segment,
                                              const Vocabulary& vocabulary) {
  constexpr size_t kKeyframes = 12;
  const size_t step = std::max<size_t>(1, segment.keyframes.size() / kKeyframes);
  std::vector<std::vector<uint32_t>> words(segment.keyframes.size() / step + 1);
  for (const LeanLandmark& landmark : segment.landmarks) {
    const uint32_t word = vocabulary.WordOf(landmark.descriptor);
    for (const uint32_t idx : landmark.keyframe_idxs) {
      if (idx % step == 0) words[idx / step].push_back(word);
    }
  }
  for (auto& of_keyframe : words) {
    std::sort(of_keyframe.begin(), of_keyframe.end());
    of_keyframe.erase(std::unique(of_keyframe.begin(), of_keyframe.end()), of_keyframe.end());
  }
  std::erase_if(words, [](const auto& of_keyframe) { return of_keyframe.empty(); });
  return words;
}

std::vector<Eigen::Vector3d> Thinned(const std::vector<Eigen::Vector3d>& places) {
  std::vector<Eigen::Vector3d> thinned;
  for (const Eigen::Vector3d& place : places) {
    const bool is_apart = thinned.empty() || (place - thinned.back()).norm() >= kThinnedSpacingM;
    if (is_apart) thinned.push_back(place);
  }
  return thinned;
}

absl::StatusOr<std::vector<CandidateTiles>> CandidatesByGps(const LeanMap& segment,
                                                            const BaseMap& base, double radius_m) {
  std::vector<Eigen::Vector3d> places;
  for (const LeanKeyframe& keyframe : segment.keyframes) {
    if (keyframe.gps) places.push_back(EcefFromEnu(*keyframe.gps).translation);
  }
  std::vector<CandidateTiles> candidates;
  if (places.empty()) return candidates;
  const CellGrid earth{.is_on_earth = true, .level = base.cell_level()};
  std::set<uint64_t> cells;
  for (const Eigen::Vector3d& place : Thinned(places)) {
    for (const uint64_t cell : CellsNear(earth, place, radius_m + kThinnedSpacingM)) {
      cells.insert(cell);
    }
  }
  std::map<uint32_t, std::vector<TileId>> by_component;
  for (const uint64_t cell : cells) {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> tiles, base.EarthTilesAt(cell));
    for (const TileId& tile : tiles) by_component[tile.component].push_back(tile);
  }
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base.Components());
  for (const Component& component : components) {
    const auto found = by_component.find(component.id);
    if (found != by_component.end()) candidates.push_back({component, std::move(found->second)});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.tiles.size() > b.tiles.size(); });
  return candidates;
}

absl::StatusOr<std::vector<CandidateTiles>> CandidatesByWords(
    const std::vector<std::vector<uint32_t>>& words_of_frames, const BaseMap& base,
    const Vocabulary& vocabulary, size_t max_tiles, bool on_earth_too) {
  std::map<uint32_t, Component> components;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> all, base.Components());
  for (const Component& component : all) {
    if (on_earth_too || !component.grid.is_on_earth) components[component.id] = component;
  }
  std::vector<CandidateTiles> candidates;  // in the order of their best tiles
  if (components.empty()) return candidates;
  std::vector<ScoredTile> scored;
  const auto score = [&](TileId tile, const std::vector<uint32_t>& words) {
    if (!components.contains(tile.component)) return;
    scored.push_back({Score(vocabulary, words_of_frames, words), tile});
  };
  const absl::Status visited = base.reader().VisitWords([&](TileId tile, std::string_view bytes) {
    // Words that are damaged cost no more than that this tile is not proposed.
    if (const auto words = DecodeWords(bytes); words.ok()) score(tile, *words);
  });
  if (absl::IsDataLoss(visited)) {  // they follow from the tiles
    scored.clear();
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
    for (const TileVersion& version : tiles) {
      const auto tile = base.Read(version.tile);
      if (tile.ok() && *tile) score(version.tile, WordsOf(vocabulary, (*tile)->map));
    }
  } else {
    CARMAP_RETURN_IF_ERROR(visited);
  }
  const size_t kept = std::min(scored.size(), max_tiles);
  std::partial_sort(scored.begin(), scored.begin() + static_cast<ptrdiff_t>(kept), scored.end(),
                    [](const ScoredTile& a, const ScoredTile& b) {
                      return std::pair(b.score, a.tile) < std::pair(a.score, b.tile);
                    });
  scored.resize(kept);

  for (const ScoredTile& found : scored) {
    const Component& component = components[found.tile.component];
    CARMAP_ASSIGN_OR_RETURN(
        const std::vector<TileId> around,
        TilesNear(base.reader(), component,
                  {RootFromTile(component.grid, found.tile.cell).translation}, 100));
    auto same = std::find_if(candidates.begin(), candidates.end(), [&](const auto& candidate) {
      return candidate.component.id == component.id;
    });
    if (same == candidates.end()) same = candidates.insert(same, {component, {}});
    same->tiles.insert(same->tiles.end(), around.begin(), around.end());
  }
  for (CandidateTiles& candidate : candidates) {
    std::sort(candidate.tiles.begin(), candidate.tiles.end());
    candidate.tiles.erase(std::unique(candidate.tiles.begin(), candidate.tiles.end()),
                          candidate.tiles.end());
  }
  return candidates;
}

}  // namespace carmap
