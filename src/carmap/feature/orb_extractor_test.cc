#include "carmap/feature/orb_extractor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <tuple>

#include "carmap/feature/test_images.h"

namespace carmap {

bool operator==(const Feature& a, const Feature& b) {
  return a.x_px == b.x_px && a.y_px == b.y_px && a.disparity_px == b.disparity_px &&
         a.level == b.level && a.descriptor == b.descriptor;
}

namespace {

using ::testing::IsEmpty;

std::vector<Feature> Extract(const cv::Mat& image, const OrbOptions& options = {}) {
  return OrbExtractor(options).Extract(BuildPyramid(image));
}

TEST(HammingDistance, CountsBits) {
  Descriptor a, b;
  EXPECT_EQ(HammingDistance(a, b), 0);
  b.words = {~uint64_t{0}, ~uint64_t{0}};
  EXPECT_EQ(HammingDistance(a, b), 128);
  a.words[1] = 0x8000000000000001;
  EXPECT_EQ(HammingDistance(a, b), 126);
}

TEST(OrbExtractor, GivesDistinctFeaturesInsideTheImageUpToTheCount) {
  const cv::Mat image = Texture(640, 240, 1, 50);
  for (const int count : {0, 1, 50, 1600, 100000}) {
    const auto features = Extract(image, {.feature_count = count});
    EXPECT_LE(features.size(), static_cast<size_t>(count));
    if (count == 1600) {
      EXPECT_GT(features.size(), 1500u);
    }
    std::set<std::tuple<int, float, float>> places;
    for (const Feature& feature : features) {
      EXPECT_TRUE(places.emplace(feature.level, feature.y_px, feature.x_px).second);
      EXPECT_TRUE(feature.x_px > 15 && feature.x_px < 640 - 16);
      EXPECT_TRUE(feature.y_px > 15 && feature.y_px < 240 - 16);
      EXPECT_FALSE(feature.has_disparity());
    }
    EXPECT_TRUE(std::is_sorted(features.begin(), features.end(),
                               [](const auto& a, const auto& b) { return a.level < b.level; }));
  }
}

TEST(OrbExtractor, UsesEveryLevel) {
  std::array<int, kLevelCount> of_level{};
  for (const Feature& feature : Extract(Texture(1226, 370, 1, 50, 4))) ++of_level.at(feature.level);
  for (int level = 0; level < kLevelCount; ++level) EXPECT_GT(of_level[level], 40) << level;
}

TEST(OrbExtractor, SpreadsOverWeakAndStrongTexture) {
  cv::Mat image = Texture(640, 240, 2, 60);
  Texture(320, 240, 3, 12).copyTo(image(cv::Rect(320, 0, 320, 240)));
  for (const int count : {200, 800}) {
    const auto features = Extract(image, {.feature_count = count});
    const auto weak = std::count_if(features.begin(), features.end(),
                                    [](const Feature& feature) { return feature.x_px > 320; });
    EXPECT_GT(static_cast<double>(weak), 0.3 * static_cast<double>(features.size())) << count;
    EXPECT_LT(static_cast<double>(weak), 0.6 * static_cast<double>(features.size())) << count;
  }
}

TEST(OrbExtractor, KeepsTheStrongestCornerOfEachPlace) {
  const cv::Mat image = Texture(400, 200, 4, 50);
  const auto all = Extract(image, {.feature_count = 100000});
  const auto few = Extract(image, {.feature_count = 100});
  for (const Feature& feature : few) EXPECT_THAT(all, ::testing::Contains(feature));
}

TEST(OrbExtractor, IsDeterministic) {
  const cv::Mat image = WithNoise(Texture(640, 240, 5, 30), 3, 6);
  const auto first = Extract(image);
  for (int n = 0; n < 3; ++n) EXPECT_EQ(Extract(image.clone()), first);
}

TEST(OrbExtractor, DescriptorsMoveWithTheImage) {
  const cv::Mat large = Texture(420, 260, 7, 50);
  const cv::Rect here(0, 0, 400, 240), there(11, 7, 400, 240);
  std::map<std::pair<float, float>, Descriptor> first;
  const OrbOptions all{.feature_count = 1000000};
  for (const Feature& feature : Extract(large(here).clone(), all)) {
    if (feature.level == 0) first[{feature.x_px, feature.y_px}] = feature.descriptor;
  }
  // Within 20 pixels of the edge the patch's smoothing sees beyond it.
  const cv::Rect inside(31, 27, 348, 192);
  size_t compared = 0;
  for (const Feature& feature : Extract(large(there).clone(), all)) {
    const auto x = feature.x_px + 11, y = feature.y_px + 7;
    if (feature.level != 0 || !inside.contains(cv::Point2f(x, y))) continue;
    ASSERT_TRUE(first.contains({x, y})) << x << ", " << y;
    EXPECT_EQ(first.at({x, y}), feature.descriptor);
    ++compared;
  }
  EXPECT_GT(compared, 300u);
}

TEST(OrbExtractor, DescriptorsTellPlacesApartAndBearNoise) {
  const cv::Mat image = Texture(400, 240, 8, 50);
  std::map<std::pair<float, float>, Descriptor> clean;
  for (const Feature& feature : Extract(image)) {
    if (feature.level == 0) clean[{feature.x_px, feature.y_px}] = feature.descriptor;
  }
  std::vector<int> same, other;
  for (const Feature& feature : Extract(WithNoise(image, 4, 9))) {
    if (feature.level != 0) continue;
    for (const auto& [place, descriptor] : clean) {
      const double distance = std::hypot(place.first - feature.x_px, place.second - feature.y_px);
      if (distance < 0.5) same.push_back(HammingDistance(descriptor, feature.descriptor));
      if (distance > 20) other.push_back(HammingDistance(descriptor, feature.descriptor));
    }
  }
  ASSERT_GT(same.size(), 100u);
  EXPECT_LT(*std::max_element(same.begin(), same.end()), 25);
  std::nth_element(other.begin(), other.begin() + other.size() / 1000, other.end());
  EXPECT_GT(other[other.size() / 1000], 30) << "one in a thousand is nearer";
}

TEST(OrbExtractor, TakesImagesOfAnySize) {
  for (const auto& [width, height] :
       {std::array{1, 1}, {2, 300}, {300, 2}, {31, 31}, {33, 33}, {64, 32}, {65, 34}, {97, 41}}) {
    for (const Feature& feature : Extract(RandomPixels(width, height, 1))) {
      EXPECT_TRUE(feature.x_px > 0 && feature.x_px < width);
      EXPECT_TRUE(feature.y_px > 0 && feature.y_px < height);
    }
  }
  EXPECT_THAT(Extract(RandomPixels(64, 32, 1)), IsEmpty()) << "no patch fits";
  EXPECT_GT(Extract(Texture(397, 120, 1, 40)).size(), 600u);
  EXPECT_THAT(Extract(cv::Mat(240, 640, CV_8UC1, cv::Scalar(0))), IsEmpty());
}

}  // namespace
}  // namespace carmap
