// A picture of one frame: the image, its features, and which of them were found in the map.
//
// Pure functions.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

struct FramePicture {
  std::string title;
  cv::Mat image;  ///< 8-bit grey
  std::vector<Feature> features;
  std::vector<bool> in_map;  ///< by feature: it was seen as a landmark
};

/// 8-bit BGR. Circles are as large as the features; those found in the map are filled with a colour
/// from near (blue) to far (red) by their disparity.
cv::Mat RenderFramePicture(const FramePicture& picture);

}  // namespace carmap
