// What an image shows as a histogram of words (paper §3.2): how much of it each word of a
// vocabulary makes up.
//
// Rebuilt from features, never stored in a map. Plain values and pure functions.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

class Vocabulary;

struct WordWeight {
  uint32_t word_idx = 0;
  float weight = 0;  ///< positive
  bool operator==(const WordWeight&) const = default;
};

/// Ascending by word; the weights add up to 1. Empty if no word of the image weighs anything.
using WordHistogram = std::vector<WordWeight>;

/// Of words, in any order and as often as they occur (tf-idf, Sivic and Zisserman 2003).
WordHistogram HistogramOf(const Vocabulary& vocabulary, std::vector<uint32_t> word_idxs);
WordHistogram HistogramOf(const Vocabulary& vocabulary, std::span<const Feature> features);

/// 1 - |a - b| / 2 by the sum of absolute differences, that is, the part that both have in common:
/// 1 for equal histograms, 0 for those that share no word. Symmetric.
float Similarity(const WordHistogram& a, const WordHistogram& b);

}  // namespace carmap
