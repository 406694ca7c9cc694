#include "carmap/feature/stereo_matcher.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "carmap/feature/feature_grid.h"
#include "carmap/feature/patch_alignment.h"
#include "carmap/feature/patch_search.h"

namespace carmap {
namespace {

float FindDisparity(const Feature& feature, const ImagePyramid& left, const ImagePyramid& right,
                    const StereoRig& rig, const StereoOptions& options,
                    std::vector<uint16_t>& scratch) {
  const double scale = ScaleOfLevel(feature.level);
  const cv::Mat& left_image = left[feature.level];
  const cv::Mat& right_image = right[feature.level];
  const int x = static_cast<int>(std::lround(LevelFromFullSize(feature.x_px, scale)));
  const int y = static_cast<int>(std::lround(LevelFromFullSize(feature.y_px, scale)));
  const double max_disparity = rig.DisparityAt(options.min_depth_m) / scale;
  const int x_first = std::max(kSearchRadius + 1, static_cast<int>(x - max_disparity));
  const int x_last = std::min(x + 1, right_image.cols - kAlignmentRightPx - 1);
  if (!CanAlign(left_image, x, y) || x_last < x_first) return Feature::kNoDisparity;

  const std::optional<int> best =
      FindAlongRow(left_image, x, y, right_image, x_first, x_last, options.search, scratch);
  if (!best) return Feature::kNoDisparity;
  const auto place =
      AlignPatch(left_image, x, y, right_image, {*best, y}, options.max_row_offset_px);
  if (!place) return Feature::kNoDisparity;
  const double disparity = (x - place->x()) * scale;
  return disparity >= options.min_disparity_px ? static_cast<float>(disparity)
                                               : Feature::kNoDisparity;
}

/// Whether the patch of a feature with depth holds one of quite another depth.
bool IsAtEdge(const Feature& feature, const FeatureGrid& grid, const StereoOptions& options) {
  const double scale = ScaleOfLevel(feature.level);
  const double max_difference_px =
      std::max(options.max_edge_ratio * feature.disparity_px, options.max_edge_px * scale);
  bool is_at_edge = false;
  grid.VisitNear(feature.x_px, feature.y_px, options.edge_radius_px * scale, [&](uint32_t idx) {
    const Feature& other = grid.features()[idx];
    is_at_edge |= other.has_disparity() &&
                  std::abs(other.disparity_px - feature.disparity_px) > max_difference_px;
  });
  return is_at_edge;
}

/// A patch that shows what is nearer or farther too measures something between.
void ForgetDepthsAtEdges(const cv::Size& size, const StereoOptions& options,
                         std::vector<Feature>& features) {
  const FeatureGrid grid(features, size.width, size.height);
  std::vector<uint32_t> at_edge;
  size_t clear = 0;
  for (uint32_t i = 0; i < features.size(); ++i) {
    if (!features[i].has_disparity()) continue;
    if (IsAtEdge(features[i], grid, options)) {
      at_edge.push_back(i);
    } else {
      ++clear;
    }
  }
  if (clear < options.min_depths) return;
  for (const uint32_t i : at_edge) features[i].disparity_px = Feature::kNoDisparity;
}

}  // namespace

void MatchStereo(const ImagePyramid& left, const ImagePyramid& right, const StereoRig& rig,
                 const StereoOptions& options, std::vector<Feature>& features) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, features.size(), 64), [&](const auto& range) {
    std::vector<uint16_t> scratch;
    for (size_t i = range.begin(); i != range.end(); ++i) {
      features[i].disparity_px = FindDisparity(features[i], left, right, rig, options, scratch);
    }
  });
  ForgetDepthsAtEdges(left[0].size(), options, features);
}

}  // namespace carmap
