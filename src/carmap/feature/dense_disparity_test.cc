#include "carmap/feature/dense_disparity.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

const StereoRig kRig{{700, 700, 620, 180, 1240, 360}, 0.5, {}};

cv::Mat Plaster(uint64_t seed) {
  return Texture(kRig.camera.width, kRig.camera.height, seed, 45, 2.5);
}

void Paste(const cv::Mat& what, cv::Rect place, int disparity_px, cv::Mat& left, cv::Mat& right) {
  what(place).copyTo(left(place));
  what(place).copyTo(right(place - cv::Point(disparity_px, 0)));
}

TEST(DenseDisparity, TellsWhatStandsBefore) {
  cv::Mat left = Plaster(1), right = Plaster(1);
  Paste(Plaster(1), {200, 0, 1000, 360}, 14, left, right);   // 25 m away
  Paste(Plaster(2), {500, 100, 300, 200}, 40, left, right);  // 9 m away, before it
  const DenseDisparity dense(left, right, kRig);
  const auto wall = dense.LookAt(900, 200, 10, 17);
  EXPECT_GT(wall.known_share, 0.9);
  EXPECT_LT(wall.nearer_share, 0.05);
  EXPECT_GT(dense.LookAt(650, 200, 10, 17).nearer_share, 0.9) << "the wall is hidden there";
  EXPECT_LT(dense.LookAt(650, 200, 10, 43).nearer_share, 0.05) << "what hides it is not";
}

TEST(DenseDisparity, KnowsNothingOutsideTheImage) {
  const cv::Mat blank(kRig.camera.height, kRig.camera.width, CV_8UC1, cv::Scalar(90));
  const DenseDisparity dense(blank, blank, kRig);
  EXPECT_EQ(dense.LookAt(-100, 20, 10, 5).known_share, 0);
  EXPECT_EQ(dense.LookAt(620, 500, 10, 5).known_share, 0);
}

}  // namespace
}  // namespace carmap
