#include "carmap/sim/mesh/mesh_builder.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr float kMinAreaM2 = 1e-9f;

auto Fields(const Surface& s) {
  return std::make_tuple(s.pattern, s.albedo, s.contrast, s.gloss, s.label);
}

/// Twice the area, in the direction of the outside.
Vector3f AreaVector(const Points3& polygon) {
  Vector3f sum = Vector3f::Zero();
  for (size_t i = 1; i + 1 < polygon.size(); ++i) {
    sum += (polygon[i] - polygon[0]).cross(polygon[i + 1] - polygon[0]);
  }
  return sum;
}

/// Axes to the right and upwards in the plane, seen from outside.
std::pair<Vector3f, Vector3f> PlaneAxes(const Vector3f& normal) {
  const Vector3f up = std::abs(normal.z()) < 0.9f ? Vector3f::UnitZ() : Vector3f::UnitY();
  const Vector3f right = up.cross(normal).normalized();
  return {right, normal.cross(right)};
}

float Cross(const Vector2f& a, const Vector2f& b) { return a.x() * b.y() - a.y() * b.x(); }

bool Inside(const Vector2f& p, const Vector2f& a, const Vector2f& b, const Vector2f& c) {
  return Cross(b - a, p - a) >= 0 && Cross(c - b, p - b) >= 0 && Cross(a - c, p - c) >= 0;
}

/// Whether the triangle about corner `i` of those `left` may be cut off (Meisters 1975).
bool IsEar(const std::vector<Vector2f>& corners, const std::vector<size_t>& left, size_t i) {
  const size_t before = left[(i + left.size() - 1) % left.size()];
  const size_t after = left[(i + 1) % left.size()];
  const Vector2f &a = corners[before], &b = corners[left[i]], &c = corners[after];
  if (Cross(b - a, c - b) <= 0) return false;
  return std::none_of(left.begin(), left.end(), [&](size_t k) {
    return k != before && k != left[i] && k != after && Inside(corners[k], a, b, c);
  });
}

std::vector<std::array<size_t, 3>> Triangulate(const std::vector<Vector2f>& corners) {
  std::vector<std::array<size_t, 3>> triangles;
  std::vector<size_t> left;
  for (size_t i = 0; i < corners.size(); ++i) left.push_back(i);
  while (left.size() >= 3) {
    size_t ear = 0;
    while (ear < left.size() && !IsEar(corners, left, ear)) ++ear;
    // Only corners in line with their neighbours are left: any may go.
    if (ear == left.size()) ear = 0;
    triangles.push_back(
        {left[(ear + left.size() - 1) % left.size()], left[ear], left[(ear + 1) % left.size()]});
    left.erase(left.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  return triangles;
}

/// At each point of a path: square to its direction there, turning no more than the path does.
std::vector<Vector3f> SidewaysAlong(const Points3& path) {
  std::vector<Vector3f> sideways;
  Vector3f side = Vector3f::Zero();
  for (size_t i = 0; i < path.size(); ++i) {
    const Vector3f direction =
        (path[std::min(i + 1, path.size() - 1)] - path[i > 0 ? i - 1 : 0]).normalized();
    if (i == 0) side = PlaneAxes(direction).first;
    side = (side - direction * direction.dot(side)).normalized();
    sideways.push_back(side);
  }
  return sideways;
}

/// Where openings begin and end, upwards, and the ends of the wall; equal ones once.
std::vector<float> LevelsOf(const std::vector<WallOpening>& openings, float height_m) {
  std::vector<float> levels = {0, height_m};
  for (const WallOpening& o : openings) {
    levels.insert(levels.end(), {o.bottom_m, o.bottom_m + o.height_m});
  }
  std::sort(levels.begin(), levels.end());
  const auto equal = [](float a, float b) { return std::abs(a - b) < 1e-4f; };
  levels.erase(std::unique(levels.begin(), levels.end(), equal), levels.end());
  return levels;
}

Vector3f RandomDirection(HashSequence& random) {
  const double angle = random.Between(0, 2 * M_PI), z = random.Between(-1, 1);
  const double radius = std::sqrt(1 - z * z);
  return Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), z).cast<float>();
}

}  // namespace

SurfaceIdx MeshBuilder::Use(const Surface& surface) {
  const auto found =
      std::find_if(mesh_.surfaces.begin(), mesh_.surfaces.end(),
                   [&](const Surface& known) { return Fields(known) == Fields(surface); });
  const auto idx = static_cast<SurfaceIdx>(found - mesh_.surfaces.begin());
  if (found == mesh_.surfaces.end()) mesh_.surfaces.push_back(surface);
  return idx;
}

void MeshBuilder::SetFrame(const Eigen::Affine3f& model_from_local) {
  model_from_local_ = model_from_local;
  mirrored_ = model_from_local.linear().determinant() < 0;
}

uint32_t MeshBuilder::AddVertex(const Vector3f& p_in_local, const Vector2f& uv_m) {
  mesh_.vertices.push_back(model_from_local_ * p_in_local);
  mesh_.uv_m.push_back(uv_m);
  return static_cast<uint32_t>(mesh_.vertices.size() - 1);
}

void MeshBuilder::AddTriangle(uint32_t a, uint32_t b, uint32_t c, SurfaceIdx surface) {
  const Vector3f& origin = mesh_.vertices[a];
  const float area = (mesh_.vertices[b] - origin).cross(mesh_.vertices[c] - origin).norm() / 2;
  if (surface == kNoSurface || area < kMinAreaM2) return;
  if (mirrored_) std::swap(b, c);
  mesh_.triangles.push_back({a, b, c});
  mesh_.surface_of_triangle.push_back(surface);
}

void MeshBuilder::Quad(const Vector3f& a, const Vector3f& b, const Vector3f& c, const Vector3f& d,
                       SurfaceIdx surface, const Vector2f& uv_at_a) {
  const Vector3f right = (b - a).squaredNorm() > 0 ? (b - a).normalized() : (c - d).normalized();
  const Vector3f up = AreaVector({a, b, c, d}).cross(right).normalized();
  const auto add = [&](const Vector3f& p) {
    return AddVertex(p, uv_at_a + Vector2f(right.dot(p - a), up.dot(p - a)));
  };
  const uint32_t i = add(a);
  for (const Vector3f& p : {b, c, d}) add(p);
  AddTriangle(i, i + 1, i + 2, surface);
  AddTriangle(i, i + 2, i + 3, surface);
}

void MeshBuilder::Polygon(const Points3& corners, SurfaceIdx surface) {
  const auto [right, up] = PlaneAxes(AreaVector(corners).normalized());
  std::vector<Vector2f> flat;
  Vector2f low = Vector2f::Constant(INFINITY);
  for (const Vector3f& p : corners) {
    flat.emplace_back(right.dot(p), up.dot(p));
    low = low.cwiseMin(flat.back());
  }
  const auto first = static_cast<uint32_t>(mesh_.vertices.size());
  for (size_t i = 0; i < corners.size(); ++i) AddVertex(corners[i], flat[i] - low);
  for (const auto& [a, b, c] : Triangulate(flat)) {
    AddTriangle(first + static_cast<uint32_t>(a), first + static_cast<uint32_t>(b),
                first + static_cast<uint32_t>(c), surface);
  }
}

void MeshBuilder::Box(const Vector3f& min, const Vector3f& max, SurfaceIdx surface, bool bottom) {
  const auto corner = [&](int x, int y, int z) {
    return Vector3f(x ? max.x() : min.x(), y ? max.y() : min.y(), z ? max.z() : min.z());
  };
  const auto upright = [&](int ax, int ay, int bx, int by) {
    Quad(corner(ax, ay, 0), corner(bx, by, 0), corner(bx, by, 1), corner(ax, ay, 1), surface);
  };
  upright(0, 0, 1, 0);
  upright(1, 0, 1, 1);
  upright(1, 1, 0, 1);
  upright(0, 1, 0, 0);
  Quad(corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1), surface);
  if (bottom) {
    Quad(corner(0, 1, 0), corner(1, 1, 0), corner(1, 0, 0), corner(0, 0, 0), surface);
  }
}

void MeshBuilder::Prism(const Points3& polygon, const Vector3f& along, SurfaceIdx sides,
                        SurfaceIdx caps) {
  Points3 base = polygon;
  if (AreaVector(base).dot(along) < 0) std::reverse(base.begin(), base.end());
  Points3 end;
  for (const Vector3f& p : base) end.push_back(p + along);
  for (size_t i = 0; i < base.size(); ++i) {
    const size_t next = (i + 1) % base.size();
    Quad(base[i], base[next], end[next], end[i], sides);
  }
  if (caps == kNoSurface) return;
  Polygon(end, caps);
  std::reverse(base.begin(), base.end());
  Polygon(base, caps);
}

void MeshBuilder::Loft(const std::vector<Points3>& rings, bool closed,
                       absl::FunctionRef<SurfaceIdx(size_t, size_t)> surface_of) {
  const size_t points = rings.front().size(), sides = closed ? points : points - 1;
  const auto first = static_cast<uint32_t>(mesh_.vertices.size());
  float v = 0;
  for (size_t r = 0; r < rings.size(); ++r) {
    if (r > 0) {
      float sum = 0;
      for (size_t i = 0; i < points; ++i) sum += (rings[r][i] - rings[r - 1][i]).norm();
      v += sum / static_cast<float>(points);
    }
    float u = 0;
    for (size_t i = 0; i <= sides; ++i) {
      if (i > 0) u += (rings[r][i % points] - rings[r][i - 1]).norm();
      AddVertex(rings[r][i % points], {u, v});
    }
  }
  const auto at = [&](size_t r, size_t i) {
    return first + static_cast<uint32_t>(r * (sides + 1) + i);
  };
  for (size_t r = 0; r + 1 < rings.size(); ++r) {
    for (size_t i = 0; i < sides; ++i) {
      const SurfaceIdx surface = surface_of(r, i);
      AddTriangle(at(r, i), at(r, i + 1), at(r + 1, i + 1), surface);
      AddTriangle(at(r, i), at(r + 1, i + 1), at(r + 1, i), surface);
    }
  }
}

void MeshBuilder::Loft(const std::vector<Points3>& rings, bool closed, SurfaceIdx surface) {
  Loft(rings, closed, [surface](size_t, size_t) { return surface; });
}

void MeshBuilder::Tube(const Points3& path, const std::vector<float>& radii_m, int sides,
                       SurfaceIdx surface, bool closed) {
  const std::vector<Vector3f> sideways = SidewaysAlong(path);
  std::vector<Points3> rings;
  for (size_t i = 0; i < path.size(); ++i) {
    const Vector3f direction =
        (path[std::min(i + 1, path.size() - 1)] - path[i > 0 ? i - 1 : 0]).normalized();
    const Vector3f other = direction.cross(sideways[i]);
    Points3& ring = rings.emplace_back();
    for (int k = 0; k < sides; ++k) {
      const float angle = 2 * static_cast<float>(M_PI * k / sides);
      ring.push_back(path[i] +
                     radii_m[i] * (std::cos(angle) * sideways[i] + std::sin(angle) * other));
    }
  }
  Loft(rings, /*closed=*/true, surface);
  if (!closed) return;
  if (radii_m.back() > 0) Polygon(rings.back(), surface);
  std::reverse(rings.front().begin(), rings.front().end());
  if (radii_m.front() > 0) Polygon(rings.front(), surface);
}

void MeshBuilder::Cylinder(const Vector3f& from, const Vector3f& to, float radius_m, int sides,
                           SurfaceIdx surface, bool closed) {
  Tube({from, to}, {radius_m, radius_m}, sides, surface, closed);
}

void MeshBuilder::Lathe(const std::vector<Vector2f>& profile, int sides, SurfaceIdx surface) {
  std::vector<Points3> rings;
  for (const Vector2f& p : profile) {
    rings.push_back(Circle({0, 0, p.y()}, Vector3f::UnitZ(), p.x(), sides));
  }
  Loft(rings, /*closed=*/true, surface);
}

void MeshBuilder::Ellipsoid(const Vector3f& centre, const Vector3f& radii_m, int sides, int rings,
                            SurfaceIdx surface) {
  std::vector<Points3> loft;
  for (int i = 0; i <= rings; ++i) {
    const float latitude = static_cast<float>(M_PI) * (static_cast<float>(i) / rings - 0.5f);
    const float radius = i == 0 || i == rings ? 0 : std::cos(latitude);
    Points3& ring =
        loft.emplace_back(Circle({0, 0, std::sin(latitude)}, Vector3f::UnitZ(), radius, sides));
    for (Vector3f& p : ring) p = centre + radii_m.cwiseProduct(p);
  }
  Loft(loft, /*closed=*/true, surface);
}

void MeshBuilder::Leaf(const Vector3f& stem, const Vector3f& out, float leaf_m, SurfaceIdx surface,
                       HashSequence& random) {
  const auto between = [&](double low, double high) {
    return static_cast<float>(random.Between(low, high));
  };
  const Vector3f along = (RandomDirection(random) + 0.7f * out).normalized();
  const Vector3f across = along.cross(RandomDirection(random)).normalized();
  const float length = leaf_m * between(0.6, 1.4);
  const Vector3f fold = length * between(-0.25, 0.25) * along.cross(across);
  const auto edge = [&](float side) -> Vector3f {
    return stem + length * (between(0.25, 0.75) * along + side * between(0.25, 0.6) * across) +
           fold;
  };
  const Vector3f right = edge(-1), left = edge(1);
  Quad(stem, right, stem + length * along, left, surface, {between(0, 10), between(0, 10)});
}

void MeshBuilder::LeafCluster(const Vector3f& centre, const Vector3f& radii_m, int leaves,
                              float leaf_m, SurfaceIdx surface, HashSequence& random) {
  for (int i = 0; i < leaves; ++i) {
    const Vector3f out = RandomDirection(random);
    // More of them near the surface: the inside of a crown is bare.
    const float depth = 1 - 0.6f * static_cast<float>(random.Unit() * random.Unit());
    Leaf(centre + depth * radii_m.cwiseProduct(out), out, leaf_m, surface, random);
  }
}

void MeshBuilder::Wall(const Vector3f& a, const Vector3f& b, float height_m,
                       const std::vector<WallOpening>& openings, float reveal_m, SurfaceIdx wall,
                       SurfaceIdx reveal, const Vector2f& uv_at_a) {
  const float width_m = (b - a).norm();
  const Vector3f right = (b - a) / width_m, up = Vector3f::UnitZ();
  const Vector3f inwards = reveal_m * up.cross(right);
  const auto at = [&](float u, float v) -> Vector3f { return a + u * right + v * up; };

  const std::vector<float> levels = LevelsOf(openings, height_m);
  for (size_t i = 0; i + 1 < levels.size(); ++i) {
    const float low = levels[i], high = levels[i + 1], middle = (low + high) / 2;
    std::vector<std::pair<float, float>> holes;
    for (const WallOpening& o : openings) {
      if (o.bottom_m < middle && middle < o.bottom_m + o.height_m) {
        holes.emplace_back(o.left_m, o.left_m + o.width_m);
      }
    }
    std::sort(holes.begin(), holes.end());
    holes.emplace_back(width_m, width_m);
    float from = 0;
    for (const auto& [hole_from, hole_to] : holes) {
      if (hole_from > from) {
        Quad(at(from, low), at(hole_from, low), at(hole_from, high), at(from, high), wall,
             uv_at_a + Vector2f(from, low));
      }
      from = hole_to;
    }
  }
  for (const WallOpening& o : openings) {
    const std::array<Vector3f, 4> corners = {
        at(o.left_m, o.bottom_m), at(o.left_m + o.width_m, o.bottom_m),
        at(o.left_m + o.width_m, o.bottom_m + o.height_m), at(o.left_m, o.bottom_m + o.height_m)};
    for (size_t k = 0; k < 4; ++k) {
      const Vector3f &from = corners[k], &to = corners[(k + 1) % 4];
      Quad(from, to, to + inwards, from + inwards, reveal);
    }
  }
}

void MeshBuilder::Add(const Mesh& part, const Eigen::Affine3f& local_from_part) {
  const Eigen::Affine3f model_from_local = model_from_local_;
  SetFrame(model_from_local * local_from_part);
  std::vector<SurfaceIdx> surfaces;
  for (const Surface& surface : part.surfaces) surfaces.push_back(Use(surface));
  const auto first = static_cast<uint32_t>(mesh_.vertices.size());
  for (size_t i = 0; i < part.vertices.size(); ++i) AddVertex(part.vertices[i], part.uv_m[i]);
  for (size_t i = 0; i < part.triangles.size(); ++i) {
    const auto& [a, b, c] = part.triangles[i];
    AddTriangle(first + a, first + b, first + c, surfaces[part.surface_of_triangle[i]]);
  }
  SetFrame(model_from_local);
}

Eigen::Affine3f FrameAt(const Vector3f& origin, float yaw_rad, float pitch_rad, float roll_rad) {
  return Eigen::Translation3f(origin) * Eigen::AngleAxisf(yaw_rad, Vector3f::UnitZ()) *
         Eigen::AngleAxisf(pitch_rad, Vector3f::UnitY()) *
         Eigen::AngleAxisf(roll_rad, Vector3f::UnitX());
}

Points3 Circle(const Vector3f& centre, const Vector3f& normal, float radius_m, int corners) {
  const auto [right, up] = PlaneAxes(normal.normalized());
  Points3 points;
  for (int i = 0; i < corners; ++i) {
    const float angle = 2 * static_cast<float>(M_PI) * (static_cast<float>(i) + 0.5f) / corners;
    points.push_back(centre + radius_m * (std::cos(angle) * right + std::sin(angle) * up));
  }
  return points;
}

Eigen::AlignedBox3f BoundsOf(const Mesh& mesh) {
  Eigen::AlignedBox3f bounds;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t i : triangle) bounds.extend(mesh.vertices[i]);
  }
  return bounds;
}

}  // namespace carmap
