#include "carmap/index/word_index.h"

#include <algorithm>

namespace carmap {

void WordIndex::Add(KeyframeId id, const WordHistogram& histogram) {
  Remove(id);
  const auto slot = static_cast<uint32_t>(slots_.size());
  slots_.emplace_back(id);
  slot_of_.emplace(id, slot);
  for (const WordWeight& word : histogram) {
    postings_of_[word.word_idx].push_back({slot, word.weight});
  }
}

bool WordIndex::Remove(KeyframeId id) {
  const auto found = slot_of_.find(id);
  if (found == slot_of_.end()) return false;
  slots_[found->second].reset();
  slot_of_.erase(found);
  if (slots_.size() > 2 * slot_of_.size()) Compact();
  return true;
}

void WordIndex::Compact() {
  std::vector<uint32_t> new_slot_of(slots_.size());
  std::vector<std::optional<KeyframeId>> kept;
  for (size_t slot = 0; slot < slots_.size(); ++slot) {
    if (!slots_[slot]) continue;
    new_slot_of[slot] = static_cast<uint32_t>(kept.size());
    slot_of_[*slots_[slot]] = new_slot_of[slot];
    kept.push_back(slots_[slot]);
  }
  for (std::vector<Posting>& postings : postings_of_) {
    std::erase_if(postings, [&](const Posting& posting) { return !slots_[posting.slot]; });
    for (Posting& posting : postings) posting.slot = new_slot_of[posting.slot];
    postings.shrink_to_fit();
  }
  slots_ = std::move(kept);
}

size_t WordIndex::posting_count() const {
  size_t count = 0;
  for (const std::vector<Posting>& postings : postings_of_) count += postings.size();
  return count;
}

WordHistogram WordIndex::RarestWords(const WordHistogram& histogram, size_t max_postings) const {
  const auto count = [&](const WordWeight& word) { return postings_of_[word.word_idx].size(); };
  size_t total = 0;
  for (const WordWeight& word : histogram) total += count(word);
  WordHistogram words = histogram;
  if (total <= max_postings) return words;
  std::stable_sort(words.begin(), words.end(),
                   [&](const WordWeight& a, const WordWeight& b) { return count(a) > count(b); });
  const auto first = std::find_if(words.begin(), words.end(), [&](const WordWeight& word) {
    if (total <= max_postings) return true;
    total -= count(word);
    return false;
  });
  words.erase(words.begin(), first);
  return words;
}

std::vector<SimilarKeyframe> WordIndex::FindSimilar(const WordHistogram& histogram,
                                                    const PlaceQuery& query) const {
  std::vector<float> similarity(slots_.size(), 0);
  for (const WordWeight& word : RarestWords(histogram, query.max_postings)) {
    for (const Posting& posting : postings_of_[word.word_idx]) {
      similarity[posting.slot] += std::min(word.weight, posting.weight);
    }
  }
  std::vector<SimilarKeyframe> found;
  for (size_t slot = 0; slot < slots_.size(); ++slot) {
    if (!slots_[slot] || similarity[slot] <= query.min_similarity) continue;
    if (std::binary_search(query.excluded.begin(), query.excluded.end(), *slots_[slot])) continue;
    found.push_back({*slots_[slot], similarity[slot]});
  }
  const size_t count = std::min(query.max_count, found.size());
  std::partial_sort(found.begin(), found.begin() + static_cast<ptrdiff_t>(count), found.end(),
                    [](const SimilarKeyframe& a, const SimilarKeyframe& b) {
                      if (a.similarity != b.similarity) return a.similarity > b.similarity;
                      return a.id < b.id;
                    });
  found.resize(count);
  return found;
}

}  // namespace carmap
