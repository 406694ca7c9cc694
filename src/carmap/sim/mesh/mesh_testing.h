// What the tests ask of meshes.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "carmap/sim/mesh/mesh.h"

namespace carmap {

/// Empty, or what is wrong with the mesh's numbers.
inline std::string FaultOf(const Mesh& mesh) {
  if (mesh.triangles.empty()) return "no triangles";
  if (mesh.uv_m.size() != mesh.vertices.size()) return "vertices without uv";
  if (mesh.surface_of_triangle.size() != mesh.triangles.size()) return "triangles without surface";
  for (const auto& p : mesh.vertices) {
    if (!p.allFinite()) return "vertex not finite";
  }
  for (const auto& uv : mesh.uv_m) {
    if (!uv.allFinite()) return "uv not finite";
  }
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t i : triangle) {
      if (i >= mesh.vertices.size()) return "triangle beyond the vertices";
    }
  }
  for (const uint16_t surface : mesh.surface_of_triangle) {
    if (surface >= mesh.surfaces.size()) return "triangle beyond the surfaces";
  }
  for (const Surface& s : mesh.surfaces) {
    if (!(s.albedo > 0 && s.albedo < 1)) return "albedo not within 0..1";
    if (!(s.gloss >= 0 && s.gloss <= 1)) return "gloss not within 0..1";
  }
  return "";
}

/// What the triangles enclose; negative where they are inside out. Of a closed mesh only.
inline double VolumeOf(const Mesh& mesh) {
  double volume = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    volume += mesh.vertices[a].cross(mesh.vertices[b]).dot(mesh.vertices[c]) / 6;
  }
  return volume;
}

inline double AreaOf(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    area += (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]).norm();
  }
  return area / 2;
}

/// Whether each edge is passed as often one way as the other, vertices within 0.1 mm being one.
inline bool IsClosed(const Mesh& mesh) {
  using Key = std::tuple<int64_t, int64_t, int64_t>;
  const auto key = [&](uint32_t i) {
    const Eigen::Vector3f p = mesh.vertices[i] * 1e4f;
    return Key(std::lround(p.x()), std::lround(p.y()), std::lround(p.z()));
  };
  std::map<std::pair<Key, Key>, int> passes;
  for (const auto& triangle : mesh.triangles) {
    for (size_t k = 0; k < 3; ++k) {
      const Key from = key(triangle[k]), to = key(triangle[(k + 1) % 3]);
      ++passes[{from, to}];
      --passes[{to, from}];
    }
  }
  for (const auto& [edge, balance] : passes) {
    if (balance != 0) return false;
  }
  return true;
}

inline bool SameBytes(const Mesh& a, const Mesh& b) {
  return a.vertices == b.vertices && a.uv_m == b.uv_m && a.triangles == b.triangles &&
         a.surface_of_triangle == b.surface_of_triangle;
}

}  // namespace carmap
