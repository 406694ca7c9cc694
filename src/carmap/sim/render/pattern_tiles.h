// The pictures that materials are papered with: square, tiling, grey.
//
// Pure functions; drawn once by texture.h.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "carmap/sim/mesh/mesh.h"

namespace carmap {

inline constexpr int kTileSize = 512;  ///< texels along each side

/// Brightness relative to the material's mean, CV_32F, 1 on average, within 0..2. `variant` gives
/// another picture of the same material.
cv::Mat DrawPatternTile(Pattern pattern, uint32_t variant);

/// What varies over metres, laid over the tiles of all materials so that they do not look repeated.
enum class MacroTile : uint8_t {
  kStains,   ///< clouds of all sizes
  kStreaks,  ///< ... drawn out downwards, as water leaves them on walls
  kRoad,     ///< patches, tar seams, cracks
  kClouds,   ///< of the sky: smooth
};
cv::Mat DrawMacroTile(MacroTile kind);

}  // namespace carmap
