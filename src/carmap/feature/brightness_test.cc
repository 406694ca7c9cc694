#include "carmap/feature/brightness.h"

#include <gtest/gtest.h>

#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

cv::Mat Brighter(const cv::Mat& image, double factor) {
  cv::Mat brighter;
  image.convertTo(brighter, CV_8U, factor);
  return brighter;
}

TEST(BrightnessRatio, IsThatOfTheCameras) {
  const cv::Mat left = Texture(320, 120, 1, 30);
  for (const double factor : {0.4, 0.6, 0.9, 1.0, 1.3, 1.6}) {
    EXPECT_NEAR(BrightnessRatio(left, Brighter(left, factor)), factor, 0.02) << factor;
  }
}

TEST(BrightnessRatio, OfNightIsNotKnown) {
  const cv::Mat night(120, 320, CV_8UC1, cv::Scalar(3)), lamp(120, 320, CV_8UC1, cv::Scalar(5));
  EXPECT_EQ(BrightnessRatio(night, lamp), 1);
}

TEST(WithBrightnessOfLeft, LeavesEqualCamerasAlone) {
  const cv::Mat left = Texture(320, 120, 1, 30);
  EXPECT_EQ(WithBrightnessOfLeft(left, 0.92).data, left.data);
  EXPECT_EQ(WithBrightnessOfLeft(left, 1.09).data, left.data);
}

TEST(WithBrightnessOfLeft, MakesCamerasEqual) {
  const cv::Mat left = Texture(320, 120, 1, 30);
  for (const double factor : {0.4, 1.6}) {
    const cv::Mat equal = WithBrightnessOfLeft(Brighter(left, factor), factor);
    EXPECT_LT(cv::norm(equal, left, cv::NORM_L1) / static_cast<double>(left.total()), 3) << factor;
  }
}

}  // namespace
}  // namespace carmap
