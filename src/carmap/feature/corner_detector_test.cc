#include "carmap/feature/corner_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <opencv2/core.hpp>

#include "carmap/feature/test_images.h"
#include "carmap/feature/test_processors.h"

namespace carmap {

bool operator==(const Corner& a, const Corner& b) {
  return a.x == b.x && a.y == b.y && a.score == b.score;
}
void PrintTo(const Corner& corner, std::ostream* out) {
  *out << "(" << corner.x << ", " << corner.y << "): " << int{corner.score};
}

namespace {

using ::testing::IsEmpty;

/// FAST-9 by its definition: the largest t at which nine neighbours in a row are all brighter, or
/// all darker, by at least t.
int ReferenceScore(const cv::Mat& image, int x, int y) {
  constexpr std::array<std::array<int, 2>, 16> kRing = {{{0, -3},
                                                         {1, -3},
                                                         {2, -2},
                                                         {3, -1},
                                                         {3, 0},
                                                         {3, 1},
                                                         {2, 2},
                                                         {1, 3},
                                                         {0, 3},
                                                         {-1, 3},
                                                         {-2, 2},
                                                         {-3, 1},
                                                         {-3, 0},
                                                         {-3, -1},
                                                         {-2, -2},
                                                         {-1, -3}}};
  int score = 0;
  for (const int sign : {1, -1}) {
    for (int first = 0; first < 16; ++first) {
      int least = 255;
      for (int i = first; i < first + 9; ++i) {
        const auto& [dx, dy] = kRing[i % 16];
        least =
            std::min(least, sign * (image.at<uint8_t>(y + dy, x + dx) - image.at<uint8_t>(y, x)));
      }
      score = std::max(score, least);
    }
  }
  return score;
}

std::vector<Corner> ReferenceCorners(const cv::Mat& image, int threshold, int margin) {
  cv::Mat scores = cv::Mat::zeros(image.size(), CV_32S);
  for (int y = margin; y < image.rows - margin; ++y) {
    for (int x = margin; x < image.cols - margin; ++x) {
      const int score = ReferenceScore(image, x, y);
      if (score >= threshold) scores.at<int>(y, x) = score;
    }
  }
  std::vector<Corner> corners;
  for (int y = margin; y < image.rows - margin; ++y) {
    for (int x = margin; x < image.cols - margin; ++x) {
      const int score = scores.at<int>(y, x);
      bool is_maximum = score > 0;
      for (int i = 0; i < 9; ++i) {
        const int other = scores.at<int>(y - 1 + i / 3, x - 1 + i % 3);
        is_maximum &= i < 4 ? score > other : score >= other;  // of equal neighbours the first wins
      }
      if (is_maximum) {
        corners.push_back(
            {static_cast<int16_t>(x), static_cast<int16_t>(y), static_cast<uint8_t>(score)});
      }
    }
  }
  return corners;
}

class DetectCornersTest : public OnEachProcessor {};
INSTANTIATE_TEST_SUITE_P(Processors, DetectCornersTest, kProcessors, NameOfProcessor);

TEST_P(DetectCornersTest, EqualsTheDefinitionOnImagesOfOddSizes) {
  size_t total = 0;
  for (const auto& [width, height] :
       {std::array{101, 67}, {64, 40}, {257, 33}, {73, 129}, {397, 31}}) {
    for (const int margin : {4, 5, 16}) {
      for (const int threshold : {1, 10, 40}) {
        const uint64_t seed = width + 1000 * margin + threshold;
        for (const cv::Mat& image :
             {RandomPixels(width, height, seed), Texture(width, height, seed, 40)}) {
          const auto expected = ReferenceCorners(image, threshold, margin);
          EXPECT_EQ(DetectCorners(image, threshold, margin), expected)
              << width << "x" << height << " margin " << margin << " threshold " << threshold;
          total += expected.size();
        }
      }
    }
  }
  EXPECT_GT(total, 5000u);
}

TEST_P(DetectCornersTest, EqualsTheDefinitionWhereAVectorDoesNotFit) {
  size_t total = 0;
  for (int width = 1; width <= 80; ++width) {
    const cv::Mat image = RandomPixels(width, 37, width);
    const auto expected = ReferenceCorners(image, 10, 4);
    EXPECT_EQ(DetectCorners(image, 10, 4), expected) << width;
    total += expected.size();
  }
  EXPECT_GT(total, 100u);
}

TEST_P(DetectCornersTest, EqualsTheDefinitionWhereManyScoresAreEqual) {
  const cv::Mat two_greys = RandomPixels(150, 90, 3, 0, 1) * 20;
  EXPECT_EQ(DetectCorners(two_greys, 10, 4), ReferenceCorners(two_greys, 10, 4));
  const cv::Mat saturated = RandomPixels(150, 90, 4, 0, 1) * 255;
  const auto corners = DetectCorners(saturated, 10, 4);
  EXPECT_EQ(corners, ReferenceCorners(saturated, 10, 4));
  ASSERT_FALSE(corners.empty());
  EXPECT_EQ(corners.front().score, 255);
}

TEST_P(DetectCornersTest, ReadsRowsThatAreApart) {
  const cv::Mat large = RandomPixels(200, 100, 5);
  const cv::Mat part = large({13, 7, 121, 59});
  EXPECT_EQ(DetectCorners(part, 20, 4), ReferenceCorners(part.clone(), 20, 4));
}

TEST_P(DetectCornersTest, FindsNothingInFlatOrTinyImages) {
  for (const int grey : {0, 128, 255}) {
    EXPECT_THAT(DetectCorners(cv::Mat(60, 90, CV_8UC1, cv::Scalar(grey)), 1, 4), IsEmpty());
  }
  for (const auto& [width, height] : {std::array{1, 1}, {7, 100}, {100, 8}, {8, 8}, {200, 5}}) {
    EXPECT_THAT(DetectCorners(RandomPixels(width, height, 1), 1, 4), IsEmpty());
  }
  EXPECT_THAT(DetectCorners(cv::Mat(), 1, 4), IsEmpty());
}

TEST_P(DetectCornersTest, FindsACornerAndItsContrast) {
  cv::Mat image(60, 90, CV_8UC1, cv::Scalar(50));
  image(cv::Rect(40, 30, 30, 20)).setTo(110);
  const auto corners = DetectCorners(image, 10, 4);
  ASSERT_EQ(corners.size(), 4u);
  EXPECT_NEAR(corners[0].x, 40, 1);
  EXPECT_NEAR(corners[0].y, 30, 1);
  for (const Corner& corner : corners) EXPECT_EQ(corner.score, 60);
  EXPECT_EQ(DetectCorners(image, 60, 4).size(), 4u);
  EXPECT_THAT(DetectCorners(image, 61, 4), IsEmpty());
}

}  // namespace
}  // namespace carmap
