// Depth of the left image's features from the right image of a rectified pair.
#pragma once

#include <cstddef>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/image_pyramid.h"
#include "carmap/feature/patch_search.h"
#include "carmap/geometry/camera.h"

namespace carmap {

struct StereoOptions {
  double min_depth_m = 1.8;       ///< nearer points are not looked for
  double min_disparity_px = 0.4;  ///< smaller ones say too little of the depth
  PatchSearchOptions search;
  double max_row_offset_px = 1.2;  ///< at the feature's level, after refinement
  /// Features so near, at the feature's level, that are so much nearer or farther, as a part of its
  /// disparity and in pixels of its level, show that it lies at the edge of a thing.
  double edge_radius_px = 6, max_edge_ratio = 0.08, max_edge_px = 0.6;
  size_t min_depths = 500;  ///< where fewer would be left, those at edges keep theirs
};

/// Sets the disparity of each feature that has one clear match. A patch around it is looked for
/// along its row of the right image, at its own level and in whole pixels, then refined to
/// sub-pixel by Gauss-Newton on both axes (Lucas and Kanade 1981), so that rows a little apart do
/// not bend depths. Features at the edges of things, whose patches show two depths, get none,
/// unless too few are left.
void MatchStereo(const ImagePyramid& left, const ImagePyramid& right, const StereoRig& rig,
                 const StereoOptions& options, std::vector<Feature>& features);

}  // namespace carmap
