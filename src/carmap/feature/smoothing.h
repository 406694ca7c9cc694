// Gaussian smoothing, before pixels are compared one by one.
//
// Pure function; counts in whole numbers, so every processor gives the same.
#pragma once

#include <opencv2/core/mat.hpp>

namespace carmap {

constexpr int kMinSmoothedSide = 32;  ///< pixels

/// The image under a Gaussian of deviation 2 px, 7 x 7 pixels, mirrored at its edges: what
/// cv::GaussianBlur gives, in less time. The memory of `smooth` is used again if the size agrees.
/// `image`: CV_8UC1 of at least kMinSmoothedSide columns and 4 rows.
void SmoothImage(const cv::Mat& image, cv::Mat& smooth);

}  // namespace carmap
