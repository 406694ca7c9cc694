#include "carmap/semantics/default_segmenter.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "carmap/semantics/mobility.h"

namespace carmap {
namespace {

TEST(DefaultSegmenter, TellsEachPixelOfImagesOfAnySize) {
  for (const cv::Size size : {cv::Size(1241, 376), cv::Size(620, 188), cv::Size(304, 126)}) {
    const auto segmenter = MakeDefaultSegmenter(size);
    ASSERT_TRUE(segmenter.ok()) << segmenter.status();
    cv::Mat noise(size, CV_8UC1);
    cv::RNG(1).fill(noise, cv::RNG::UNIFORM, 0, 256);
    const auto mobility = (*segmenter)->Segment({0, noise});
    ASSERT_TRUE(mobility.ok()) << mobility.status();
    EXPECT_EQ(mobility->type(), CV_8UC1);
    EXPECT_NEAR(static_cast<double>(mobility->cols) / mobility->rows,
                static_cast<double>(size.width) / size.height, 0.4);
    EXPECT_EQ(cv::countNonZero(*mobility == static_cast<double>(Mobility::kUnknown)), 0);
  }
}

TEST(DefaultSegmenter, AnEmptyRoadUnderAnEmptySkyIsStatic) {
  cv::Mat road(188, 620, CV_8UC1, cv::Scalar(200));
  road.rowRange(94, 188) = 90;
  const auto segmenter = MakeDefaultSegmenter(road.size());
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  const auto mobility = (*segmenter)->Segment({0, road});
  ASSERT_TRUE(mobility.ok()) << mobility.status();
  EXPECT_LT(cv::countNonZero(*mobility == static_cast<double>(Mobility::kNonStatic)),
            0.02 * static_cast<double>(mobility->total()));
}

}  // namespace
}  // namespace carmap
