// A picture of how well segments are stitched, and how fast, by several ways: figures 16, 22, A.7
// and A.12 of the paper.
//
// Pure functions; 8-bit BGR.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

namespace carmap {

/// A way of stitching, and what came of each segment; nothing where it failed.
struct StitchingCurve {
  struct Point {
    double error_m = 0, ms = 0;
  };
  std::string way;
  std::vector<std::optional<Point>> points;
};

/// The error above, the time below, both by powers of ten. Each curve has a point a segment.
cv::Mat RenderStitching(const std::string& title, const std::vector<std::string>& segments,
                        const std::vector<StitchingCurve>& curves);

}  // namespace carmap
