// Finds keyframes of a map segment in a base map of which nothing but a fix is known (paper §3.4,
// Algorithm A.1, FindOverlap).
//
// Deterministic. Not thread-safe: a locator remembers its index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/appearance_localizer.h"
#include "carmap/localize/place_search.h"

namespace carmap {

struct LocatorOptions {
  PlaceSearchOptions place_search;
  size_t view_neighbours = 16;  ///< keyframes that show what a keyframe is looked for by (ViewFrom)
  size_t min_inliers = 12;      ///< of a keyframe that is found
  /// Of a keyframe that fits several places: the inliers of one that counts, as a part of those of
  /// the best.
  double min_rival_share = 0.5;
  /// The baseline: keyframes are found by appearance alone (AppearanceLocalizer).
  bool by_appearance = false;
};

/// A keyframe of the segment and a place of the base map where it fits.
struct LocatedKeyframe {
  uint32_t keyframe_idx = 0;
  size_t inliers = 0;
  Rigid3 base_from_camera;
  bool is_near_fix = false;  ///< where the keyframe's GPS fix says
};

class KeyframeLocator {
 public:
  /// Both maps must outlive the locator; the base is rebuilt for the segment's focal length.
  KeyframeLocator(const ReconstructedMap& base, const ReconstructedMap& segment,
                  const LocatorOptions& options);

  /// Whether the base has keyframes where the keyframe's fix says; false where one has no fixes.
  bool IsNearBase(uint32_t keyframe_idx) const;

  /// All places that explain the keyframe about as well as the best, which comes first: façades
  /// repeat.
  std::vector<LocatedKeyframe> Locate(uint32_t keyframe_idx);

 private:
  const ReconstructedMap &base_, &segment_;
  const LocatorOptions options_;
  PlaceSearch search_;
  std::optional<AppearanceLocalizer> by_appearance_;
};

}  // namespace carmap
