#include "carmap/feature/image_pyramid.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/feature/test_images.h"
#include "carmap/feature/test_processors.h"

namespace carmap {
namespace {

class BuildPyramidTest : public OnEachProcessor {};
INSTANTIATE_TEST_SUITE_P(Processors, BuildPyramidTest, kProcessors, NameOfProcessor);

TEST_P(BuildPyramidTest, LevelsShrinkByOneScaleAndShareEdges) {
  // A ramp stays a ramp at the coordinates that FullSizeFromLevel gives. The mean of one that rises
  // and one that falls does not care that greys are rounded down.
  cv::Mat rising(200, 250, CV_8UC1);
  for (int x = 0; x < rising.cols; ++x) rising.col(x).setTo(x);
  const ImagePyramid risings = BuildPyramid(rising), fallings = BuildPyramid(255 - rising);
  EXPECT_EQ(risings[0].data, rising.data);
  for (int level = 1; level < kLevelCount; ++level) {
    const double scale = ScaleOfLevel(level);
    const cv::Size size = risings[level].size();
    EXPECT_NEAR(size.width, rising.cols / scale, 2) << level;
    EXPECT_NEAR(size.height, rising.rows / scale, 2) << level;
    double sum = 0;
    for (int x = 5; x < size.width - 5; ++x) {
      const int row = size.height / 2;
      const double at_px =
          (risings[level].at<uint8_t>(row, x) - fallings[level].at<uint8_t>(row, x) + 255) / 2.0;
      EXPECT_NEAR(at_px, FullSizeFromLevel(x, scale), 1.2) << level;
      sum += at_px - FullSizeFromLevel(x, scale);
    }
    EXPECT_NEAR(sum / (size.width - 10), 0, 0.1) << level;
  }
}

// OpenCV's own builds may round otherwise, so one grey value is allowed.
TEST_P(BuildPyramidTest, ShrinksAsOpenCvDoes) {
  for (const auto& [width, height] :
       {std::pair{1241, 376}, {620, 188}, {97, 61}, {40, 200}, {33, 9}, {17, 3}, {7, 5}, {1, 1}}) {
    const cv::Mat image = RandomPixels(width, height, width);
    const ImagePyramid pyramid = BuildPyramid(image);
    for (int level = 1; level < kLevelCount; ++level) {
      cv::Mat expected;
      cv::resize(pyramid[level - 1], expected, {}, 1 / kLevelScale, 1 / kLevelScale,
                 cv::INTER_LINEAR);
      ASSERT_EQ(pyramid[level].size(), expected.size()) << width << " level " << level;
      EXPECT_LE(cv::norm(pyramid[level], expected, cv::NORM_INF), 1) << width << " level " << level;
    }
  }
}

TEST_P(BuildPyramidTest, UsesOldMemoryWhateverItHeld) {
  ImagePyramid pyramid = BuildPyramid(RandomPixels(300, 100, 1));
  for (const cv::Size size : {cv::Size(300, 100), cv::Size(90, 50)}) {
    const cv::Mat image = RandomPixels(size.width, size.height, 2);
    const uint8_t* const memory = pyramid[3].data;
    pyramid = BuildPyramid(image, std::move(pyramid));
    if (size.width == 300) {
      EXPECT_EQ(pyramid[3].data, memory);
    }
    const ImagePyramid expected = BuildPyramid(image);
    for (int level = 0; level < kLevelCount; ++level) {
      EXPECT_EQ(cv::norm(pyramid[level], expected[level], cv::NORM_INF), 0) << level;
    }
  }
}

TEST(Levels, CoordinatesThereAndBack) {
  for (int level = 0; level < kLevelCount; ++level) {
    const double scale = ScaleOfLevel(level);
    EXPECT_NEAR(LevelFromFullSize(FullSizeFromLevel(17, scale), scale), 17, 1e-12);
    EXPECT_NEAR(FullSizeFromLevel(-0.5, scale), -0.5, 1e-12) << "edges are shared";
  }
}

}  // namespace
}  // namespace carmap
