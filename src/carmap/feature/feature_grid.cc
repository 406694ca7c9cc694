#include "carmap/feature/feature_grid.h"

namespace carmap {

FeatureGrid::FeatureGrid(const std::vector<Feature>& features, int width_px, int height_px)
    : features_(&features), columns_(width_px / kCellPx + 1), rows_(height_px / kCellPx + 1) {
  cell_begin_.assign(static_cast<size_t>(columns_) * rows_ + 1, 0);
  const auto cell_of = [&](const Feature& feature) {
    return Row(feature.y_px) * columns_ + Column(feature.x_px);
  };
  for (const Feature& feature : features) ++cell_begin_[cell_of(feature) + 1];
  for (size_t cell = 1; cell < cell_begin_.size(); ++cell)
    cell_begin_[cell] += cell_begin_[cell - 1];
  feature_idxs_.resize(features.size());
  std::vector<uint32_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  for (uint32_t i = 0; i < features.size(); ++i) feature_idxs_[next[cell_of(features[i])]++] = i;
}

}  // namespace carmap
