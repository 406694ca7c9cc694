// A frame's features by the size of what they show, for matching them where the pose is unknown.
//
// The stereo pair tells how far away a corner is and the pyramid level how large it looks: so how
// large it is, from wherever it is seen. A landmark is compared only with features of its own size.
// Immutable once built, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

struct SizeMatchOptions {
  double max_level_difference = 2;  ///< between the sizes, in levels of the pyramid
  int max_distance_bits = 40;       ///< of the signatures
  double max_ratio = 0.9;           ///< to the second best feature, elsewhere in the image
};

class SizedFeatures {
 public:
  /// Features without a disparity are left out.
  SizedFeatures(const std::vector<Feature>& features, const StereoRig& rig);

  /// Landmarks matched with features anywhere in the image. A feature goes to the landmark that
  /// resembles it most. Adds the number of signatures compared to `comparisons`.
  std::vector<LandmarkMatch> Match(const MapSnapshot& map, std::span<const uint32_t> landmark_idxs,
                                   const SizeMatchOptions& options, size_t& comparisons) const;

 private:
  struct BestFeature;
  BestFeature FindBest(const SnapshotLandmark& landmark, const SizeMatchOptions& options,
                       size_t& comparisons) const;
  bool AreTwins(size_t a, size_t b) const;

  // Ascending by size.
  std::vector<float> levels_at_1m_;  ///< as SnapshotLandmark::level_at_1m
  std::vector<Descriptor> descriptors_;
  std::vector<uint32_t> feature_idxs_;
  std::vector<Eigen::Vector2f> positions_px_;
  std::vector<float> twin_radii_px_;  ///< within which another feature shows the same corner
};

}  // namespace carmap
