// What tells static from non-static pixels of a camera image (§3.3): a network, or the truth of a
// simulated drive.
//
// One thread at a time calls Segment, which may be another one than made the segmenter.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <opencv2/core/mat.hpp>

namespace carmap {

struct SegmenterInput {
  uint32_t frame_index = 0;  ///< frame number in the drive
  const cv::Mat& image;      ///< left, 8-bit grey, as the camera gave it
};

class Segmenter {
 public:
  virtual ~Segmenter() = default;

  /// Mobility of each pixel, CV_8UC1, at the segmenter's own resolution: it shows the whole image,
  /// in any number of columns and rows. Errors are of this image alone and name their cause; the
  /// next may be tried.
  virtual absl::StatusOr<cv::Mat> Segment(const SegmenterInput& input) = 0;
};

}  // namespace carmap
