// Tiles that a segment may overlap: by its fixes, or by words (paper §3.4, §3.2).
//
// Reads no tile. Pure, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/feature/vocabulary.h"
#include "carmap/ingest/base_map.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// Tiles of one component, the likeliest first.
struct CandidateTiles {
  Component component;
  std::vector<TileId> tiles;  ///< ascending
};

/// Of places along a way those that lie some way from the one kept before.
inline constexpr double kThinnedSpacingM = 20;
std::vector<Eigen::Vector3d> Thinned(const std::vector<Eigen::Vector3d>& places);

/// By the fixes of the segment's keyframes, on the Earth: the component with most tiles there
/// first. Errors: those of the store.
absl::StatusOr<std::vector<CandidateTiles>> CandidatesByGps(const LeanMap& segment,
                                                            const BaseMap& base, double radius_m);

/// The words of keyframes all along the segment, ascending of each.
std::vector<std::vector<uint32_t>> WordsAlong(const LeanMap& segment, const Vocabulary& vocabulary);

/// By the words that frames share with the `max_tiles` tiles that show most of those of one, with
/// the tiles around these. `on_earth_too` includes components with GPS. Errors: those of the store.
absl::StatusOr<std::vector<CandidateTiles>> CandidatesByWords(
    const std::vector<std::vector<uint32_t>>& words_of_frames, const BaseMap& base,
    const Vocabulary& vocabulary, size_t max_tiles, bool on_earth_too);

}  // namespace carmap
