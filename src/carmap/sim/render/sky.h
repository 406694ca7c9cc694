// The sky over the simulated world, infinitely far: what is seen above the roofs and in mirrors.
//
// Directions are in `enu`. Immutable, thread-safe.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "carmap/sim/render/light.h"

namespace carmap {

class Sky {
 public:
  explicit Sky(const Light& light);

  /// Radiance from a direction of unit length; `pixel_rad` is the angle that it stands for.
  float Radiance(const Eigen::Vector3f& direction, float pixel_rad) const;
  /// As it is mirrored: with the glare of the sun.
  float Mirrored(const Eigen::Vector3f& direction) const;
  /// What distant things fade to.
  float haze() const { return haze_; }
  /// Light thrown back by sunny ground.
  float ground() const { return ground_; }

 private:
  float Dome(const Eigen::Vector3f& direction) const;

  Light light_;
  Eigen::Vector3f to_sun_;
  float scale_ = 1, haze_ = 0, ground_ = 0;
  float cloud_share_ = 0, cloud_u_ = 0, cloud_v_ = 0;
  cv::Mat clouds_;              ///< CV_32F, tiling
  std::vector<float> skyline_;  ///< sine of the elevation of distant hills and woods, by azimuth
};

}  // namespace carmap
