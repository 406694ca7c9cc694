#include "carmap/feature/stereo_features.h"

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/base/stopwatch.h"
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
      [&] { right_ = BuildPyramid(AtFeatureSize(right), std::move(right_)); });
  const double extract_ms = watch.ElapsedMs();
  MatchStereo(left_, right_, rig_, stereo_options_, features);
  if (times) {
    *times = {pyramid_ms, extract_ms - pyramid_ms, watch.ElapsedMs() - extract_ms};
  }
  return features;
}

}  // namespace carmap
