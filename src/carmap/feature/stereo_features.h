// The vehicle's front end: features with depth of a stereo frame.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/stereo_matcher.h"
#include "carmap/geometry/camera.h"

namespace carmap {

struct FrontEndOptions {
  OrbOptions orb;
  StereoOptions stereo;
};

/// Wall-clock time of the front end's stages. The right image's pyramid is built beside what is
/// done with the left image, `pyramid_ms` and `extract_ms`.
struct FrontEndTimes {
  double pyramid_ms = 0, extract_ms = 0, stereo_ms = 0;
};

/// For one frame at a time, on all cores; the result does not depend on how many there are. Its
/// working memory is kept for the next frame.
class StereoFrontEnd {
 public:
  explicit StereoFrontEnd(const StereoRig& rig, const FrontEndOptions& options = {})
      : rig_(rig), orb_(options.orb), stereo_options_(options.stereo) {}

  /// Images: CV_8UC1 of the rig's size, rectified.
  std::vector<Feature> Extract(const cv::Mat& left, const cv::Mat& right,
                               FrontEndTimes* times = nullptr);

 private:
  const StereoRig rig_;
  OrbExtractor orb_;
  const StereoOptions stereo_options_;
  ImagePyramid left_, right_;
};

}  // namespace carmap
