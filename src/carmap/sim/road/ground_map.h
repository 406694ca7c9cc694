// The ground of the simulated world: its height everywhere, and what covers it.
//
// Made of the centre lines of all roads, each place of the ground knowing the nearest: so crossings
// and roads driven twice are consistent whatever path the world was made along. Immutable,
// thread-safe.
#pragma once

#include <Eigen/Core>

#include "carmap/sim/mesh/mesh.h"

namespace carmap {

/// What covers a spot of the ground, mixed over the spot's extent.
struct GroundCover {
  Pattern pattern = Pattern::kGrass;  ///< of most of it
  float albedo = 0.3f;                ///< mean, markings included
  float contrast = 1;                 ///< of the pattern
  SemanticClass label = SemanticClass::kTerrain;
};

/// Sidewalks are raised by a kerb above GroundMap's height.
constexpr double kSidewalkHeightM = 0.12;

class GroundMap {
 public:
  virtual ~GroundMap() = default;

  /// Metres above the origin of `enu`; smooth, no kerbs.
  virtual double HeightAt(const Eigen::Vector2d& p_in_enu) const = 0;

  /// `footprint_m` is the extent of the spot (a pixel's on the ground, its longer axis and its
  /// direction): edges and markings narrower than that blend.
  virtual GroundCover CoverAt(const Eigen::Vector2f& p_in_enu,
                              const Eigen::Vector2f& footprint_m) const = 0;

  /// Distance to the nearest carriageway's edge, negative on it; large where there is none near.
  virtual double CarriagewayDistance(const Eigen::Vector2d& p_in_enu) const = 0;
};

}  // namespace carmap
