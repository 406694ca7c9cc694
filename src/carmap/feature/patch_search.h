// Where along a row of one image the surroundings of a pixel of another are found again.
//
// Pure function; counts in whole numbers, so every processor finds the same.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace carmap {

constexpr int kSearchRadius = 5;  ///< pixels around the middle of a patch, 11 x 11 in all

struct PatchSearchOptions {
  int max_mean_difference = 25;  ///< of the patches' grey values at the best place
  double uniqueness = 1.2;       ///< any place 3 px or more from it must be worse by this factor
};

/// Column of [x_first, x_last] around which row y of `right` resembles most what lies around (x, y)
/// of `left`, by the sum of absolute differences of grey values; nothing if it resembles too
/// little, or if another place is almost as good.
/// Both images: CV_8UC1. All patches must lie inside, and leave a row below; in an image of fewer
/// than 32 columns nothing is found. `scratch` is working memory, kept for the next call.
std::optional<int> FindAlongRow(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                int x_first, int x_last, const PatchSearchOptions& options,
                                std::vector<uint16_t>& scratch);

}  // namespace carmap
