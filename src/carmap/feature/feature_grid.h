// Features of one frame, found by place.
//
// Immutable once built; refers to the features, which must outlive it. Time to build and to visit a
// place is bounded whatever the features: a cell lists kMaxFeaturesOfCell.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

/// A cell of 16×16 pixels lists the first so many of its features. No image tried has more than 42,
/// but those of a crafted map may all lie at one pixel.
inline constexpr uint32_t kMaxFeaturesOfCell = 128;

class FeatureGrid {
 public:
  FeatureGrid(const std::vector<Feature>& features, int width_px, int height_px);

  const std::vector<Feature>& features() const { return *features_; }
  /// The features of cell c are feature_idxs()[cell_begins()[c] .. cell_begins()[c + 1]).
  const std::vector<uint32_t>& cell_begins() const { return cell_begin_; }
  const std::vector<uint32_t>& feature_idxs() const { return feature_idxs_; }

  /// Calls `visit(feature_idx)` for each feature within the square of this half side around (x, y).
  template <typename Visit>
  void VisitNear(double x_px, double y_px, double radius_px, Visit&& visit) const {
    const int column_first = Column(x_px - radius_px), column_last = Column(x_px + radius_px);
    const int row_first = Row(y_px - radius_px), row_last = Row(y_px + radius_px);
    for (int row = row_first; row <= row_last; ++row) {
      // Cells of a row stand side by side, so their features do too.
      const uint32_t begin = cell_begin_[row * columns_ + column_first];
      const uint32_t end = cell_begin_[row * columns_ + column_last + 1];
      for (uint32_t i = begin; i < end; ++i) {
        const Feature& feature = (*features_)[feature_idxs_[i]];
        if (std::abs(feature.x_px - x_px) <= radius_px &&
            std::abs(feature.y_px - y_px) <= radius_px) {
          visit(feature_idxs_[i]);
        }
      }
    }
  }

 private:
  int Column(double x_px) const {
    return static_cast<int>(std::clamp<double>(x_px * cells_per_px_, 0, columns_ - 1));
  }
  int Row(double y_px) const {
    return static_cast<int>(std::clamp<double>(y_px * cells_per_px_, 0, rows_ - 1));
  }

  const std::vector<Feature>* features_;
  int columns_, rows_;
  double cells_per_px_;
  std::vector<uint32_t> cell_begin_;  ///< one more than cells: where each cell's features begin
  std::vector<uint32_t> feature_idxs_;
};

}  // namespace carmap
