// FAST-9 corners (Rosten and Drummond 2006) with their exact scores.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace carmap {

struct Corner {
  int16_t x = 0, y = 0;  ///< pixels of the image searched
  uint8_t score = 0;     ///< least contrast to the centre along the best arc of nine pixels
};

/// Corners with score >= threshold that no neighbour of the 3×3 pixels around exceeds, at least
/// `margin` (>= 4) pixels from the image's edges, row by row.
std::vector<Corner> DetectCorners(const cv::Mat& image, int threshold, int margin);

}  // namespace carmap
