// A picture of what segmenters told of one frame, beside what is true.
//
// Pure functions.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace carmap {

struct SegmentationPicture {
  struct Told {
    std::string segmenter;
    cv::Mat mobility;  ///< as Segmenter::Segment, any size
  };
  std::string title;
  cv::Mat image;  ///< 8-bit grey
  cv::Mat truth;  ///< mobility of each pixel, of the image's size
  std::vector<Told> told;
};

/// 8-bit BGR: the image once for each segmenter, over it in blue what is non-static and was found,
/// in red what was missed, in orange what is static and was called non-static.
cv::Mat RenderSegmentationPicture(const SegmentationPicture& picture);

}  // namespace carmap
