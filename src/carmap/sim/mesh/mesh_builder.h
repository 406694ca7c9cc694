// Puts a mesh together from boxes, prisms, tubes and the like.
//
// Shapes are given in the builder's local frame, metres; `SetFrame` says where that lies in the
// model. All turn their outsides outwards and get uv in metres: u to the right and v upwards seen
// from outside, so that lettering reads. Triangles without area are left out. A builder belongs to
// one thread.
#pragma once

#include <absl/functional/function_ref.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/base/random.h"
#include "carmap/sim/mesh/mesh.h"

namespace carmap {

using SurfaceIdx = uint16_t;
inline constexpr SurfaceIdx kNoSurface = 0xffff;  ///< in place of a surface: leave this part out

/// Points in order round a shape, or along a path.
using Points3 = std::vector<Eigen::Vector3f>;

/// An opening in a wall, metres from the wall's lower left corner seen from outside.
struct WallOpening {
  float left_m = 0, bottom_m = 0, width_m = 0, height_m = 0;
};

class MeshBuilder {
 public:
  /// The number of the surface; equal ones share it.
  SurfaceIdx Use(const Surface& surface);

  /// Where what is added next lies. It may scale and mirror; uv are taken before that.
  void SetFrame(const Eigen::Affine3f& model_from_local);
  const Eigen::Affine3f& frame() const { return model_from_local_; }

  uint32_t AddVertex(const Eigen::Vector3f& p_in_local, const Eigen::Vector2f& uv_m);
  /// Counter-clockwise seen from outside.
  void AddTriangle(uint32_t a, uint32_t b, uint32_t c, SurfaceIdx surface);

  /// Lower left, lower right, upper right, upper left corner seen from outside; flat or nearly.
  void Quad(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
            const Eigen::Vector3f& d, SurfaceIdx surface,
            const Eigen::Vector2f& uv_at_a = Eigen::Vector2f::Zero());

  /// Any flat polygon without holes, counter-clockwise seen from outside, convex or not. The lower
  /// left corner of its bounding rectangle has uv (0, 0).
  void Polygon(const Points3& corners, SurfaceIdx surface);

  /// Along the axes. A box that stands on something needs no bottom.
  void Box(const Eigen::Vector3f& min, const Eigen::Vector3f& max, SurfaceIdx surface,
           bool bottom = true);

  /// A flat polygon (any direction round) moved by `along`, closed at both ends by `caps`.
  void Prism(const Points3& polygon, const Eigen::Vector3f& along, SurfaceIdx sides,
             SurfaceIdx caps);

  /// Skin over rings of equally many points. Rings run counter-clockwise seen from where the last
  /// ring lies; `closed` joins each ring's last point to its first. `surface_of(ring, side)` is
  /// asked for the cell between rings `ring` and `ring + 1`, points `side` and `side + 1`. An open
  /// one is a grid: u along the rings, v from ring to ring.
  void Loft(const std::vector<Points3>& rings, bool closed,
            absl::FunctionRef<SurfaceIdx(size_t ring, size_t side)> surface_of);
  void Loft(const std::vector<Points3>& rings, bool closed, SurfaceIdx surface);

  /// Round a path of two points or more, with a radius at each; `closed` puts ends on.
  void Tube(const Points3& path, const std::vector<float>& radii_m, int sides, SurfaceIdx surface,
            bool closed = true);
  void Cylinder(const Eigen::Vector3f& from, const Eigen::Vector3f& to, float radius_m, int sides,
                SurfaceIdx surface, bool closed = true);

  /// Turned about the local z axis: points (radius, z), upwards along the outside.
  void Lathe(const std::vector<Eigen::Vector2f>& profile, int sides, SurfaceIdx surface);

  void Ellipsoid(const Eigen::Vector3f& centre, const Eigen::Vector3f& radii_m, int sides,
                 int rings, SurfaceIdx surface);

  /// A leaf of about `leaf_m` that grows from `stem`, more or less in the direction `out`: an
  /// uneven kite, folded along its middle.
  void Leaf(const Eigen::Vector3f& stem, const Eigen::Vector3f& out, float leaf_m,
            SurfaceIdx surface, HashSequence& random);
  /// Leaves of about `leaf_m`, turned at random, in and near the surface of an ellipsoid.
  void LeafCluster(const Eigen::Vector3f& centre, const Eigen::Vector3f& radii_m, int leaves,
                   float leaf_m, SurfaceIdx surface, HashSequence& random);

  /// An upright wall over the line from `a` to `b` (left to right seen from outside) with
  /// openings, which do not overlap. Their sides reach `reveal_m` inwards, where a window's pane
  /// is put: in the rectangles of `openings`, that far behind the wall.
  void Wall(const Eigen::Vector3f& a, const Eigen::Vector3f& b, float height_m,
            const std::vector<WallOpening>& openings, float reveal_m, SurfaceIdx wall,
            SurfaceIdx reveal, const Eigen::Vector2f& uv_at_a = Eigen::Vector2f::Zero());

  /// Another mesh, as a part of this one.
  void Add(const Mesh& part, const Eigen::Affine3f& local_from_part);

  Mesh Build() && { return std::move(mesh_); }
  const Mesh& mesh() const { return mesh_; }

 private:
  Mesh mesh_;
  Eigen::Affine3f model_from_local_ = Eigen::Affine3f::Identity();
  bool mirrored_ = false;
};

/// A frame moved to `origin`, then turned: first about z (to the left), then about its own y (nose
/// down), then about its own x (right side down).
Eigen::Affine3f FrameAt(const Eigen::Vector3f& origin, float yaw_rad = 0, float pitch_rad = 0,
                        float roll_rad = 0);

/// Regular polygon round `centre`, counter-clockwise seen from the tip of `normal`, with an edge on
/// its right.
Points3 Circle(const Eigen::Vector3f& centre, const Eigen::Vector3f& normal, float radius_m,
               int corners);

/// Of all vertices that triangles use; empty for a mesh without any.
Eigen::AlignedBox3f BoundsOf(const Mesh& mesh);

}  // namespace carmap
