// Triangles and what they are made of: the shapes of the simulated world.
//
// A model stands in its own frame: x forward, y left, z up, metres, the origin on the ground below
// its middle. Plain values.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "carmap/dataset/semantic_class.h"

namespace carmap {

/// Grain and figure of a material. Each is drawn by sim/render/texture at all scales.
enum class Pattern : uint8_t {
  kPlain,     ///< painted, nearly even
  kAsphalt,   ///< grains, patches, cracks
  kPaving,    ///< slabs with joints
  kCobbles,   ///< small stones
  kConcrete,  ///< cast: stains, seams
  kGrass,
  kSoil,
  kGravel,
  kBrick,
  kPlaster,  ///< rendered walls: stains, fine grain
  kStone,    ///< ashlar
  kRoofTiles,
  kWood,  ///< planks with grain
  kBark,
  kLeaves,  ///< on leaf clusters and hedges: strong, blotchy
  kMetal,   ///< brushed or weathered
  kCarPaint,
  kGlass,  ///< dark, smooth; what it shows is mirrored
  kRubber,
  kFabric,  ///< clothes, awnings, tarpaulins
  kSkin,
  kSign,     ///< strokes and glyphs on an even ground, another at each texture seed
  kPoster,   ///< large mottled shapes and lettering: billboards, shop windows
  kCurtain,  ///< what is behind a house's window
  kGround,   ///< of the ground mesh: looked up in the world's GroundMap
};

struct Surface {
  Pattern pattern = Pattern::kPlain;
  float albedo = 0.5f;  ///< mean share of light thrown back, 0..1
  float contrast = 1;   ///< of the pattern; 1 is its usual strength
  float gloss = 0;      ///< share of the mirrored surroundings in what is seen, 0..1
  SemanticClass label = SemanticClass::kUnlabelled;
};

struct Mesh {
  std::vector<Eigen::Vector3f> vertices;           ///< metres, in the model's frame
  std::vector<Eigen::Vector2f> uv_m;               ///< by vertex: metres along the surface
  std::vector<std::array<uint32_t, 3>> triangles;  ///< counter-clockwise seen from outside
  std::vector<uint16_t> surface_of_triangle;       ///< into `surfaces`
  std::vector<Surface> surfaces;
};

}  // namespace carmap
