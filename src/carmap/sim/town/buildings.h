// Houses and façades.
//
// A building's frame: the origin on the ground below the middle of its front, x to the right seen
// from the street, y away from it, z up. Pure functions of what is drawn from the sequence.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "carmap/base/random.h"
#include "carmap/sim/mesh/mesh_builder.h"

namespace carmap {

enum class RoofKind : uint8_t { kGableAlong, kGableAcross, kHip, kFlat };

/// A house with a garden round it.
struct HouseSpec {
  float width_m = 10, depth_m = 9;
  int floors = 1;  ///< below the roof
  RoofKind roof = RoofKind::kGableAlong;
  bool garage = false;  ///< beside it, on the right
  /// Windows, reveals and what else is small; without for houses that stand far away.
  bool detailed = true;
};
HouseSpec DrawHouse(HashSequence& draw);
/// Of its bounding box, roof overhang and garage included, to the left and right of the origin.
float HouseLeft(const HouseSpec& spec);
float HouseRight(const HouseSpec& spec);
void AddHouse(const HouseSpec& spec, const Eigen::Affine3f& frame, HashSequence& draw,
              MeshBuilder& builder);

/// A building in a closed row of them.
struct FacadeSpec {
  float width_m = 13, depth_m = 11;
  int floors = 4;  ///< with the ground floor
  bool shop = true;
  bool left_open = false, right_open = false;  ///< sides without a neighbour have windows
};
FacadeSpec DrawFacade(HashSequence& draw);
void AddFacade(const FacadeSpec& spec, const Eigen::Affine3f& frame, HashSequence& draw,
               MeshBuilder& builder);

/// An opening of a wall with what is in it.
struct WindowSpec {
  WallOpening opening;
  enum class Kind : uint8_t { kWindow, kDoor, kShop, kGarage } kind = Kind::kWindow;
};

/// What windows are made of, the same all over a building.
struct WindowStyle {
  SurfaceIdx frame, glass, curtain, blind, poster, sill, door;
  float frame_m = 0.07f;     ///< width of a casement's frame
  float reveal_m = 0.15f;    ///< how deep it lies in the wall
  bool shutters = false;     ///< boards to the left and right
  bool crossed = false;      ///< a bar across, too
  float blind_share = 0.2f;  ///< windows whose blind is down in part
};

/// A wall along x from the frame's origin, seen from -y, with windows and what belongs to them.
void AddWall(const Eigen::Affine3f& frame, float length_m, float height_m,
             const std::vector<WindowSpec>& windows, const WindowStyle& style, SurfaceIdx wall,
             SurfaceIdx reveal, HashSequence& draw, MeshBuilder& builder);

/// A flat slab with this top side (counter-clockwise seen from above), its underside below it.
void AddSlab(const Points3& top, float thickness_m, SurfaceIdx top_surface, SurfaceIdx edge_surface,
             MeshBuilder& builder);

}  // namespace carmap
