#include "carmap/index/word_histogram.h"

#include <algorithm>

#include "carmap/feature/vocabulary.h"

namespace carmap {

WordHistogram HistogramOf(const Vocabulary& vocabulary, std::vector<uint32_t> word_idxs) {
  std::sort(word_idxs.begin(), word_idxs.end());
  WordHistogram histogram;
  float total = 0;
  for (size_t begin = 0, end; begin < word_idxs.size(); begin = end) {
    const uint32_t word_idx = word_idxs[begin];
    for (end = begin; end < word_idxs.size() && word_idxs[end] == word_idx;) ++end;
    const float weight = static_cast<float>(end - begin) * vocabulary.WeightOf(word_idx);
    if (weight == 0) continue;  // all images show it: it tells nothing
    histogram.push_back({word_idx, weight});
    total += weight;
  }
  for (WordWeight& word : histogram) word.weight /= total;
  return histogram;
}

WordHistogram HistogramOf(const Vocabulary& vocabulary, std::span<const Feature> features) {
  std::vector<uint32_t> word_idxs;
  word_idxs.reserve(features.size());
  for (const Feature& feature : features) {
    word_idxs.push_back(vocabulary.WordOf(feature.descriptor));
  }
  return HistogramOf(vocabulary, std::move(word_idxs));
}

float Similarity(const WordHistogram& a, const WordHistogram& b) {
  float common = 0;
  auto in_a = a.begin();
  for (const WordWeight& word : b) {
    while (in_a != a.end() && in_a->word_idx < word.word_idx) ++in_a;
    if (in_a == a.end()) break;
    if (in_a->word_idx == word.word_idx) common += std::min(in_a->weight, word.weight);
  }
  return common;
}

}  // namespace carmap
