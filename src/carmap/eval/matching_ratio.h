// How many of the landmarks that a frame truly shows are matched (paper figure 21), by position
// (§3.2) and by appearance, in the same map.
//
// Immutable, thread-safe; map and vocabulary must outlive it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/appearance_localizer.h"

namespace carmap {

struct MatchingOptions {
  double true_match_px = 3;  ///< a match is right if its feature is so near the landmark's place
  double same_disparity_px = 2;  ///< a feature shows the landmark if its disparity is so near too
  /// What a prediction of the pose is off by: standard deviations an axis.
  double prediction_m = 0.05, prediction_rad = 0.002;
};

/// Of one frame.
struct MatchingCounts {
  size_t in_sight = 0;  ///< landmarks that the frame truly shows: a feature is where each must be
  size_t by_position = 0, by_appearance = 0;  ///< of these, those matched with a feature there
};

class MatchingMeter {
 public:
  MatchingMeter(const ReconstructedMap& map, const StereoRig& rig, const Vocabulary& vocabulary,
                const MatchingOptions& options = {});

  /// By position the frame is tracked as by the localizer, from a pose near the true one; by
  /// appearance all landmarks of the keyframes that resemble it by words are compared with all its
  /// features. `seed` draws the prediction's error.
  MatchingCounts Measure(const std::vector<Feature>& features, const Rigid3& true_camera_from_map,
                         uint64_t seed) const;

 private:
  const ReconstructedMap& map_;
  const StereoRig rig_;
  const MatchingOptions options_;
  const AppearanceLocalizer by_appearance_;
};

}  // namespace carmap
