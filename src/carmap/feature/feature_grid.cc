#include "carmap/feature/feature_grid.h"

#include <numeric>

namespace carmap {

namespace {

/// Cells of 16 pixels; larger ones in images of more than four million pixels, so that a grid is
/// small whatever the image.
int CellSizeFor(int width_px, int height_px) {
  constexpr int64_t kMaxCells = 1 << 14;
  int cell_px = 16;
  while (int64_t{width_px / cell_px + 1} * (height_px / cell_px + 1) > kMaxCells) cell_px *= 2;
  return cell_px;
}

}  // namespace

FeatureGrid::FeatureGrid(const std::vector<Feature>& features, int width_px, int height_px)
    : features_(&features) {
  const int cell_px = CellSizeFor(width_px, height_px);
  columns_ = width_px / cell_px + 1;
  rows_ = height_px / cell_px + 1;
  cells_per_px_ = 1.0 / cell_px;
  cell_begin_.assign(static_cast<size_t>(columns_) * rows_ + 1, 0);
  const auto cell_of = [&](const Feature& feature) {
    return Row(feature.y_px) * columns_ + Column(feature.x_px);
  };
  for (const Feature& feature : features) {
    uint32_t& count = cell_begin_[cell_of(feature) + 1];
    count = std::min(count + 1, kMaxFeaturesOfCell);
  }
  std::partial_sum(cell_begin_.begin(), cell_begin_.end(), cell_begin_.begin());
  feature_idxs_.resize(cell_begin_.back());
  std::vector<uint32_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  for (uint32_t i = 0; i < features.size(); ++i) {
    const int cell = cell_of(features[i]);
    if (next[cell] < cell_begin_[cell + 1]) feature_idxs_[next[cell]++] = i;
  }
}

}  // namespace carmap
