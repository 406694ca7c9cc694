#include "carmap/feature/k_medians.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <set>

#include "carmap/feature/test_descriptors.h"

namespace carmap {

bool operator==(const Cluster& a, const Cluster& b) {
  return a.center == b.center && a.size == b.size;
}

namespace {

using ::testing::IsEmpty;
using ::testing::UnorderedElementsAreArray;

std::vector<Descriptor> RandomDescriptors(size_t count, std::mt19937_64& random) {
  std::vector<Descriptor> descriptors(count);
  for (Descriptor& descriptor : descriptors) descriptor = RandomDescriptor(random);
  return descriptors;
}

std::vector<Descriptor> CentersOf(const std::vector<Cluster>& clusters) {
  std::vector<Descriptor> centers;
  for (const Cluster& cluster : clusters) centers.push_back(cluster.center);
  return centers;
}

/// Sum of the distances to the nearest centre: what k-medians makes small.
size_t Cost(std::span<const Descriptor> centers, std::span<const Descriptor> descriptors) {
  size_t cost = 0;
  for (const Descriptor& descriptor : descriptors) {
    cost += HammingDistance(centers[NearestCenter(centers, descriptor)], descriptor);
  }
  return cost;
}

TEST(SortIntoClusters, FindsCentersThatWereBlurred) {
  std::mt19937_64 random(1);
  const std::vector<Descriptor> truth = RandomDescriptors(12, random);
  std::vector<Descriptor> descriptors;
  for (int i = 0; i < 6000; ++i) {
    descriptors.push_back(WithFlippedBits(truth[random() % truth.size()], 3, random));
  }
  const auto clusters = SortIntoClusters({.cluster_count = truth.size(), .seed = 6}, descriptors);
  EXPECT_THAT(CentersOf(clusters), UnorderedElementsAreArray(truth));
}

TEST(SortIntoClusters, TakesTheMajorityOfEachBit) {
  std::mt19937_64 random(2);
  for (const size_t count : {1u, 2u, 3u, 254u, 255u, 256u, 1001u}) {
    const std::vector<Descriptor> descriptors = RandomDescriptors(count, random);
    auto sorted = descriptors;
    const auto clusters = SortIntoClusters({.cluster_count = 1}, sorted);
    ASSERT_EQ(clusters.size(), 1u);
    EXPECT_EQ(clusters[0].size, count);
    for (size_t bit = 0; bit < kSignatureBits; ++bit) {
      const auto is_set = [&](const Descriptor& d) { return d.words[bit / 64] >> bit % 64 & 1; };
      const auto set = std::count_if(descriptors.begin(), descriptors.end(), is_set);
      if (2 * static_cast<size_t>(set) == count) continue;
      EXPECT_EQ(is_set(clusters[0].center), 2 * static_cast<size_t>(set) > count) << bit;
    }
  }
}

TEST(SortIntoClusters, SortsAllDescriptorsByTheirNearestCenter) {
  std::mt19937_64 random(3);
  const std::vector<Descriptor> descriptors = RandomDescriptors(20000, random);
  auto sorted = descriptors;
  const auto clusters = SortIntoClusters({.cluster_count = 30, .max_iterations = 2}, sorted);
  EXPECT_EQ(std::multiset(sorted.begin(), sorted.end()),
            std::multiset(descriptors.begin(), descriptors.end()));
  const auto centers = CentersOf(clusters);
  size_t i = 0;
  for (size_t cluster = 0; cluster < clusters.size(); ++cluster) {
    EXPECT_GT(clusters[cluster].size, 0u);
    for (const size_t end = i + clusters[cluster].size; i < end; ++i) {
      ASSERT_EQ(NearestCenter(centers, sorted[i]), cluster);
    }
  }
  EXPECT_EQ(i, sorted.size());
}

TEST(SortIntoClusters, ImprovesOnTheCentersDrawn) {
  std::mt19937_64 random(4);
  std::vector<Descriptor> descriptors = RandomDescriptors(3000, random);
  size_t before = Cost(DrawCenters(descriptors, 20, 7), descriptors);
  for (const int iterations : {1, 3, 12}) {
    auto sorted = descriptors;
    const auto clusters =
        SortIntoClusters({.cluster_count = 20, .max_iterations = iterations, .seed = 7}, sorted);
    const size_t cost = Cost(CentersOf(clusters), descriptors);
    EXPECT_LT(cost, before) << iterations;
    before = cost;
  }
}

TEST(SortIntoClusters, MakesFewClustersOfFewDistinctDescriptors) {
  std::vector<Descriptor> none;
  EXPECT_THAT(SortIntoClusters({}, none), IsEmpty());
  std::mt19937_64 random(5);
  const std::vector<Descriptor> distinct = RandomDescriptors(3, random);
  std::vector<Descriptor> descriptors;
  for (int i = 0; i < 100; ++i) descriptors.push_back(distinct[i % 3]);
  EXPECT_THAT(CentersOf(SortIntoClusters({.cluster_count = 10}, descriptors)),
              UnorderedElementsAreArray(distinct));
}

TEST(SortIntoClusters, DoesNotDependOnThreadsButOnTheSeed) {
  std::mt19937_64 random(6);
  const std::vector<Descriptor> descriptors = RandomDescriptors(20000, random);
  auto first = descriptors, second = descriptors, third = descriptors;
  const auto clusters = SortIntoClusters({.seed = 1}, first);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(SortIntoClusters({.seed = 1}, second), clusters);
  }
  EXPECT_EQ(first, second);
  EXPECT_NE(SortIntoClusters({.seed = 2}, third), clusters);
}

TEST(DrawCenters, DrawsFromTheDescriptorsFarFromEachOther) {
  std::mt19937_64 random(7);
  const std::vector<Descriptor> truth = RandomDescriptors(8, random);
  std::vector<Descriptor> descriptors;
  for (int i = 0; i < 800; ++i) {
    descriptors.push_back(WithFlippedBits(truth[i % 8], 3, random));
  }
  const auto centers = DrawCenters(descriptors, 8, 1);
  std::set<size_t> groups;
  for (const Descriptor& center : centers) {
    EXPECT_THAT(descriptors, ::testing::Contains(center));
    groups.insert(NearestCenter(truth, center));
  }
  EXPECT_EQ(groups.size(), 8u) << "one in each group: others are a thousand times less likely";
}

}  // namespace
}  // namespace carmap
