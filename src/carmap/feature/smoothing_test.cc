#include "carmap/feature/smoothing.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/feature/test_images.h"
#include "carmap/feature/test_processors.h"

namespace carmap {
namespace {

class SmoothImageTest : public OnEachProcessor {};
INSTANTIATE_TEST_SUITE_P(Processors, SmoothImageTest, kProcessors, NameOfProcessor);

/// OpenCV's own builds may round otherwise, so one grey value is allowed.
void ExpectSmoothedAsOpenCvDoes(const cv::Mat& image) {
  cv::Mat smooth, expected;
  SmoothImage(image, smooth);
  cv::GaussianBlur(image, expected, {7, 7}, 2, 2, cv::BORDER_REFLECT_101);
  ASSERT_EQ(smooth.size(), image.size());
  EXPECT_LE(cv::norm(smooth, expected, cv::NORM_INF), 1) << image.size();
}

TEST_P(SmoothImageTest, SmoothsAsOpenCvDoes) {
  for (const auto& [width, height] :
       {std::pair{1241, 376}, {kMinSmoothedSide, 4}, {33, 5}, {63, 40}, {64, 40}, {65, 41}}) {
    ExpectSmoothedAsOpenCvDoes(RandomPixels(width, height, width));
    ExpectSmoothedAsOpenCvDoes(RandomPixels(width, height, width, 0, 1) * 255);
  }
}

TEST_P(SmoothImageTest, KeepsFlatImagesAndTheirExtremes) {
  for (const int grey : {0, 1, 128, 254, 255}) {
    const cv::Mat flat(20, 50, CV_8UC1, cv::Scalar(grey));
    cv::Mat smooth;
    SmoothImage(flat, smooth);
    EXPECT_EQ(cv::norm(smooth, flat, cv::NORM_INF), 0) << grey;
  }
}

TEST_P(SmoothImageTest, ReadsRowsThatAreApart) {
  const cv::Mat large = RandomPixels(200, 100, 5);
  ExpectSmoothedAsOpenCvDoes(large({13, 7, 121, 59}).clone());
  cv::Mat of_part, of_copy;
  SmoothImage(large({13, 7, 121, 59}), of_part);
  SmoothImage(large({13, 7, 121, 59}).clone(), of_copy);
  EXPECT_EQ(cv::norm(of_part, of_copy, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace carmap
