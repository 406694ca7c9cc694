// The inverted index (paper §3.2): of each word the keyframes that show it, to find those which
// resemble an image without looking at the others.
//
// Grows and shrinks with the map; rebuilt, never stored. One thread changes it, while no other
// reads; any number of threads may read.
#pragma once

#include <absl/container/flat_hash_map.h>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/index/word_histogram.h"

namespace carmap {

struct PlaceQuery {
  /// Keyframes that are not wanted, ascending: those that the image surely sees, say.
  std::span<const KeyframeId> excluded = {};
  float min_similarity = 0;  ///< only keyframes above
  size_t max_count = 20;
  /// At most about so many entries of words are read, those of the rarest words: bounds the time
  /// however large the index is.
  size_t max_postings = std::numeric_limits<size_t>::max();
};

struct SimilarKeyframe {
  KeyframeId id;
  float similarity = 0;  ///< Similarity of the histograms
};

class WordIndex {
 public:
  /// `word_count` of the vocabulary whose words all histograms are of.
  explicit WordIndex(size_t word_count) : postings_of_(word_count) {}

  /// A keyframe that is there already is replaced.
  void Add(KeyframeId id, const WordHistogram& histogram);
  /// False if the keyframe is not there.
  bool Remove(KeyframeId id);
  /// Number of keyframes.
  size_t size() const { return slot_of_.size(); }
  /// Entries of all words together, of eight bytes each: what the index takes in memory. At most
  /// about twice those of the keyframes that are there.
  size_t posting_count() const;

  /// Most similar first, of equally similar ones the lower id.
  std::vector<SimilarKeyframe> FindSimilar(const WordHistogram& histogram,
                                           const PlaceQuery& query = {}) const;

 private:
  struct Posting {
    uint32_t slot = 0;
    float weight = 0;
  };

  /// The words of the histogram whose entries are read.
  WordHistogram RarestWords(const WordHistogram& histogram, size_t max_postings) const;

  /// Drops the postings of removed keyframes. Their number decides when, so that the index stays in
  /// proportion to what it holds and removing takes the same time on average, however large it is.
  void Compact();

  std::vector<std::vector<Posting>> postings_of_;  ///< of each word, ascending by slot
  std::vector<std::optional<KeyframeId>> slots_;   ///< in the order of adding; empty: removed
  absl::flat_hash_map<KeyframeId, uint32_t> slot_of_;
};

}  // namespace carmap
