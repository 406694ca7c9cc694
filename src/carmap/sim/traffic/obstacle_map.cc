#include "carmap/sim/traffic/obstacle_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2f>;

constexpr float kLowestM = 0.3f, kHighestM = 1.8f;

/// Points of the triangle at these heights, `step_m` apart.
void SampleTriangle(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
                    float step_m, Points& points) {
  const auto [low, high] = std::minmax({a.z(), b.z(), c.z()});
  if (high < kLowestM || low > kHighestM) return;
  const float longest_m = std::max({(b - a).norm(), (c - a).norm(), (c - b).norm()});
  const int steps = std::max(1, static_cast<int>(std::ceil(longest_m / step_m)));
  for (int i = 0; i <= steps; ++i) {
    for (int k = 0; i + k <= steps; ++k) {
      const float u = static_cast<float>(i) / static_cast<float>(steps);
      const float v = static_cast<float>(k) / static_cast<float>(steps);
      const Eigen::Vector3f p = a + u * (b - a) + v * (c - a);
      if (p.z() >= kLowestM && p.z() <= kHighestM) points.push_back(p.head<2>());
    }
  }
}

/// From above, each cell of a grid once.
Points FootprintOf(const Mesh& mesh, float cell_m) {
  Points points;
  for (const auto& [a, b, c] : mesh.triangles) {
    SampleTriangle(mesh.vertices[a], mesh.vertices[b], mesh.vertices[c], cell_m, points);
  }
  for (Eigen::Vector2f& p : points) p = (p.array() / cell_m).round() * cell_m;
  const auto less = [](const Eigen::Vector2f& a, const Eigen::Vector2f& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  };
  std::sort(points.begin(), points.end(), less);
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

}  // namespace

ObstacleMap::ObstacleMap(const World& world) {
  std::vector<std::optional<Points>> footprints(world.models.size());
  for (const WorldObject& object : world.objects) {
    const Placement& placement = object.placement;
    std::optional<Points>& footprint = footprints[placement.model_idx];
    if (!footprint) {
      footprint = FootprintOf(world.models[placement.model_idx], static_cast<float>(kCellM) / 2);
    }
    const Eigen::Vector2d forward(std::cos(placement.heading_rad), std::sin(placement.heading_rad));
    const Eigen::Vector2d left(-forward.y(), forward.x());
    for (const Eigen::Vector2f& p : *footprint) {
      const Eigen::Vector2d scaled = placement.scale * p.cast<double>();
      AddPoint(placement.position_in_enu.head<2>() + scaled.x() * forward + scaled.y() * left);
    }
  }
}

uint64_t ObstacleMap::KeyOf(const Eigen::Vector2d& p_in_enu) {
  const auto x = static_cast<int64_t>(std::floor(p_in_enu.x() / kCellM));
  const auto y = static_cast<int64_t>(std::floor(p_in_enu.y() / kCellM));
  return (static_cast<uint64_t>(x) << 32) ^ (static_cast<uint64_t>(y) & 0xffffffffu);
}

void ObstacleMap::AddPoint(const Eigen::Vector2d& p_in_enu) { cells_.insert(KeyOf(p_in_enu)); }

void ObstacleMap::Add(const GroundBox& box) {
  const auto along_steps = static_cast<int>(std::ceil(4 * box.half_length_m / kCellM)) + 1;
  const auto across_steps = static_cast<int>(std::ceil(4 * box.half_width_m / kCellM)) + 1;
  for (int i = 0; i <= along_steps; ++i) {
    for (int k = 0; k <= across_steps; ++k)
      AddPoint(box.At(2.0 * i / along_steps - 1, 2.0 * k / across_steps - 1));
  }
}

bool ObstacleMap::IsBlocked(const Eigen::Vector2d& p_in_enu) const {
  return cells_.contains(KeyOf(p_in_enu));
}

double ObstacleMap::FreeHalfWidth(const Eigen::Vector2d& p_in_enu, double heading_rad,
                                  double max_m) const {
  const Eigen::Vector2d left(-std::sin(heading_rad), std::cos(heading_rad));
  for (double aside = 0; aside < max_m; aside += kCellM) {
    if (IsBlocked(p_in_enu + aside * left) || IsBlocked(p_in_enu - aside * left)) return aside;
  }
  return max_m;
}

}  // namespace carmap
