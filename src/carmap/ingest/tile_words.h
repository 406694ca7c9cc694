// The words of a tile, by which it is found without GPS (paper §3.2): what a store keeps beside
// each tile, so that a search reads no tile.
//
// Pure functions, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// The words of the map's landmarks, or of a frame's features, ascending, each once.
std::vector<uint32_t> WordsOf(const Vocabulary& vocabulary, const LeanMap& map);
std::vector<uint32_t> WordsOf(const Vocabulary& vocabulary, const std::vector<Feature>& features);

/// Differences as varints: about a byte a word.
std::string EncodeWords(const std::vector<uint32_t>& words);
/// Errors: DataLoss for bytes that are no such words.
absl::StatusOr<std::vector<uint32_t>> DecodeWords(std::string_view bytes);

/// How much of a frame's words a tile shows, each by its weight: 0 to 1. Both ascending.
double ShareOfWords(const Vocabulary& vocabulary, const std::vector<uint32_t>& of_frame,
                    const std::vector<uint32_t>& of_tile);

}  // namespace carmap
