// Grain and figure of materials, averaged over what a pixel covers.
//
// Each pattern is a tiling picture with its mip maps (Williams 1983), multiplied with another that
// varies over metres. An oblique pixel takes several looks along the longer axis of its footprint.
// Immutable, thread-safe.
#pragma once

#include <cstdint>
#include <vector>

#include "carmap/sim/mesh/mesh.h"

namespace carmap {

/// Places on surfaces and how much of them a pixel covers there: a structure of arrays.
struct TextureSpots {
  /// Not a power of two, so that places in the arrays do not fall on the same lines of the cache.
  static constexpr int kCapacity = 1008;

  alignas(32) float u_m[kCapacity], v_m[kCapacity];
  alignas(32) float major_u_m[kCapacity], major_v_m[kCapacity];  ///< longer axis of the footprint
  alignas(32) float minor_m[kCapacity];                          ///< length of the shorter one
  uint32_t seed[kCapacity];
  Pattern pattern[kCapacity];
};

class Textures {
 public:
  /// Draws all pictures on the first call, in some tenths of a second.
  static const Textures& Get();

  /// Brightness relative to the pattern's mean, 1 on average, of the first `count` spots. The
  /// arrays are used up to a multiple of 8.
  void LookUp(const TextureSpots& spots, int count, float* brightness) const;

 private:
  struct Layers {
    int first_tile = 0, variants = 1;
    float tile_m = 2.56f;
    int macro_tile = 0;
    float macro_share = 1;
  };
  struct Looks;

  Textures();
  void LookUpTiles(const TextureSpots& spots, const Looks& looks, int max_looks, int count,
                   float* value) const;

  std::vector<Layers> layers_;   ///< by pattern
  std::vector<uint8_t> texels_;  ///< tile by tile, level by level
};

}  // namespace carmap
