#include "carmap/index/kd_tree.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>
#include <numeric>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::vector<Eigen::Vector3d> RandomPoints(size_t count) {
  StreetRandom random(5);
  std::vector<Eigen::Vector3d> points;
  for (size_t i = 0; i < count; ++i) {
    points.emplace_back(random.Uniform(-20, 20), random.Uniform(-2, 2), random.Uniform(0, 100));
  }
  return points;
}

std::vector<uint32_t> AllByDistance(const std::vector<Eigen::Vector3d>& points,
                                    const Eigen::Vector3d& center) {
  std::vector<uint32_t> idxs(points.size());
  std::iota(idxs.begin(), idxs.end(), 0u);
  std::stable_sort(idxs.begin(), idxs.end(), [&](uint32_t a, uint32_t b) {
    return (points[a] - center).squaredNorm() < (points[b] - center).squaredNorm();
  });
  return idxs;
}

TEST(KdTree, FindsWhatASearchThroughAllPointsFinds) {
  const auto points = RandomPoints(2000);
  const KdTree tree(points);
  for (const Eigen::Vector3d& center : RandomPoints(20)) {
    std::vector<uint32_t> expected = AllByDistance(points, center);
    const auto is_near = [&](uint32_t i) { return (points[i] - center).norm() <= 8; };
    const auto end = std::find_if_not(expected.begin(), expected.end(), is_near);
    EXPECT_EQ(tree.WithinRadius(center, 8), std::vector<uint32_t>(expected.begin(), end));
    expected.resize(25);
    EXPECT_EQ(tree.Nearest(center, 25), expected);
  }
}

TEST(KdTree, FindsTheNearestOfManyWithinARadius) {
  const auto points = RandomPoints(2000);
  const KdTree tree(points);
  for (const Eigen::Vector3d& center : RandomPoints(20)) {
    const std::vector<uint32_t> all = tree.WithinRadius(center, 8);
    for (const size_t count : {size_t{0}, size_t{1}, size_t{20}, all.size(), all.size() + 5}) {
      const std::vector<uint32_t> nearest = tree.WithinRadius(center, 8, count);
      const size_t expected = std::min(count, all.size());
      EXPECT_EQ(nearest, std::vector<uint32_t>(all.begin(), all.begin() + expected));
    }
  }
}

// Where no point is nearer than another a tree leaves none out: all would be looked at, by each of
// as many searches.
TEST(KdTree, LooksAtFewPointsWhereverTheyLie) {
  constexpr size_t kCount = 200'000;
  std::vector<Eigen::Vector3d> sphere = RandomPoints(kCount);
  for (Eigen::Vector3d& p : sphere) p = 20 * (p - Eigen::Vector3d(0, 0, 50)).normalized();
  const KdTree on_a_sphere(sphere), equal(std::vector<Eigen::Vector3d>(kCount, {1, 2, 3}));
  const auto time_of = [](const KdTree& tree, const Eigen::Vector3d& center, size_t searches) {
    const std::clock_t start = std::clock();
    for (size_t i = 0; i < searches; ++i) EXPECT_EQ(tree.WithinRadius(center, 30, 40).size(), 40u);
    return std::clock() - start;
  };
  // One search that looks at all takes longer than a hundred that do not.
  const std::clock_t start = std::clock();
  EXPECT_EQ(on_a_sphere.WithinRadius({0, 0, 0}, 30).size(), kCount);
  const std::clock_t of_all = std::clock() - start;
  EXPECT_LT(time_of(on_a_sphere, {0, 0, 0}, 100), 20 * of_all);
  EXPECT_LT(time_of(equal, {1, 2, 3}, 100), 20 * of_all);
}

TEST(KdTree, CountsPointsOnTheBoundAndOrdersEqualOnesByIndex) {
  const KdTree tree({{2, 0, 0}, {0, 2, 0}, {0, 0, 0}, {0, 0, 2}, {0, 0, 2.001}});
  EXPECT_THAT(tree.WithinRadius({0, 0, 0}, 2), ElementsAre(2, 0, 1, 3));
}

TEST(KdTree, TakesNoPointsOnePointAndManyEqualPoints) {
  EXPECT_THAT(KdTree().WithinRadius({0, 0, 0}, 1e9), IsEmpty());
  EXPECT_THAT(KdTree().Nearest({0, 0, 0}, 3), IsEmpty());
  EXPECT_THAT(KdTree({{1, 1, 1}}).Nearest({0, 0, 0}, 3), ElementsAre(0));
  const KdTree equal(std::vector<Eigen::Vector3d>(500, {1, 2, 3}));
  EXPECT_EQ(equal.WithinRadius({1, 2, 3}, 0).size(), 500u);
  KdTree moved = KdTree({{1, 1, 1}});
  moved = KdTree({{0, 0, 0}, {1, 0, 0}});
  EXPECT_THAT(moved.Nearest({2, 0, 0}, 1), ElementsAre(1));
}

TEST(KdTree, TablesHoldEachPointOnceAndEachSplit) {
  const auto points = RandomPoints(500);
  const KdTreeTables tables = KdTree(points).Tables();
  std::vector<uint32_t> order(tables.links.begin(), tables.links.begin() + 500);
  std::sort(order.begin(), order.end());
  for (uint32_t i = 0; i < 500; ++i) EXPECT_EQ(order[i], i);
  // A tree with n inner nodes has n + 1 leaves.
  const size_t inner_nodes = tables.splits.size() / 2;
  EXPECT_GE(inner_nodes, 50u);
  EXPECT_EQ(tables.links.size(), 500 + 3 * inner_nodes + 2 * (inner_nodes + 1));
  EXPECT_THAT(KdTree().Tables().links, IsEmpty());
}

}  // namespace
}  // namespace carmap
