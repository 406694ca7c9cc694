// The places of a map (paper §3.2): keyframes side by side that see the same landmarks are one
// place, and an inverted index of words finds those that resemble a frame.
//
// Rebuilt, never stored. Immutable once built, thread-safe; the map must outlive it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/index/reconstruct.h"
#include "carmap/index/word_histogram.h"
#include "carmap/index/word_index.h"

namespace carmap {

struct PlaceOptions {
  double radius_m = 6;       ///< of a place around its keyframe in the middle
  size_t max_keyframes = 8;  ///< of a place, whose landmarks count ...
  /// ... as long as they are no more than so many times those of the keyframe in the middle, or of
  /// one that sees few_landmarks if that is more: so an index is in proportion to its map.
  size_t max_landmark_ratio = 8, few_landmarks = 256;
  /// Entries of the inverted index that one query may read: some milliseconds at most.
  size_t max_postings = 1'000'000;
};

struct SimilarPlace {
  uint32_t place_idx = 0;
  float similarity = 0;  ///< Similarity of the histograms
};

class PlaceIndex {
 public:
  /// Takes time in proportion to the map.
  PlaceIndex(const ReconstructedMap& map, std::shared_ptr<const Vocabulary> vocabulary,
             const PlaceOptions& options = {});

  /// Number of places. Each keyframe belongs to one.
  size_t size() const { return centers_.size(); }
  uint32_t PlaceOf(uint32_t keyframe_idx) const { return place_of_keyframe_[keyframe_idx]; }
  /// The keyframe in the middle of the place.
  uint32_t CenterOf(uint32_t place_idx) const { return centers_[place_idx]; }
  /// What the keyframes around the middle see, ascending.
  std::vector<uint32_t> LandmarksOf(uint32_t place_idx) const;

  WordHistogram HistogramOfPlace(uint32_t place_idx) const;
  WordHistogram HistogramOfFrame(const std::vector<Feature>& features) const {
    return HistogramOf(*vocabulary_, features);
  }
  /// Most similar first. Takes a time that does not grow with the map beyond some size of it.
  std::vector<SimilarPlace> FindSimilar(const WordHistogram& histogram, size_t max_count) const;

 private:
  std::vector<uint32_t> KeyframesBeside(uint32_t keyframe_idx) const;
  void GroupKeyframes();

  const ReconstructedMap& map_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const PlaceOptions options_;
  std::vector<uint32_t> place_of_keyframe_, centers_;
  std::vector<uint32_t> word_of_landmark_;
  WordIndex index_;  ///< of the places, by the keyframe in the middle
};

}  // namespace carmap
