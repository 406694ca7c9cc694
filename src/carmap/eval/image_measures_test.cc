#include "carmap/eval/image_measures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

TEST(MeasureGrey, OfARamp) {
  cv::Mat image(128, 256, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) image.at<uint8_t>(y, x) = static_cast<uint8_t>(x);
  }
  const GreyMeasures measures = MeasureGrey(image);
  EXPECT_NEAR(measures.mean, 127.5, 1e-9);
  EXPECT_NEAR(measures.spread, 256 / std::sqrt(12), 0.1);
  EXPECT_NEAR(measures.saturated_percent, 100.0 / 256, 1e-9);
  EXPECT_NEAR(measures.gradient_median, 1, 1e-9);
  EXPECT_NEAR(measures.gradient_p90, 1, 1e-9);
  EXPECT_NEAR(measures.flat_noise, std::sqrt(63.0 / 12), 1e-9);  // of eight successive numbers
}

TEST(MeasureGrey, OfNothing) {
  const GreyMeasures measures = MeasureGrey(cv::Mat(64, 64, CV_8UC1, cv::Scalar(255)));
  EXPECT_EQ(measures.saturated_percent, 100);
  EXPECT_EQ(measures.flat_noise, 0);
  EXPECT_EQ(measures.gradient_p90, 0);
  EXPECT_EQ(measures.spectrum_fine, 0);
}

TEST(MeasureGrey, NoiseInFlatPlacesIsTheCameras) {
  cv::Mat image(256, 512, CV_8UC1, cv::Scalar(80));
  Texture(256, 128, 1, 50).copyTo(image(cv::Rect(0, 0, 256, 128)));  // a quarter is textured
  for (const double sigma : {1.0, 3.0}) {
    // The tenth percentile of standard deviations over 64 px: 1.28 of their own deviations,
    // sigma / sqrt(128), below the mean.
    EXPECT_NEAR(MeasureGrey(WithNoise(image, sigma, 2)).flat_noise, sigma * 0.9, 0.08 * sigma);
  }
}

/// Waves of all frequencies and random phases whose power falls as 1/f^n.
cv::Mat Waves(double n) {
  constexpr int kSide = 256;
  cv::Mat spectrum(kSide, kSide, CV_32FC2), sum;
  std::mt19937_64 random(7);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const double f = std::hypot(std::min(x, kSide - x), std::min(y, kSide - y)) / kSide;
      const double amplitude = f > 0.02 ? std::pow(f, -n / 2) : 0;
      const double phase = 2 * std::numbers::pi * static_cast<double>(random() >> 11) * 0x1p-53;
      spectrum.at<cv::Vec2f>(y, x) = {static_cast<float>(amplitude * std::cos(phase)),
                                      static_cast<float>(amplitude * std::sin(phase))};
    }
  }
  cv::idft(spectrum, sum, cv::DFT_REAL_OUTPUT);
  cv::Scalar mean, spread;
  cv::meanStdDev(sum, mean, spread);
  cv::Mat image;
  sum.convertTo(image, CV_8U, 40 / spread[0], 128 - mean[0] * 40 / spread[0]);
  return image;
}

TEST(MeasureGrey, ExponentOfTheSpectrum) {
  const GreyMeasures two = MeasureGrey(Waves(2));
  EXPECT_NEAR(two.spectrum_coarse, 2, 0.25);
  EXPECT_NEAR(two.spectrum_fine, 2, 0.25);
  const GreyMeasures white = MeasureGrey(RandomPixels(256, 256, 3));
  EXPECT_NEAR(white.spectrum_coarse, 0, 0.15);
  EXPECT_NEAR(white.spectrum_fine, 0, 0.1);
}

TEST(MeasureGrey, BlurShowsInTheFineSpectrum) {
  const cv::Mat sharp = RandomPixels(512, 256, 3);
  cv::Mat soft;
  cv::GaussianBlur(sharp, soft, {}, 0.7);
  // A Gaussian of sigma s multiplies the power by exp(-(2 pi f s)^2).
  EXPECT_GT(MeasureGrey(soft).spectrum_fine, MeasureGrey(sharp).spectrum_fine + 1.5);
}

TEST(CountCorners, CountsSquaresByTheirContrast) {
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(100));
  for (int i = 0; i < 6; ++i) {
    const int contrast = i < 2 ? 60 : 15;  // two strong ones of six
    image(cv::Rect(40 + 40 * i, 100, 12, 12)) += contrast;
  }
  const CornerCounts counts = CountCorners(BuildPyramid(image));
  EXPECT_EQ(counts.strong[0], 2 * 4);
  EXPECT_GE(counts.weak, 6 * 4);
  EXPECT_EQ(CountCorners(BuildPyramid(cv::Mat(240, 320, CV_8UC1, cv::Scalar(9)))).weak, 0);
}

Feature FeatureAt(double x, double y, double disparity, int level) {
  return {.x_px = static_cast<float>(FullSizeFromLevel(x, ScaleOfLevel(level))),
          .y_px = static_cast<float>(FullSizeFromLevel(y, ScaleOfLevel(level))),
          .disparity_px = static_cast<float>(disparity),
          .level = static_cast<uint8_t>(level)};
}

TEST(MeasureStereoFit, OfAWallIsGoodAtTheRightPlaceAlone) {
  const Wall wall(300, 120, 3);
  const ImagePyramid left = BuildPyramid(wall.Moved(0)), right = BuildPyramid(wall.Moved(5 * 12));
  for (const int level : {0, 3}) {
    const auto fit = MeasureStereoFit(left, right, FeatureAt(80, 30, 12, level));
    ASSERT_TRUE(fit);
    EXPECT_LT(fit->difference, level == 0 ? 0.1 : 4.0) << level;
    EXPECT_NEAR(fit->row_offset_px, 0, 0.05) << level;
  }
  EXPECT_GT(MeasureStereoFit(left, right, FeatureAt(80, 30, 18, 0))->difference, 15);
}

TEST(MeasureStereoFit, SeesRowsApartAndBrightnessAndNoise) {
  const Wall wall(300, 120, 3, /*blob_px=*/2.5);
  const ImagePyramid left = BuildPyramid(wall.Moved(0));
  const Feature feature = FeatureAt(150, 60, 12, 0);
  const auto lower = MeasureStereoFit(left, BuildPyramid(wall.Moved(5 * 12, 2)), feature);
  ASSERT_TRUE(lower);
  EXPECT_NEAR(lower->row_offset_px, 0.4, 0.05);
  const auto upper = MeasureStereoFit(left, BuildPyramid(wall.Moved(5 * 12, -4)), feature);
  EXPECT_NEAR(upper->row_offset_px, -0.8, 0.05);

  // A few pixels of the patch saturate.
  const auto brighter =
      MeasureStereoFit(left, BuildPyramid(wall.Moved(5 * 12) + cv::Scalar(6)), feature);
  EXPECT_NEAR(brighter->brightness, 6, 0.4);
  EXPECT_NEAR(brighter->difference, 6, 0.4);

  const auto noisy =
      MeasureStereoFit(left, BuildPyramid(WithNoise(wall.Moved(5 * 12), 5, 9)), feature);
  // The mean absolute value of Gaussian noise is 0.8 of its deviation.
  EXPECT_NEAR(noisy->difference, 0.8 * 5, 1);
}

TEST(MeasureStereoFit, NeedsADisparityAndRoom) {
  const Wall wall(300, 120, 3);
  const ImagePyramid left = BuildPyramid(wall.Moved(0)), right = BuildPyramid(wall.Moved(60));
  EXPECT_FALSE(MeasureStereoFit(left, right, FeatureAt(80, 30, Feature::kNoDisparity, 0)));
  EXPECT_FALSE(MeasureStereoFit(left, right, FeatureAt(80, 3, 12, 0)));
  EXPECT_FALSE(MeasureStereoFit(left, right, FeatureAt(16, 60, 12, 0)));
}

}  // namespace
}  // namespace carmap
