// Pictures of how well drives are localized, like figures 12 to 15 and A.8 to A.11 of the paper.
//
// Pure functions; 8-bit BGR.
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "carmap/eval/localization_table.h"

namespace carmap {

/// What share of the frames after the first seconds is known within an error, each panel one scene,
/// traffic of the map and traffic of the drive, each curve one lane (the map's own or another) of
/// one method. Reports of one size; the curves of lost frames end below 1.
cv::Mat RenderErrorDistributions(const std::string& title,
                                 const std::vector<LocalizationReport>& reports);

/// For each cell the share well known and the median error, a bar for each method, with intervals.
/// Groups of one size.
cv::Mat RenderCellBars(const std::string& title, const std::vector<ScoredGroup>& groups);

}  // namespace carmap
