// Histograms of two series of samples over each other, a panel for each thing measured.
//
// Pure functions.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace carmap {

struct HistogramPanel {
  std::string name;  ///< with the unit
  std::vector<double> first, second;
};

/// 8-bit BGR, four panels a row. `first_name` and `second_name` stand in the legend, in the colours
/// kEstimateColour and kTruthColour. Each histogram has the same area; medians are marked. A panel
/// spans 99 % of either series; one without samples stays empty.
cv::Mat RenderHistograms(const std::string& title, const std::string& first_name,
                         const std::string& second_name, const std::vector<HistogramPanel>& panels);

}  // namespace carmap
