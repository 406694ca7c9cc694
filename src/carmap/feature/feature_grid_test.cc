#include "carmap/feature/feature_grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

namespace carmap {
namespace {

constexpr int kWidth = 397, kHeight = 121;

std::vector<Feature> RandomFeatures(size_t count, std::mt19937& random) {
  std::uniform_real_distribution<float> x(-0.5f, kWidth - 0.5f), y(-0.5f, kHeight - 0.5f);
  std::vector<Feature> features(count);
  for (Feature& feature : features) {
    feature.x_px = x(random);
    feature.y_px = y(random);
  }
  return features;
}

std::vector<uint32_t> Near(const FeatureGrid& grid, double x, double y, double radius) {
  std::vector<uint32_t> found;
  grid.VisitNear(x, y, radius, [&](uint32_t idx) { found.push_back(idx); });
  std::sort(found.begin(), found.end());
  return found;
}

TEST(FeatureGrid, EqualsASearchOfAllFeatures) {
  std::mt19937 random(7);
  const std::vector<Feature> features = RandomFeatures(1500, random);
  const FeatureGrid grid(features, kWidth, kHeight);
  std::uniform_real_distribution<double> x(-60, kWidth + 60), y(-60, kHeight + 60), radius(0, 50);
  size_t total = 0;
  for (int n = 0; n < 2000; ++n) {
    const double qx = x(random), qy = y(random), r = radius(random);
    std::vector<uint32_t> expected;
    for (uint32_t i = 0; i < features.size(); ++i) {
      if (std::abs(features[i].x_px - qx) <= r && std::abs(features[i].y_px - qy) <= r) {
        expected.push_back(i);
      }
    }
    ASSERT_EQ(Near(grid, qx, qy, r), expected) << qx << ", " << qy << " within " << r;
    total += expected.size();
  }
  EXPECT_GT(total, 10000u);
}

TEST(FeatureGrid, FindsAFeatureOnTheEdgeOfTheSquareAndOfTheImage) {
  const std::vector<Feature> features = {{.x_px = 0, .y_px = 0},
                                         {.x_px = kWidth - 1, .y_px = kHeight - 1}};
  const FeatureGrid grid(features, kWidth, kHeight);
  EXPECT_EQ(Near(grid, 16, 16, 16), std::vector<uint32_t>{0});
  EXPECT_EQ(Near(grid, 0, 0, 0), std::vector<uint32_t>{0});
  EXPECT_EQ(Near(grid, kWidth - 1, kHeight - 1, 0), std::vector<uint32_t>{1});
  EXPECT_EQ(Near(grid, 0, 0, 1e4), (std::vector<uint32_t>{0, 1}));
}

TEST(FeatureGrid, HoldsNoFeatures) {
  const std::vector<Feature> none;
  EXPECT_TRUE(Near(FeatureGrid(none, kWidth, kHeight), 10, 10, 1e4).empty());
}

TEST(FeatureGrid, ListsTheFirstOfMoreFeaturesInOnePlaceThanAnImageShows) {
  std::vector<Feature> features(4096, {.x_px = 50, .y_px = 60});
  features.push_back({.x_px = 70, .y_px = 60});
  const FeatureGrid grid(features, kWidth, kHeight);
  std::vector<uint32_t> first(kMaxFeaturesOfCell);
  std::iota(first.begin(), first.end(), 0u);
  EXPECT_EQ(Near(grid, 50, 60, 0.1), first);
  EXPECT_EQ(Near(grid, 70, 60, 0.1), std::vector<uint32_t>{4096});
}

TEST(FeatureGrid, IsSmallWhateverTheImage) {
  const std::vector<Feature> features = {{.x_px = 0, .y_px = 0}, {.x_px = 16'000, .y_px = 9'000}};
  const FeatureGrid grid(features, 1 << 14, 1 << 14);
  EXPECT_LE(grid.cell_begins().size(), (size_t{1} << 14) + 1);
  std::vector<uint32_t> found;
  grid.VisitNear(16'010, 9'010, 20, [&](uint32_t idx) { found.push_back(idx); });
  EXPECT_EQ(found, std::vector<uint32_t>{1});
}

// A landmark beside the camera appears at no finite place.
TEST(FeatureGrid, FindsNothingFarOutside) {
  const std::vector<Feature> features = {{.x_px = 10, .y_px = 10}};
  const FeatureGrid grid(features, 100, 100);
  size_t count = 0;
  grid.VisitNear(1e300, -1e300, 4, [&](uint32_t) { ++count; });
  EXPECT_EQ(count, 0u);
}

}  // namespace
}  // namespace carmap
