#include "carmap/feature/brightness.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace carmap {
namespace {

/// Between pairs of equal cameras, whose images do not show quite the same.
constexpr double kMaxEqualRatio = 1.12;

constexpr int kBlocksAcross = 16, kBlocksDown = 6;

}  // namespace

double BrightnessRatio(const cv::Mat& left, const cv::Mat& right) {
  constexpr float kMinGrey = 8;
  const cv::Size blocks(kBlocksAcross, kBlocksDown);
  cv::Mat of_left, of_right;
  cv::resize(left, of_left, blocks, 0, 0, cv::INTER_AREA);
  cv::resize(right, of_right, blocks, 0, 0, cv::INTER_AREA);
  struct Block {
    uint8_t in_left, in_right;
  };
  std::vector<Block> lit;
  for (int y = 0; y < blocks.height; ++y) {
    for (int x = 0; x < blocks.width; ++x) {
      const Block block{of_left.at<uint8_t>(y, x), of_right.at<uint8_t>(y, x)};
      if (std::min(block.in_left, block.in_right) >= kMinGrey) lit.push_back(block);
    }
  }
  if (lit.size() < static_cast<size_t>(blocks.area()) / 4) return 1;
  std::sort(lit.begin(), lit.end(), [](const Block& a, const Block& b) {
    return std::max(a.in_left, a.in_right) < std::max(b.in_left, b.in_right);
  });
  std::vector<double> ratios;
  for (size_t i = 0; i <= lit.size() / 2; ++i) {
    ratios.push_back(static_cast<double>(lit[i].in_right) / lit[i].in_left);
  }
  std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
  return ratios[ratios.size() / 2];
}

cv::Mat WithBrightnessOfLeft(const cv::Mat& right, double brightness_ratio) {
  if (std::abs(std::log(brightness_ratio)) < std::log(kMaxEqualRatio)) return right;
  cv::Mat equal;
  right.convertTo(equal, CV_8U, 1 / brightness_ratio);
  return equal;
}

}  // namespace carmap
