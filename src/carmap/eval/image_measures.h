// What an image is like, as far as a front end notices: brightness, gradients, sharpness, noise,
// corners, and how well a stereo match fits.
//
// Grey values are 0 to 255. Images are 8-bit grey. Pure functions, thread-safe.
#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "carmap/feature/feature.h"
#include "carmap/feature/image_pyramid.h"

namespace carmap {

struct GreyMeasures {
  double mean = 0;
  double spread = 0;             ///< standard deviation
  double saturated_percent = 0;  ///< pixels at 255
  /// Of the magnitude of central differences, grey values a pixel.
  double gradient_median = 0, gradient_p90 = 0;
  /// Standard deviation within blocks of 8×8 px, tenth percentile: where nothing but the camera's
  /// noise is left. Blocks with saturated pixels have none and do not count.
  double flat_noise = 0;
  /// Natural images have a power spectrum of about 1/f^n with n near 2 (Field 1987). This is n
  /// between the octaves about 0.09 and 0.18 cycles a pixel, and between 0.18 and 0.35: lens and
  /// sharpening show in the second.
  double spectrum_coarse = 0, spectrum_fine = 0;
};

/// Needs at least 32×32 px.
GreyMeasures MeasureGrey(const cv::Mat& image);

/// Corners of each level of a pyramid, before any are selected.
struct CornerCounts {
  std::array<int, kLevelCount> strong{};  ///< contrast >= 20: what the extractor takes first
  int weak = 0;                           ///< of all levels, contrast >= 7: all that it can take
};

CornerCounts CountCorners(const ImagePyramid& pyramid);

/// How well the surroundings of a feature fit those of its stereo match, at its level.
struct StereoFit {
  double difference = 0;     ///< mean absolute difference of 11×11 grey values
  double brightness = 0;     ///< by how much the right one is brighter on average, grey values
  double row_offset_px = 0;  ///< of the right image's row to the left's, where the fit is best
};

/// Nothing for a feature without disparity or too near an edge.
std::optional<StereoFit> MeasureStereoFit(const ImagePyramid& left, const ImagePyramid& right,
                                          const Feature& feature);

}  // namespace carmap
