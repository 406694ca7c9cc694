// A picture of how an error goes on over the distance driven.
//
// Pure functions.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace carmap {

struct ErrorCurve {
  std::string name;                     ///< with the unit, e.g. "position (m)"
  std::vector<Eigen::Vector2d> values;  ///< (metres driven, error); a gap where not finite
};

/// 8-bit BGR, one plot below the other, each from 0 to its largest value, with the median as a
/// line. Plots without a finite value stay empty.
cv::Mat RenderErrorPicture(const std::string& title, const std::vector<ErrorCurve>& curves);

}  // namespace carmap
