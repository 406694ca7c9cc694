#include "carmap/eval/map_picture.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>

namespace carmap {
namespace {

namespace fs = std::filesystem;

/// A road 100 m ahead that bends to the right, with landmarks along it.
MapPicture MakePicture() {
  MapPicture picture{.title = "A bend", .landmarks_in_map = {}, .paths = {}};
  std::mt19937 random(3);
  std::normal_distribution<double> aside(0, 8);
  PicturePath truth{"truth", kTruthColour, {}}, estimate{"estimate", kEstimateColour, {}};
  for (double s = 0; s <= 100; ++s) {
    const Eigen::Vector3d p(s * s / 300, 0, s);
    truth.positions_in_map.push_back(p);
    estimate.positions_in_map.push_back(1.01 * p);
    for (int i = 0; i < 30; ++i) {
      picture.landmarks_in_map.push_back(p + Eigen::Vector3d(aside(random), -1, aside(random)));
    }
  }
  picture.paths = {truth, estimate};
  return picture;
}

int CountPixels(const cv::Mat& image, Rgb colour) {
  const cv::Scalar bgr(colour.blue, colour.green, colour.red);
  cv::Mat is_colour;
  cv::inRange(image, bgr, bgr, is_colour);
  return cv::countNonZero(is_colour);
}

/// Middle of the pixels of a colour left of the legend.
Eigen::Vector2d MeanPixel(const cv::Mat& image, Rgb colour, int rows_from, int rows_to) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  for (int y = rows_from; y < rows_to; ++y) {
    for (int x = 0; x < image.cols * 3 / 4; ++x) {
      if (image.at<cv::Vec3b>(y, x) != cv::Vec3b(colour.blue, colour.green, colour.red)) continue;
      sum += Eigen::Vector2d(x, y);
      ++count;
    }
  }
  return sum / count;
}

TEST(MapPictureTest, ShowsForwardUpAndRightRight) {
  MapPicture picture = MakePicture();
  picture.landmarks_in_map.clear();
  picture.paths.pop_back();
  const cv::Mat image = RenderMapPicture(picture);
  EXPECT_GE(image.cols, 1000);
  EXPECT_GT(CountPixels(image, kTruthColour), 500);
  const Eigen::Vector2d start = MeanPixel(image, kTruthColour, image.rows / 2, image.rows),
                        end = MeanPixel(image, kTruthColour, 0, image.rows / 2);
  EXPECT_GT(end.x(), start.x() + 50);
}

TEST(MapPictureTest, FarLandmarksDoNotShrinkIt) {
  MapPicture picture = MakePicture();
  const cv::Mat without = RenderMapPicture(picture);
  const size_t count = picture.landmarks_in_map.size();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  picture.landmarks_in_map[0] = {1e30, 0, -1e30};
  picture.landmarks_in_map[1] = {nan, nan, nan};
  picture.paths[0].positions_in_map[5] = {nan, nan, nan};
  picture.paths[0].positions_in_map[6] = {1e200, 0, 0};
  ASSERT_EQ(picture.landmarks_in_map.size(), count);
  const cv::Mat with = RenderMapPicture(picture);
  ASSERT_EQ(with.size(), without.size());
  cv::Mat difference;
  cv::absdiff(with, without, difference);
  EXPECT_LT(cv::mean(difference)[0], 0.5);
}

TEST(MapPictureTest, DrawsAnyContent) {
  EXPECT_GE(RenderMapPicture({}).cols, 1000);
  MapPicture only_landmarks = MakePicture();
  only_landmarks.paths.clear();
  EXPECT_GE(RenderMapPicture(only_landmarks).cols, 1000);
  MapPicture wide{
      .title = std::string(500, 'W') + "\n\xc3\xa4", .landmarks_in_map = {}, .paths = {}};
  wide.paths.push_back({"keyframes", kKeyframeColour, {{-9e5, 0, 0}, {9e5, 0, 3}}, true});
  const cv::Mat image = RenderMapPicture(wide);
  EXPECT_GE(image.cols, 1000);
  EXPECT_LT(image.total(), size_t{4'000'000});
}

TEST(MapPictureTest, WritesPng) {
  const fs::path path = fs::path(testing::TempDir()) / "carmap_picture_test.png";
  ASSERT_TRUE(WriteMapPicture(path, MakePicture()).ok());
  const cv::Mat read = cv::imread(path.string());
  EXPECT_EQ(cv::norm(read, RenderMapPicture(MakePicture()), cv::NORM_INF), 0);
  EXPECT_FALSE(WriteMapPicture(fs::path(testing::TempDir()) / "no" / "x.png", {}).ok());
}

}  // namespace
}  // namespace carmap
