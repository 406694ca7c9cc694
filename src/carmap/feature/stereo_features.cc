#include "carmap/feature/stereo_features.h"

#include <tbb/parallel_invoke.h>

#include "carmap/base/stopwatch.h"
#include "carmap/feature/image_pyramid.h"

namespace carmap {

std::vector<Feature> ExtractStereoFeatures(const cv::Mat& left, const cv::Mat& right,
                                           const StereoRig& rig, const FrontEndOptions& options,
                                           FrontEndTimes* times) {
  ImagePyramid left_pyramid, right_pyramid;
  const Stopwatch watch;
  tbb::parallel_invoke([&] { left_pyramid = BuildPyramid(left); },
                       [&] { right_pyramid = BuildPyramid(right); });
  const double pyramid_ms = watch.ElapsedMs();
  std::vector<Feature> features = ExtractOrb(left_pyramid, options.orb);
  const double extract_ms = watch.ElapsedMs();
  MatchStereo(left_pyramid, right_pyramid, rig, options.stereo, features);
  if (times) {
    *times = {pyramid_ms, extract_ms - pyramid_ms, watch.ElapsedMs() - extract_ms};
  }
  return features;
}

}  // namespace carmap
