#include "carmap/feature/dense_disparity.h"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace carmap {
namespace {

constexpr int kWidth = 620;        // about, of the images that are matched
constexpr double kNearestM = 3.5;  // what is nearer has no disparity
constexpr int kSubpixel = 16;      // OpenCV's
constexpr int kBlock = 5;
constexpr int kUniquenessPercent = 5;
constexpr int kSpecklePx = 60, kSpeckleRange = 2;
constexpr int kMaxLeftRight = 2;

}  // namespace

DenseDisparity::DenseDisparity(const cv::Mat& left, const cv::Mat& right, const StereoRig& rig)
    : shrinking_(std::max(1, static_cast<int>(std::lround(1.0 * left.cols / kWidth)))) {
  cv::Mat small_left = left, small_right = right;
  if (shrinking_ > 1) {
    const cv::Size size(left.cols / shrinking_, left.rows / shrinking_);
    cv::resize(left, small_left, size, 0, 0, cv::INTER_AREA);
    cv::resize(right, small_right, size, 0, 0, cv::INTER_AREA);
  }
  const int most = static_cast<int>(rig.DisparityAt(kNearestM) / shrinking_);
  const int disparities = std::clamp((most / 16 + 1) * 16, 16, small_left.cols / 16 * 16);
  const auto matcher = cv::StereoSGBM::create(
      /*minDisparity=*/0, disparities, kBlock, 8 * kBlock * kBlock, 32 * kBlock * kBlock,
      kMaxLeftRight, /*preFilterCap=*/31, kUniquenessPercent, kSpecklePx, kSpeckleRange,
      cv::StereoSGBM::MODE_SGBM_3WAY);
  matcher->compute(small_left, small_right, disparity_);
}

DenseDisparity::Around DenseDisparity::LookAt(double u_px, double v_px, double radius_px,
                                              double disparity_px) const {
  const auto place = [&](double px) { return static_cast<int>(std::floor(px / shrinking_)); };
  const int left = std::max(place(u_px - radius_px), 0);
  const int right = std::min(place(u_px + radius_px), disparity_.cols - 1);
  const int top = std::max(place(v_px - radius_px), 0);
  const int bottom = std::min(place(v_px + radius_px), disparity_.rows - 1);
  const double nearest = disparity_px / shrinking_ * kSubpixel;
  size_t looked_at = 0, known = 0, nearer = 0;
  for (int y = top; y <= bottom; ++y) {
    for (int x = left; x <= right; ++x) {
      const int16_t disparity = disparity_.at<int16_t>(y, x);
      ++looked_at;
      known += disparity > 0;
      nearer += disparity > nearest;
    }
  }
  if (looked_at == 0) return {};
  return {static_cast<double>(known) / static_cast<double>(looked_at),
          static_cast<double>(nearer) / static_cast<double>(looked_at)};
}

}  // namespace carmap
