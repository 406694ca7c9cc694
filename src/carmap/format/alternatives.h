// The paper's alternatives to the lean map (§5.4, Figure 18), for comparison of sizes.
//
// A complete map has four parts (§3.1): (A) map-features, (B) keyframe features, (C) the
// map-feature index and (D) the feature index. Each alternative is really serialised, plainly:
// fixed-width fields, 4-byte floats, no padding, no compression. Only `lean` is what EncodeLeanMap
// writes.
//
//   keyframes             index 4, time 8, quaternion 16, translation 12, GPS flag 1 and fix 24
//   A  a landmark         index 4, position 12, descriptor 16, level 1
//   B  a feature          u v disparity 12, level 1, descriptor 16; 4 for the count of each
//   keyframe C  a landmark         4 for the count, and 8 for each keyframe that sees it and its
//   feature there
//      a feature          4 for the landmark that it is, or none
//   D  search structures  4 for each number of the tables below, and 4 for the length of each
//
//   full                  keyframes + A + B + C + D
//   no_index              keyframes + A + B + the landmarks' half of C, without which A and B would
//   not
//                         belong together; the features' half and D follow from it
//   no_keyframe_features  keyframes + A + C + D, made before the features were removed: without the
//                         features' half of C, which becomes each keyframe's list of its landmarks,
//                         and without the feature grids of D, which would point to nothing
//   lean                  landmarks alone, as carmap writes them
//
// Pure functions.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// Features of a keyframe by image cell: those of cell c are
/// feature_idxs[cell_begins[c] .. cell_begins[c + 1]).
struct PlainFeatureGrid {
  std::vector<uint32_t> cell_begins, feature_idxs;
};

/// A k-d tree in whatever layout: its whole numbers (children, axes, points) and its splits.
struct PlainKdTree {
  std::vector<uint32_t> links;
  std::vector<float> splits;
};

/// Two keyframes (dense indices) and how many landmarks both see.
struct PlainCovisibility {
  uint32_t a = 0, b = 0, weight = 0;
};

/// A complete map and everything that is derived from it.
struct PlainMapContents {
  const LeanMap* lean = nullptr;                                               ///< never null
  std::vector<std::shared_ptr<const std::vector<Feature>>> keyframe_features;  ///< one a keyframe
  /// One list a landmark: which feature it is in each keyframe of its keyframe_idxs.
  std::vector<std::vector<uint32_t>> observed_feature_idxs;
  std::vector<PlainFeatureGrid> feature_grids;  ///< one a keyframe, or none at all
  PlainKdTree keyframe_tree, landmark_tree;
  std::vector<PlainCovisibility> covisibility;
};

struct CompositionBytes {
  uint64_t full = 0, no_index = 0, no_keyframe_features = 0, lean = 0;
};

/// Serialises all four. Errors: as EncodeLeanMap; InvalidArgument for parts that do not fit
/// together.
absl::StatusOr<CompositionBytes> MeasureComposition(const PlainMapContents& map);

}  // namespace carmap
