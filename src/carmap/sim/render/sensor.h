// From light to grey values: exposure, motion blur, lens, noise, eight bits.
//
// Pure functions, thread-safe; noise is drawn from (seed, frame, camera).
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "carmap/sim/render/renderer.h"

namespace carmap {

struct SensorOptions {
  double exposure_s = 0.002;   ///< shutter; with the motion it makes the blur
  double blur_sigma_px = 0.4;  ///< of lens and interpolation by rectification
  double read_noise = 1.0;     ///< grey values, at gain 1
  double shot_noise = 0.15;    ///< grey values, per square root of the grey value
  double sensitivity = 1;      ///< relative to the other cameras of the rig
  double black_level = 0;      ///< grey values
  double vignetting = 0;       ///< share of the light that is lost in the image's corners
  uint64_t seed = 1;
};

/// `gain` is the automatic exposure's: radiance times gain, 1 is white.
cv::Mat Expose(const RenderedView& view, const SensorOptions& options, double gain, uint32_t frame,
               uint32_t camera);

/// The gain that an automatic exposure tends to for this view: only the brightest twenty-fifth is
/// burnt out, unless that would leave the middle too dark or too bright.
double AutomaticGain(const cv::Mat& radiance);

}  // namespace carmap
