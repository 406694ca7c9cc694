// The pictures of a frame and of errors: what must be seen in them, by its pixels.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "carmap/eval/error_picture.h"
#include "carmap/eval/frame_picture.h"
#include "carmap/eval/segmentation_picture.h"

namespace carmap {
namespace {

/// Pixels near this colour (BGR).
int CountNear(const cv::Mat& image, const cv::Scalar& bgr) {
  cv::Mat mask;
  cv::inRange(image, bgr - cv::Scalar::all(25), bgr + cv::Scalar::all(25), mask);
  return cv::countNonZero(mask);
}

const cv::Scalar kNear(255, 120, 40), kFar(40, 60, 230), kNotFound(90, 220, 250),
    kCurve(181, 90, 0);

TEST(FramePicture, TellsNearFromFarAndFoundFromNotFound) {
  FramePicture picture{"title", cv::Mat(100, 300, CV_8UC1, cv::Scalar(60)), {}, {}};
  const cv::Mat empty = RenderFramePicture(picture);
  EXPECT_GE(empty.cols, 300 * 4);
  picture.features = {{.x_px = 50, .y_px = 50, .disparity_px = 80, .level = 7},
                      {.x_px = 150, .y_px = 50, .disparity_px = 1, .level = 7},
                      {.x_px = 250, .y_px = 50, .level = 7}};
  picture.in_map = {true, true, false};
  const cv::Mat drawn = RenderFramePicture(picture);
  for (const cv::Scalar& colour : {kNear, kFar, kNotFound}) {
    EXPECT_GT(CountNear(drawn, colour), CountNear(empty, colour) + 30) << colour;
  }
  picture.in_map = {false, false, false};
  EXPECT_EQ(CountNear(RenderFramePicture(picture), kNear), CountNear(empty, kNear));
}

TEST(ErrorPicture, DrawsACurveWithAGapWhereNothingWasFound) {
  ErrorCurve curve{"position (m)", {}};
  for (int i = 0; i <= 100; ++i) curve.values.emplace_back(i, 1 + 0.5 * std::sin(0.2 * i));
  const cv::Mat whole = RenderErrorPicture("title", {curve});
  for (int i = 25; i <= 75; ++i) curve.values[i].y() = std::numeric_limits<double>::quiet_NaN();
  const cv::Mat with_gap = RenderErrorPicture("title", {curve});
  EXPECT_GT(CountNear(whole, kCurve), 1000);
  EXPECT_NEAR(CountNear(with_gap, kCurve), 0.5 * CountNear(whole, kCurve),
              0.15 * CountNear(whole, kCurve));
  const cv::Mat two = RenderErrorPicture("title", {curve, {"empty", {}}});
  EXPECT_GT(two.rows, whole.rows + 200);
}

TEST(SegmentationPicture, TellsFoundMissedAndWrong) {
  SegmentationPicture picture{"title",
                              cv::Mat(100, 400, CV_8UC1, cv::Scalar(0)),
                              cv::Mat(100, 400, CV_8UC1, cv::Scalar(1)),
                              {{"a", cv::Mat(100, 400, CV_8UC1, cv::Scalar(1))}}};
  picture.truth.colRange(100, 300).setTo(2);
  picture.told[0].mobility.colRange(200, 350).setTo(2);
  picture.told.push_back({"small", cv::Mat(1, 1, CV_8UC1, cv::Scalar(0))});
  const cv::Mat drawn = RenderSegmentationPicture(picture);
  // At three times the size, half the colour over black.
  const auto expect_area = [&](const cv::Scalar& bgr, double columns) {
    cv::Mat mask;
    cv::inRange(drawn, bgr / 2 - cv::Scalar::all(8), bgr / 2 + cv::Scalar::all(8), mask);
    EXPECT_NEAR(cv::countNonZero(mask), columns * 900, 0.04 * columns * 900) << bgr;
  };
  expect_area({181, 90, 0}, 100);
  expect_area({32, 50, 220}, 100 + 200);  // the second misses all
  expect_area({0, 159, 230}, 50);
}

}  // namespace
}  // namespace carmap
