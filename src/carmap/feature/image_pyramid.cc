#include "carmap/feature/image_pyramid.h"

#include <opencv2/imgproc.hpp>

namespace carmap {

ImagePyramid BuildPyramid(const cv::Mat& image) {
  ImagePyramid pyramid;
  pyramid[0] = image;
  for (int level = 1; level < kLevelCount; ++level) {
    // Given the factor rather than the size, the scale is exact whatever the rounding of the size.
    cv::resize(pyramid[level - 1], pyramid[level], {}, 1 / kLevelScale, 1 / kLevelScale,
               cv::INTER_LINEAR);
  }
  return pyramid;
}

}  // namespace carmap
