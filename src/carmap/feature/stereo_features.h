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

/// Wall-clock time of the front end's stages.
struct FrontEndTimes {
  double pyramid_ms = 0, extract_ms = 0, stereo_ms = 0;
};

/// Thread-safe; uses all cores for one frame. The result does not depend on how many there are.
std::vector<Feature> ExtractStereoFeatures(const cv::Mat& left, const cv::Mat& right,
                                           const StereoRig& rig, const FrontEndOptions& options,
                                           FrontEndTimes* times = nullptr);

}  // namespace carmap
