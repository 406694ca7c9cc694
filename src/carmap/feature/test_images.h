// Seeded images for the tests of feature/.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

namespace carmap {

/// Every pixel by itself.
inline cv::Mat RandomPixels(int width, int height, uint64_t seed, int low = 0, int high = 255) {
  std::mt19937_64 random(seed);
  cv::Mat image(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at<uint8_t>(y, x) = static_cast<uint8_t>(low + random() % (high - low + 1));
    }
  }
  return image;
}

/// Blobs about 2 * blob_px across, with this standard deviation of the grey values around 128.
inline cv::Mat Texture(int width, int height, uint64_t seed, double contrast,
                       double blob_px = 1.5) {
  cv::Mat grey;
  RandomPixels(width, height, seed).convertTo(grey, CV_32F);
  cv::GaussianBlur(grey, grey, {}, blob_px);
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  cv::Mat texture;
  grey.convertTo(texture, CV_8U, contrast / deviation[0], 128 - mean[0] * contrast / deviation[0]);
  return texture;
}

/// What a camera sees of a fronto-parallel wall, and what it sees standing elsewhere. Sampled from
/// a finer image, so that disparities in fifths of a pixel are exact.
class Wall {
 public:
  Wall(int width, int height, uint64_t seed, double blob_px = 1.5)
      : size_(width, height),
        fine_(Texture(kFine * (width + kRoomPx), kFine * (height + 2), seed, 45, kFine * blob_px)) {
  }

  /// The wall moved left by `fifths_left` and down by `fifths_down` fifths of a pixel (-5 to 5).
  cv::Mat Moved(int fifths_left, int fifths_down = 0) const {
    cv::Mat image(size_, CV_8UC1);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        image.at<uint8_t>(y, x) =
            fine_.at<uint8_t>(kFine * (y + 1) - fifths_down, kFine * x + fifths_left);
      }
    }
    return image;
  }

 private:
  static constexpr int kFine = 5, kRoomPx = 120;
  cv::Size size_;
  cv::Mat fine_;
};

/// Adds noise of this standard deviation to each pixel.
inline cv::Mat WithNoise(const cv::Mat& image, double sigma, uint64_t seed) {
  std::mt19937_64 random(seed);
  cv::Mat noisy = image.clone();
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      double sum = -6;
      for (int i = 0; i < 12; ++i) sum += static_cast<double>(random() >> 11) * 0x1p-53;
      noisy.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(image.at<uint8_t>(y, x) + sigma * sum);
    }
  }
  return noisy;
}

}  // namespace carmap
