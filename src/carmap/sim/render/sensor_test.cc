#include "carmap/sim/render/sensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

namespace carmap {
namespace {

RenderedView EvenView(float radiance) {
  RenderedView view;
  view.radiance = cv::Mat(100, 200, CV_32F, cv::Scalar(radiance));
  view.motion_px = cv::Mat(100, 200, CV_32FC2, cv::Scalar(0, 0));
  return view;
}

double Deviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0];
}

TEST(Sensor, NoiseIsAsStated) {
  for (const float radiance : {0.1f, 0.4f, 0.7f}) {
    const cv::Mat grey = Expose(EvenView(radiance), {}, 1, 0, 0);
    const double level = cv::mean(grey)[0];
    const SensorOptions options;
    const double stated = std::hypot(options.read_noise, options.shot_noise * std::sqrt(level));
    // Whole grey values add a twelfth to the variance.
    EXPECT_NEAR(Deviation(grey), std::sqrt(stated * stated + 1. / 12), 0.05 * stated);
  }
}

TEST(Sensor, CamerasMayBeDarkerInTheCornersAndUnlike) {
  SensorOptions options;
  options.vignetting = 0.2;
  const cv::Mat grey = Expose(EvenView(0.5f), options, 1, 0, 0);
  const double middle = cv::mean(grey(cv::Rect(90, 40, 20, 20)))[0];
  const double corner = cv::mean(grey(cv::Rect(0, 0, 6, 6)))[0];
  EXPECT_NEAR(corner / middle, 0.81, 0.02);
  SensorOptions other;
  other.sensitivity = 1.1;
  other.black_level = 5;
  EXPECT_NEAR(cv::mean(Expose(EvenView(0.5f), other, 1, 0, 0))[0],
              1.1 * cv::mean(Expose(EvenView(0.5f), {}, 1, 0, 0))[0] + 5, 0.5);
}

TEST(Sensor, NoiseDiffersByFrameAndCameraAndIsRepeatable) {
  const RenderedView view = EvenView(0.4f);
  const cv::Mat grey = Expose(view, {}, 1, 5, 0);
  EXPECT_EQ(cv::norm(grey, Expose(view, {}, 1, 5, 0), cv::NORM_INF), 0);
  for (const cv::Mat& other : {Expose(view, {}, 1, 6, 0), Expose(view, {}, 1, 5, 1)}) {
    cv::Mat difference;
    cv::subtract(grey, other, difference, {}, CV_32F);
    EXPECT_NEAR(Deviation(difference), std::sqrt(2) * Deviation(grey), 0.1 * Deviation(grey));
  }
}

constexpr SensorOptions kNoiseless{.blur_sigma_px = 0, .read_noise = 0, .shot_noise = 0};

/// Dark to the left of column 100, bright from there on.
RenderedView Edge() {
  RenderedView view = EvenView(0.1f);
  view.radiance.colRange(100, 200).setTo(0.7f);
  return view;
}

TEST(Sensor, NothingMovesForAStandingCamera) {
  const cv::Mat grey = Expose(Edge(), kNoiseless, 1, 0, 0);
  EXPECT_EQ(Deviation(grey.colRange(0, 100)), 0);
  EXPECT_EQ(Deviation(grey.colRange(100, 200)), 0);
  EXPECT_GT(grey.at<uint8_t>(50, 100), grey.at<uint8_t>(50, 99) + 100);
}

TEST(Sensor, MotionBlursAlongItsWayAndNotAcross) {
  RenderedView view = Edge();
  SensorOptions options = kNoiseless;
  options.exposure_s = 0.01;
  view.motion_px.setTo(cv::Scalar(0, 600));
  EXPECT_EQ(
      cv::norm(Expose(view, options, 1, 0, 0), Expose(Edge(), options, 1, 0, 0), cv::NORM_INF), 0);
  view.motion_px.setTo(cv::Scalar(600, 0));  // 6 px
  const cv::Mat grey = Expose(view, options, 1, 0, 0);
  const int dark = grey.at<uint8_t>(50, 95), bright = grey.at<uint8_t>(50, 104);
  EXPECT_EQ(dark, grey.at<uint8_t>(50, 10));
  EXPECT_EQ(bright, grey.at<uint8_t>(50, 190));
  for (int x = 97; x <= 101; ++x) {
    EXPECT_GT(grey.at<uint8_t>(50, x + 1), grey.at<uint8_t>(50, x) + 10);
  }
}

TEST(Sensor, GainBringsBrightPartsToWhiteAndKeepsTheMiddleGrey) {
  cv::Mat radiance(100, 100, CV_32F, cv::Scalar(0.1));
  cv::Mat sky = radiance.rowRange(0, 30);
  sky.setTo(0.3f);
  EXPECT_NEAR(AutomaticGain(radiance), 1 / 0.3, 1e-3);
  sky.setTo(2.f);
  EXPECT_NEAR(AutomaticGain(radiance) * 0.1, 0.18, 1e-3);
  sky.setTo(0.1f);
  EXPECT_NEAR(AutomaticGain(radiance) * 0.1, 0.45, 1e-3);
}

}  // namespace
}  // namespace carmap
