#include "carmap/feature/patch_search.h"

#include <algorithm>
#include <cstdlib>

#include "carmap/feature/test_images.h"
#include "carmap/feature/test_processors.h"

namespace carmap {
namespace {

class FindAlongRowTest : public OnEachProcessor {
 protected:
  std::optional<int> Find(const cv::Mat& left, int x, int y, const cv::Mat& right, int x_first,
                          int x_last) {
    return FindAlongRow(left, x, y, right, x_first, x_last, options_, scratch_);
  }

  PatchSearchOptions options_;
  std::vector<uint16_t> scratch_;
};
INSTANTIATE_TEST_SUITE_P(Processors, FindAlongRowTest, kProcessors, NameOfProcessor);

int ReferenceDifference(const cv::Mat& left, int left_x, const cv::Mat& right, int right_x, int y) {
  int sum = 0;
  for (int dy = -kSearchRadius; dy <= kSearchRadius; ++dy) {
    for (int dx = -kSearchRadius; dx <= kSearchRadius; ++dx) {
      sum +=
          std::abs(left.at<uint8_t>(y + dy, left_x + dx) - right.at<uint8_t>(y + dy, right_x + dx));
    }
  }
  return sum;
}

/// The search by its definition.
std::optional<int> ReferencePlace(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                  int x_first, int x_last, const PatchSearchOptions& options) {
  int best = x_first;
  const auto difference_at = [&](int at) { return ReferenceDifference(left, x, right, at, y); };
  for (int at = x_first; at <= x_last; ++at) {
    if (difference_at(at) < difference_at(best)) best = at;
  }
  if (difference_at(best) > options.max_mean_difference * 121) return std::nullopt;
  for (int at = x_first; at <= x_last; ++at) {
    if (std::abs(at - best) > 2 && difference_at(at) <= options.uniqueness * difference_at(best))
      return std::nullopt;
  }
  return best;
}

TEST_P(FindAlongRowTest, EqualsTheDefinition) {
  size_t found = 0, total = 0;
  for (const int width : {70, 129, 200}) {
    const cv::Mat texture = Texture(width + 9, 40, width, 40);
    const cv::Mat left = WithNoise(texture.colRange(0, width), 4, 1);
    const cv::Mat right = WithNoise(texture.colRange(9, width + 9), 4, 2);
    for (int x = 6; x < width - 6; x += 3) {
      for (const int y : {5, 20, 33}) {
        for (const int x_first : {5, 11, std::max(5, x - 20)}) {
          const int x_last = std::max(x_first, std::min(x + 1, width - 6));
          const auto expected = ReferencePlace(left, x, y, right, x_first, x_last, options_);
          EXPECT_EQ(Find(left, x, y, right, x_first, x_last), expected) << x << " " << y;
          found += expected.has_value();
          ++total;
        }
      }
    }
  }
  EXPECT_GT(found, 300u);
  EXPECT_GT(total - found, 50u);
}

TEST_P(FindAlongRowTest, EqualsTheDefinitionWhereDifferencesAreLargest) {
  options_ = {.max_mean_difference = 255, .uniqueness = 1};
  const cv::Mat black(30, 90, CV_8UC1, cv::Scalar(0)), white(30, 90, CV_8UC1, cv::Scalar(255));
  cv::Mat spot = white.clone();
  spot.at<uint8_t>(15, 40) = 254;
  for (const cv::Mat& right : {white, spot}) {
    EXPECT_EQ(Find(black, 45, 15, right, 5, 70),
              ReferencePlace(black, 45, 15, right, 5, 70, options_));
  }
}

TEST_P(FindAlongRowTest, FindsNothingInNarrowImages) {
  const cv::Mat narrow = Texture(31, 40, 1, 40);
  EXPECT_FALSE(Find(narrow, 15, 20, narrow, 5, 25));
  const cv::Mat wide = Texture(32, 40, 1, 40);
  EXPECT_EQ(Find(wide, 15, 20, wide, 5, 25), 15);
}

}  // namespace
}  // namespace carmap
