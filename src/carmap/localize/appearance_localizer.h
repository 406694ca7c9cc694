// The baseline that robust matching (paper §3.2) is compared with: a frame is found in a map by
// appearance alone, as ORB-SLAM relocalizes (Mur-Artal, Montiel and Tardós 2015, §V-B; Mur-Artal
// and Tardós 2017).
//
// Neither GPS nor the pose of the frame before helps, and only one keyframe's landmarks are matched
// at a time. Immutable once built, thread-safe; the map and the vocabulary must outlive it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/camera.h"
#include "carmap/index/word_index.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

struct AppearanceLocalizerOptions {
  TrackingOptions tracking;
  size_t max_candidates = 10;   ///< keyframes that are tried
  float min_similarity = 0.6f;  ///< of a candidate, as a part of the most similar one's
  int min_inliers = 30;         ///< fewer landmarks that agree are no pose
};

class AppearanceLocalizer {
 public:
  /// Levels of the map's landmarks must hold for the focal length of the rigs that localize.
  AppearanceLocalizer(const MapSnapshot& map, const Vocabulary& vocabulary,
                      const AppearanceLocalizerOptions& options = {});

  /// Candidate keyframes by their words through the inverted index, most similar first; each one's
  /// landmarks are matched by descriptor, PnP with RANSAC gives a pose, a guided search around it
  /// more matches. The first pose with enough inliers is taken. `features` of one stereo frame,
  /// with disparities.
  std::optional<TrackedPose> Localize(const std::vector<Feature>& features,
                                      const StereoRig& rig) const;

  /// Indices of the keyframes that resemble the features by words, most similar first.
  std::vector<uint32_t> Candidates(const std::vector<Feature>& features) const;

 private:
  const MapSnapshot& map_;
  const Vocabulary& vocabulary_;
  const AppearanceLocalizerOptions options_;
  WordIndex words_;
};

}  // namespace carmap
