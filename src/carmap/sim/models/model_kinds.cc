#include "carmap/sim/models/model_kinds.h"

#include <cmath>

namespace carmap {

using Eigen::Vector3f;

void AddPlate(MeshBuilder& builder, const Points3& outline, float border_share, SurfaceIdx face,
              SurfaceIdx border, SurfaceIdx back) {
  Vector3f centre = Vector3f::Zero();
  for (const Vector3f& p : outline) centre += p / static_cast<float>(outline.size());
  Points3 inner = outline, behind(outline.rbegin(), outline.rend());
  for (Vector3f& p : inner) p += border_share * (centre - p);
  if (border_share > 0) builder.Loft({outline, inner}, /*closed=*/true, border);
  builder.Polygon(inner, face);
  const Vector3f normal = (outline[1] - outline[0]).cross(outline[2] - outline[1]).normalized();
  for (Vector3f& p : behind) p -= 0.004f * normal;
  builder.Polygon(behind, back);
}

void AddBoard(MeshBuilder& builder, const Vector3f& centre, float width_m, float height_m,
              float thickness_m, float frame_m, SurfaceIdx face, SurfaceIdx rest) {
  const auto corners = [&](float x, float border) -> Points3 {
    const float y = width_m / 2 - border, z = height_m / 2 - border;
    return {centre + Vector3f(x, y, -z), centre + Vector3f(x, -y, -z), centre + Vector3f(x, -y, z),
            centre + Vector3f(x, y, z)};
  };
  const float half = thickness_m / 2;
  const Points3 front = corners(-half, 0), inner = corners(-half, frame_m);
  const Points3 back = corners(half, 0);
  if (frame_m > 0) builder.Loft({front, inner}, /*closed=*/true, rest);
  builder.Quad(inner[0], inner[1], inner[2], inner[3], face);
  builder.Loft({back, front}, /*closed=*/true, rest);
  builder.Quad(back[1], back[0], back[3], back[2], rest);
}

void AddBar(MeshBuilder& builder, const Vector3f& from, const Vector3f& to, float width_m,
            float height_m, SurfaceIdx surface) {
  const Vector3f direction = (to - from).normalized();
  const Vector3f up = std::abs(direction.z()) < 0.99f ? Vector3f::UnitZ() : Vector3f::UnitX();
  const Vector3f side = up.cross(direction).normalized() * width_m / 2;
  const Vector3f rise = direction.cross(side).normalized() * height_m / 2;
  builder.Prism({from - side - rise, from + side - rise, from + side + rise, from - side + rise},
                to - from, surface, surface);
}

void AddPost(MeshBuilder& builder, float x, float y, float height_m, float radius_m,
             SurfaceIdx surface, int sides) {
  builder.Cylinder({x, y, -kFootingM}, {x, y, height_m}, radius_m, sides, surface);
}

}  // namespace carmap
