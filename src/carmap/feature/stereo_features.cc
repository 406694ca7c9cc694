#include "carmap/feature/stereo_features.h"

#include <tbb/parallel_invoke.h>

#include <utility>

#include "carmap/base/stopwatch.h"

namespace carmap {

std::vector<Feature> StereoFrontEnd::Extract(const cv::Mat& left, const cv::Mat& right,
                                             FrontEndTimes* times) {
  const Stopwatch watch;
  double pyramid_ms = 0;
  std::vector<Feature> features;
  tbb::parallel_invoke(
      [&] {
        left_ = BuildPyramid(left, std::move(left_));
        pyramid_ms = watch.ElapsedMs();
        features = orb_.Extract(left_);
      },
      [&] { right_ = BuildPyramid(right, std::move(right_)); });
  const double extract_ms = watch.ElapsedMs();
  MatchStereo(left_, right_, rig_, stereo_options_, features);
  if (times) {
    *times = {pyramid_ms, extract_ms - pyramid_ms, watch.ElapsedMs() - extract_ms};
  }
  return features;
}

}  // namespace carmap
