// ORB features (Rublee et al. 2011), upright: FAST corners over an image pyramid, spread evenly,
// with binary descriptors.
//
// Cars do not roll, so descriptors are not turned by the patch's orientation
// (docs/decisions/0002-upright-descriptors.md).
#pragma once

#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/image_pyramid.h"

namespace carmap {

struct OrbOptions {
  int feature_count = 1600;       ///< at most, over all levels
  int corner_threshold = 20;      ///< least contrast of a corner, grey values
  int weak_corner_threshold = 7;  ///< the same, on levels with too few strong corners
};

/// For one image at a time; its working memory is kept for the next.
class OrbExtractor {
 public:
  explicit OrbExtractor(const OrbOptions& options = {}) : options_(options) {}

  /// Features in the order of their levels. They have no disparity yet.
  std::vector<Feature> Extract(const ImagePyramid& pyramid);

 private:
  const OrbOptions options_;
  ImagePyramid smooth_;
};

}  // namespace carmap
