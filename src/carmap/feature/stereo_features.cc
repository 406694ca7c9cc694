#include "carmap/feature/stereo_features.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/base/stopwatch.h"
#include "carmap/feature/brightness.h"
#include "carmap/feature/twins.h"

namespace carmap {
namespace {

/// Wider images are searched as they are.
constexpr int kMaxEnlargedWidth = 1400;
constexpr int kMaxEnlargement = 2;

}  // namespace

int EnlargementFor(const PinholeCamera& camera) {
  return std::clamp(kMaxEnlargedWidth / std::max(camera.width, 1), 1, kMaxEnlargement);
}

StereoRig Enlarged(const StereoRig& rig, int factor) {
  StereoRig enlarged = rig;
  enlarged.camera = {rig.camera.fx * factor,
                     rig.camera.fy * factor,
                     LevelFromFullSize(rig.camera.cx, 1.0 / factor),
                     LevelFromFullSize(rig.camera.cy, 1.0 / factor),
                     rig.camera.width * factor,
                     rig.camera.height * factor};
  enlarged.disparity_bias.coefficients_px *= factor;
  return enlarged;
}

cv::Mat StereoFrontEnd::AtFeatureSize(const cv::Mat& image) const {
  if (enlargement_ == 1) return image;
  cv::Mat enlarged;
  cv::resize(image, enlarged, {rig_.camera.width, rig_.camera.height}, 0, 0, cv::INTER_CUBIC);
  return enlarged;
}

/// As a right camera would have seen it whose rows meet the left one's. Taken for a shift and a
/// turn of the image, which leave disparities alone but for what the turn makes of rows.
cv::Mat StereoFrontEnd::Aligned(const cv::Mat& right) const {
  if (misalignment_ == RowMisalignment()) return right;
  const PinholeCamera& camera = rig_.camera;
  const double c = std::cos(misalignment_.turn), s = std::sin(misalignment_.turn);
  const cv::Matx23d right_from_aligned(
      c, s, camera.cx - c * camera.cx - s * camera.cy,  //
      -s, c, camera.cy + s * camera.cx - c * camera.cy + misalignment_.down * camera.fy);
  cv::Mat aligned;
  cv::warpAffine(right, aligned, right_from_aligned, right.size(),
                 cv::INTER_CUBIC | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  return aligned;
}

PairGeometry StereoFrontEnd::MeasurePair(const std::vector<Feature>& left) {
  constexpr double kMaxRows = 0.12;  // of the image's height
  return EstimatePairGeometry(
      rig_.camera, MatchCorners(left, orb_.Extract(right_), kMaxRows * rig_.camera.height));
}

std::vector<Feature> StereoFrontEnd::Extract(const cv::Mat& left, const cv::Mat& right,
                                             FrontEndTimes* times) {
  const Stopwatch watch;
  double pyramid_ms = 0;
  std::vector<Feature> features;
  tbb::parallel_invoke(
      [&] {
        left_ = BuildPyramid(AtFeatureSize(left), std::move(left_));
        pyramid_ms = watch.ElapsedMs();
        features = orb_.Extract(left_);
        LinkTwins(rig_.camera, features);
      },
      [&] {
        brightness_ratio_ = BrightnessRatio(left, right);
        const cv::Mat equal = WithBrightnessOfLeft(right, brightness_ratio_);
        right_ = BuildPyramid(RightAtFeatureSize(equal), std::move(right_));
      });
  const double extract_ms = watch.ElapsedMs();
  MatchStereo(left_, right_, rig_, stereo_options_, features);
  if (times) {
    *times = {pyramid_ms, extract_ms - pyramid_ms, watch.ElapsedMs() - extract_ms};
  }
  return features;
}

}  // namespace carmap
