#include "carmap/semantics/feature_mobility.h"

#include <gtest/gtest.h>

#include <limits>

namespace carmap {
namespace {

constexpr auto kStatic = Mobility::kStatic, kNonStatic = Mobility::kNonStatic,
               kUnknown = Mobility::kUnknown;

cv::Mat Labels(cv::Size size, Mobility mobility) {
  return {size, CV_8UC1, cv::Scalar(static_cast<double>(mobility))};
}

void Set(cv::Mat& labels, int column, int row, Mobility mobility) {
  labels.at<uint8_t>(row, column) = static_cast<uint8_t>(mobility);
}

std::vector<Mobility> At(const std::vector<Feature>& features, cv::Size image,
                         const cv::Mat& labels) {
  return MobilityOfFeatures(features, image, labels);
}

TEST(FeatureMobilityTest, TakesThePixelWhoseCentreIsNearest) {
  cv::Mat labels = Labels({8, 4}, kStatic);
  Set(labels, 5, 2, kNonStatic);
  Set(labels, 6, 2, kUnknown);
  EXPECT_EQ(At({{5, 2}, {4.51f, 1.51f}, {5.49f, 2.49f}, {4.49f, 2}, {5, 1.49f}, {5.51f, 2}}, {8, 4},
               labels),
            (std::vector{kNonStatic, kNonStatic, kNonStatic, kStatic, kStatic, kUnknown}));
}

TEST(FeatureMobilityTest, ImagesOfAnySizeShareTheirEdges) {
  // A pixel of the labels covers four by four of the features' image: columns 8 to 11, rows 4 to 7.
  cv::Mat labels = Labels({8, 4}, kStatic);
  Set(labels, 2, 1, kNonStatic);
  EXPECT_EQ(At({{7.49f, 4}, {7.51f, 4}, {11.49f, 7.49f}, {11.51f, 7}, {8, 3.49f}, {8, 7.51f}},
               {32, 16}, labels),
            (std::vector{kStatic, kNonStatic, kNonStatic, kStatic, kStatic, kStatic}));
  // Labels larger than the image, by different factors: pixel (1, 1) is at columns 2 to 3.
  cv::Mat large = Labels({8, 12}, kStatic);
  for (int row = 3; row < 6; ++row) Set(large, 2, row, kNonStatic), Set(large, 3, row, kNonStatic);
  EXPECT_EQ(At({{1, 1}, {0.51f, 1}, {1.49f, 1.49f}, {0.49f, 1}, {1, 1.51f}}, {4, 4}, large),
            (std::vector{kNonStatic, kNonStatic, kNonStatic, kStatic, kStatic}));
}

TEST(FeatureMobilityTest, TheBorderBelongsToTheOuterPixels) {
  cv::Mat labels = Labels({2, 2}, kStatic);
  Set(labels, 1, 1, kNonStatic);
  EXPECT_EQ(At({{-0.5f, -0.5f}, {3.5f, 3.5f}, {1e9f, 1e9f}, {-1e9f, 1e9f}}, {4, 4}, labels),
            (std::vector{kStatic, kNonStatic, kNonStatic, kStatic}));
  EXPECT_TRUE(At({}, {4, 4}, labels).empty());
}

}  // namespace
}  // namespace carmap
