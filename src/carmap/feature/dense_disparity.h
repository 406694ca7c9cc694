// A disparity for nearly every place of an image: what stands before what.
//
// Semi-global matching (Hirschmüller 2008, OpenCV's) at a fraction of the image's size. Coarse: to
// tell whether something hides a landmark, not to measure. Immutable, thread-safe.
#pragma once

#include <opencv2/core/mat.hpp>

#include "carmap/geometry/camera.h"

namespace carmap {

class DenseDisparity {
 public:
  /// Images: CV_8UC1 of the rig's size, rectified.
  DenseDisparity(const cv::Mat& left, const cv::Mat& right, const StereoRig& rig);

  /// What the image shows around a place.
  struct Around {
    double known_share = 0;   ///< of the window, that has a disparity ...
    double nearer_share = 0;  ///< ... and that is nearer than was asked for
  };
  /// Of the pixels within `radius_px` of (u, v), those with a disparity above `disparity_px`, all
  /// in the rig's pixels.
  Around LookAt(double u_px, double v_px, double radius_px, double disparity_px) const;

 private:
  int shrinking_ = 1;
  cv::Mat disparity_;  ///< CV_16SC1, in 16ths of a pixel of its own; below 0: unknown
};

}  // namespace carmap
