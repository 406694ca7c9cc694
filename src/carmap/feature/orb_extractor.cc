#include "carmap/feature/orb_extractor.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstddef>

#include "carmap/feature/corner_detector.h"
#include "carmap/feature/signature.h"
#include "carmap/feature/smoothing.h"

namespace carmap {
namespace {

constexpr int kMargin = kSignatureRadius + 1;

/// Keeps at most `count` corners: from each cell of a grid its best, then each cell's second best,
/// and so on, so that strong texture in one place does not starve the rest of the image.
std::vector<Corner> SpreadEvenly(const std::vector<Corner>& corners, const cv::Size& size,
                                 size_t count) {
  if (corners.size() <= count) return corners;
  const double area = static_cast<double>(size.width) * size.height;
  const int cell_px = std::max(8, static_cast<int>(std::sqrt(area / static_cast<double>(count))));
  const int columns = size.width / cell_px + 1, rows = size.height / cell_px + 1;

  // Best scores first, by counting: there are many more corners than scores.
  std::array<std::vector<Corner>, 256> by_score;
  for (const Corner& corner : corners) by_score[corner.score].push_back(corner);
  std::vector<int> taken_of_cell(static_cast<size_t>(columns) * rows, 0);
  std::vector<std::vector<Corner>> by_rank;
  for (size_t score = by_score.size(); score-- > 0;) {
    for (const Corner& corner : by_score[score]) {
      const size_t rank = taken_of_cell[(corner.y / cell_px) * columns + corner.x / cell_px]++;
      if (rank >= by_rank.size()) by_rank.emplace_back();
      by_rank[rank].push_back(corner);
    }
  }
  std::vector<Corner> kept;
  for (const auto& corners_of_rank : by_rank) {
    const size_t room = std::min(count - kept.size(), corners_of_rank.size());
    kept.insert(kept.end(), corners_of_rank.begin(), corners_of_rank.begin() + room);
  }
  return kept;
}

std::vector<Feature> ExtractLevel(const cv::Mat& image, int level, size_t count,
                                  const OrbOptions& options, cv::Mat& smooth) {
  std::vector<Corner> corners = DetectCorners(image, options.corner_threshold, kMargin);
  if (corners.size() < count)
    corners = DetectCorners(image, options.weak_corner_threshold, kMargin);
  corners = SpreadEvenly(corners, image.size(), count);
  std::vector<Feature> features;
  if (corners.empty()) return features;

  SmoothImage(image, smooth);
  const SignatureSampler signatures(smooth);
  features.reserve(corners.size());
  const double scale = ScaleOfLevel(level);
  for (const Corner& corner : corners) {
    features.push_back({.x_px = static_cast<float>(FullSizeFromLevel(corner.x, scale)),
                        .y_px = static_cast<float>(FullSizeFromLevel(corner.y, scale)),
                        .level = static_cast<uint8_t>(level),
                        .descriptor = signatures.At(corner.x, corner.y)});
  }
  return features;
}

}  // namespace

std::vector<Feature> OrbExtractor::Extract(const ImagePyramid& pyramid) {
  // Each level's share falls with its side length, as the number of places for a feature along an
  // edge does.
  const double ratio = 1 / kLevelScale;
  const double first_share = (1 - ratio) / (1 - std::pow(ratio, kLevelCount));
  std::array<std::vector<Feature>, kLevelCount> by_level;
  tbb::parallel_for(0, kLevelCount, [&](int level) {
    const double share = first_share * std::pow(ratio, level);
    by_level[level] =
        ExtractLevel(pyramid[level], level, static_cast<size_t>(options_.feature_count * share),
                     options_, smooth_[level]);
  });
  std::vector<Feature> features;
  for (const auto& level_features : by_level) {
    features.insert(features.end(), level_features.begin(), level_features.end());
  }
  return features;
}

}  // namespace carmap
