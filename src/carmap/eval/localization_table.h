// Scores of localization as Markdown tables and as JSON.
//
// Pure functions.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "carmap/eval/localization_score.h"

namespace carmap {

/// Cells of one size of image and one method of matching, with what they reach together.
struct ScoredGroup {
  int width_px = 0, height_px = 0;
  std::string method;
  std::vector<ScoredCell> cells;
  LocalizationScore all;  ///< of all drives after their first seconds
};

/// Ascending by size and method.
std::vector<ScoredGroup> ScoreGroups(const std::vector<LocalizationReport>& reports);

/// The cell with the lowest share, or the highest error; null where no cell figures it.
const ScoredCell* WorstCell(const ScoredGroup& group, LocalizationFigure figure);

/// Of each group a table of its cells, one of what the worst cell and all together reach, and one
/// of the first seconds. For each size with several methods, one that compares them.
std::string ToMarkdown(const std::vector<ScoredGroup>& groups);

/// [{size method all: {…} cells: [{scene … first_second: {…} …}]}]; a figure is {value low high},
/// null where it could not be taken.
nlohmann::ordered_json ToJson(const std::vector<ScoredGroup>& groups);

}  // namespace carmap
