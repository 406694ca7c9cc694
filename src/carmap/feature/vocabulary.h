// A vocabulary of binary words (paper §3.2): a tree of descriptors that sorts any descriptor into
// one of some ten thousand words, so that images are compared by the words that they share.
//
// The tree is that of Nistér and Stewénius (2006), made for binary descriptors as by Gálvez-López
// and Tardós (2012): a descriptor goes from the root to whichever child's centre differs from it in
// the fewest bits, until it comes to a leaf, its word. A word weighs the more the fewer images show
// it (inverse document frequency).
//
// Immutable, thread-safe. Maps do not hold words: all who compare them must use one vocabulary.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

inline constexpr size_t kMaxVocabularyNodes = size_t{1} << 18;
inline constexpr size_t kMaxVocabularyDepth = 16;
inline constexpr size_t kMaxBranching = 255;

/// A vocabulary as plain columns, the form in which its file has it. Nodes are numbered level by
/// level from the root, number 0; a node's children follow each other. The leaves in this order are
/// the words.
struct VocabularyTables {
  uint32_t training_images = 0;  ///< that the weights were counted in
  /// Of the root, and of as many nodes after it as are needed for the rest to be leaves, the number
  /// of children: 0 or 2 … kMaxBranching.
  std::vector<uint8_t> child_counts;
  std::vector<Descriptor> centers;  ///< of node 1, node 2 …
  std::vector<uint16_t> weights;    ///< of the words, in 1/4096

  bool operator==(const VocabularyTables&) const = default;
};

class Vocabulary {
 public:
  /// Errors: InvalidArgument, one line that says what is wrong with the tables.
  static absl::StatusOr<Vocabulary> Create(VocabularyTables tables);

  size_t word_count() const { return tables_.weights.size(); }
  /// Levels below the root.
  size_t depth() const { return depth_; }
  const VocabularyTables& tables() const { return tables_; }

  /// Index of the descriptor's word, below word_count(). Of equally near children the first counts.
  uint32_t WordOf(const Descriptor& descriptor) const;
  /// ln(training images / those that show the word), not negative.
  float WeightOf(uint32_t word_idx) const {
    return static_cast<float>(tables_.weights[word_idx]) / kWeightUnits;
  }

  static constexpr int kWeightUnits = 4096;

 private:
  struct Node {
    uint32_t child_count = 0;
    uint32_t first = 0;  ///< number of the first child; of a leaf the word
  };

  Vocabulary() = default;

  VocabularyTables tables_;
  std::vector<Node> nodes_;
  size_t depth_ = 0;
};

}  // namespace carmap
