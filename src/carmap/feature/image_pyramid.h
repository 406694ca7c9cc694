// One image at several sizes, each kLevelScale smaller than the one before.
//
// A plain value; copies share pixels (cv::Mat).
#pragma once

#include <array>
#include <opencv2/core/mat.hpp>

#include "carmap/feature/feature.h"

namespace carmap {

using ImagePyramid = std::array<cv::Mat, kLevelCount>;

/// Level 0 is `image` itself (8-bit grey), shared. Levels are filtered bilinearly. The memory of
/// the levels of `pyramid` is used again where sizes agree: their pixels, of copies too, are lost.
ImagePyramid BuildPyramid(const cv::Mat& image, ImagePyramid pyramid = {});

}  // namespace carmap
