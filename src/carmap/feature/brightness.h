// How bright the images of a pair are: depth is found by grey values, which must be comparable.
//
// Pure functions.
#pragma once

#include <opencv2/core/mat.hpp>

namespace carmap {

/// How many times as bright the right image is as the left one, of the same size: the median over
/// the darker half of its blocks, which are least cut off at white, and most of which show the same
/// in both. 1 where they are too dark to tell.
/// Both: CV_8UC1.
double BrightnessRatio(const cv::Mat& left, const cv::Mat& right);

/// The right image as bright as the left one, where the cameras differ by more than scenes do.
cv::Mat WithBrightnessOfLeft(const cv::Mat& right, double brightness_ratio);

}  // namespace carmap
