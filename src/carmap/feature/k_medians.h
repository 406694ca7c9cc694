// k-medians over binary descriptors: groups of which each has the centre that differs in the fewest
// bits from its members, the majority's bit at each place.
//
// Deterministic and thread-safe; uses all cores, and the result does not depend on how many there
// are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

struct KMediansOptions {
  size_t cluster_count = 10;  ///< at least 1
  int max_iterations = 12;    ///< it settles in about ten; what is left to gain then is little
  uint64_t seed = 1;
};

struct Cluster {
  Descriptor center;
  size_t size = 0;  ///< at least 1
};

/// The `count` centres are drawn one after the other, each descriptor with a chance that grows with
/// the square of its distance to the nearest one drawn (k-means++, Arthur and Vassilvitskii 2007).
/// Fewer where there are fewer distinct descriptors.
std::vector<Descriptor> DrawCenters(std::span<const Descriptor> descriptors, size_t count,
                                    uint64_t seed);

/// Index of the centre nearest to the descriptor, of equally near ones the first. `centers` is not
/// empty.
size_t NearestCenter(std::span<const Descriptor> centers, const Descriptor& descriptor);

/// Sorts the descriptors by cluster, in the order of the answer. Each descriptor's own centre is
/// its NearestCenter. Of few distinct descriptors come few clusters; of none, none.
std::vector<Cluster> SortIntoClusters(const KMediansOptions& options,
                                      std::span<Descriptor> descriptors);

}  // namespace carmap
