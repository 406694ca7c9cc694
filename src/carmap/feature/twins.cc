#include "carmap/feature/twins.h"

#include <algorithm>

#include "carmap/feature/feature_grid.h"

namespace carmap {

void LinkTwins(const PinholeCamera& camera, std::vector<Feature>& features) {
  const FeatureGrid grid(features, camera.width, camera.height);
  const auto count = static_cast<uint32_t>(std::min<size_t>(features.size(), Feature::kNoTwin));
  for (uint32_t i = 0; i < count; ++i) {
    Feature& feature = features[i];
    int fewest_bits = kMaxTwinBits + 1;
    grid.VisitNear(feature.x_px, feature.y_px, TwinRadiusPx(feature.level),
                   [&](uint32_t other_idx) {
                     const Feature& other = features[other_idx];
                     if (other.level >= feature.level) return;
                     const int bits = HammingDistance(feature.descriptor, other.descriptor);
                     if (bits >= fewest_bits) return;
                     fewest_bits = bits;
                     feature.twin_idx = static_cast<uint16_t>(CornerOf(features, other_idx));
                   });
  }
}

}  // namespace carmap
