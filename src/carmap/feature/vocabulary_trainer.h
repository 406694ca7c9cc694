// Makes a vocabulary of what images show: k-medians, again and again within each cluster.
//
// Deterministic: the same images and options give the same vocabulary on any number of cores.
// Thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"

namespace carmap {

struct VocabularyOptions {
  size_t branching = 10;  ///< children of a node, 2 … kMaxBranching
  size_t depth = 4;       ///< levels below the root, 1 … kMaxVocabularyDepth
  uint64_t seed = 1;

  /// Errors: InvalidArgument: out of range, or more than kMaxVocabularyNodes nodes.
  absl::Status Validate() const;
};

/// Called after each step of the training, by the caller's thread.
using TrainingProgress = std::function<void(size_t done, size_t steps)>;

/// `images` are the descriptors of each image; in memory they are taken three times. A cluster of
/// equal descriptors is not divided further, so there may be fewer words than branching^depth.
/// Errors: those of Validate; FailedPrecondition (fewer than two images, no two descriptors that
/// differ).
absl::StatusOr<Vocabulary> TrainVocabulary(const std::vector<std::vector<Descriptor>>& images,
                                           const VocabularyOptions& options,
                                           const TrainingProgress& progress = {});

}  // namespace carmap
