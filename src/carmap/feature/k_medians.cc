#include "carmap/feature/k_medians.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <random>
#include <utility>

namespace carmap {
namespace {

constexpr size_t kGrain = 4096;  // descriptors to a task: some 100 µs of work

template <typename Body>
void ForEachIndex(size_t count, const Body& body) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, count, kGrain), [&](const auto& range) {
    for (size_t i = range.begin(); i != range.end(); ++i) body(i);
  });
}

/// Of each byte its eight bits, spread over eight bytes.
constexpr std::array<uint64_t, 256> SpreadBits() {
  std::array<uint64_t, 256> spread{};
  for (size_t byte = 0; byte < spread.size(); ++byte) {
    for (size_t bit = 0; bit < 8; ++bit) spread[byte] |= (uint64_t{byte} >> bit & 1) << (8 * bit);
  }
  return spread;
}
constexpr std::array<uint64_t, 256> kSpread = SpreadBits();

/// How many of the descriptors have each bit set. Counts in bytes, eight at a time, which are added
/// up before they can overflow.
std::array<size_t, kSignatureBits> CountBits(std::span<const Descriptor> descriptors) {
  std::array<size_t, kSignatureBits> counts{};
  while (!descriptors.empty()) {
    const auto taken = descriptors.first(std::min<size_t>(255, descriptors.size()));
    descriptors = descriptors.subspan(taken.size());
    std::array<uint64_t, kSignatureBits / 8> sums{};
    for (const Descriptor& descriptor : taken) {
      for (size_t byte = 0; byte < sums.size(); ++byte) {
        sums[byte] += kSpread[descriptor.words[byte / 8] >> (8 * (byte % 8)) & 0xff];
      }
    }
    for (size_t bit = 0; bit < counts.size(); ++bit) {
      counts[bit] += sums[bit / 8] >> (8 * (bit % 8)) & 0xff;
    }
  }
  return counts;
}

/// Where as many have a bit set as have not, it stays as it was.
Descriptor Median(std::span<const Descriptor> descriptors, const Descriptor& before) {
  const std::array<size_t, kSignatureBits> counts = CountBits(descriptors);
  Descriptor median = before;
  for (size_t bit = 0; bit < counts.size(); ++bit) {
    const uint64_t mask = uint64_t{1} << (bit % 64);
    if (2 * counts[bit] > descriptors.size()) median.words[bit / 64] |= mask;
    if (2 * counts[bit] < descriptors.size()) median.words[bit / 64] &= ~mask;
  }
  return median;
}

/// Sorts by nearest centre, stably; gives each cluster's size. The scratch is as long as the
/// descriptors.
std::vector<size_t> SortByNearest(std::span<const Descriptor> centers,
                                  std::span<Descriptor> descriptors,
                                  std::vector<Descriptor>& scratch,
                                  std::vector<uint32_t>& nearest) {
  ForEachIndex(descriptors.size(), [&](size_t i) {
    nearest[i] = static_cast<uint32_t>(NearestCenter(centers, descriptors[i]));
  });
  std::vector<size_t> sizes(centers.size(), 0);
  for (const uint32_t cluster : nearest) ++sizes[cluster];
  std::vector<size_t> next(sizes.size(), 0);
  std::partial_sum(sizes.begin(), sizes.end() - 1, next.begin() + 1);
  for (size_t i = 0; i < descriptors.size(); ++i) scratch[next[nearest[i]]++] = descriptors[i];
  std::copy(scratch.begin(), scratch.end(), descriptors.begin());
  return sizes;
}

/// Moves each centre to the median of its cluster. False if all stayed where they were.
bool MoveToMedians(std::span<const Descriptor> descriptors, const std::vector<size_t>& sizes,
                   std::vector<Descriptor>& centers) {
  std::vector<size_t> begin(sizes.size(), 0);
  std::partial_sum(sizes.begin(), sizes.end() - 1, begin.begin() + 1);
  const std::vector<Descriptor> before = centers;
  tbb::parallel_for(size_t{0}, sizes.size(), [&](size_t i) {
    centers[i] = Median(descriptors.subspan(begin[i], sizes[i]), before[i]);
  });
  return centers != before;
}

}  // namespace

std::vector<Descriptor> DrawCenters(std::span<const Descriptor> descriptors, size_t count,
                                    uint64_t seed) {
  std::vector<Descriptor> centers;
  if (descriptors.empty()) return centers;
  std::mt19937_64 random(seed);
  centers.push_back(descriptors[random() % descriptors.size()]);
  std::vector<uint16_t> distances(descriptors.size(), kSignatureBits);
  while (centers.size() < count) {
    ForEachIndex(descriptors.size(), [&](size_t i) {
      const int distance = HammingDistance(centers.back(), descriptors[i]);
      distances[i] = std::min(distances[i], static_cast<uint16_t>(distance));
    });
    uint64_t total = 0;
    for (const uint64_t distance : distances) total += distance * distance;
    if (total == 0) break;
    uint64_t left = random() % total;
    size_t drawn = 0;
    for (uint64_t weight; (weight = uint64_t{distances[drawn]} * distances[drawn]) <= left;) {
      left -= weight;
      ++drawn;
    }
    centers.push_back(descriptors[drawn]);
  }
  return centers;
}

size_t NearestCenter(std::span<const Descriptor> centers, const Descriptor& descriptor) {
  size_t nearest = 0;
  int least = HammingDistance(centers[0], descriptor);
  for (size_t i = 1; i < centers.size(); ++i) {
    const int distance = HammingDistance(centers[i], descriptor);
    if (distance >= least) continue;
    least = distance;
    nearest = i;
  }
  return nearest;
}

std::vector<Cluster> SortIntoClusters(const KMediansOptions& options,
                                      std::span<Descriptor> descriptors) {
  std::vector<Descriptor> centers = DrawCenters(descriptors, options.cluster_count, options.seed);
  if (centers.empty()) return {};
  std::vector<Descriptor> scratch(descriptors.size());
  std::vector<uint32_t> nearest(descriptors.size());
  std::vector<size_t> sizes = SortByNearest(centers, descriptors, scratch, nearest);
  for (int i = 0; i < options.max_iterations && MoveToMedians(descriptors, sizes, centers); ++i) {
    sizes = SortByNearest(centers, descriptors, scratch, nearest);
  }
  std::vector<Cluster> clusters;
  for (size_t i = 0; i < centers.size(); ++i) {
    if (sizes[i] > 0) clusters.push_back({centers[i], sizes[i]});
  }
  return clusters;
}

}  // namespace carmap
