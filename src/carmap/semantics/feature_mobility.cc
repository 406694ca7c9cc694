#include "carmap/semantics/feature_mobility.h"

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

/// Index of the pixel, of `to` along this side, that covers a coordinate of an image with `from`.
int PixelAt(float at_px, int from, int to) {
  const double scale = static_cast<double>(from) / to;
  // The nearest centre of a pixel.
  const double px = std::floor(LevelFromFullSize(at_px, scale) + 0.5);
  return static_cast<int>(std::clamp<double>(px, 0, to - 1));
}

}  // namespace

std::vector<Mobility> MobilityOfFeatures(const std::vector<Feature>& features,
                                         cv::Size feature_image, const cv::Mat& mobility) {
  std::vector<Mobility> of_feature;
  of_feature.reserve(features.size());
  for (const Feature& feature : features) {
    const int column = PixelAt(feature.x_px, feature_image.width, mobility.cols);
    const int row = PixelAt(feature.y_px, feature_image.height, mobility.rows);
    of_feature.push_back(static_cast<Mobility>(mobility.at<uint8_t>(row, column)));
  }
  return of_feature;
}

}  // namespace carmap
