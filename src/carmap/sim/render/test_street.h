// A short street to render in tests: flat ground with a marked road, houses, trees, cars.
#pragma once

#include <cmath>
#include <memory>

#include "carmap/sim/mesh/mesh_builder.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/town/world.h"

namespace carmap {

/// Level at z = 0; a road of 8 m along the x axis with a line along its middle.
class FlatGround : public GroundMap {
 public:
  double HeightAt(const Eigen::Vector2d&) const override { return 0; }
  GroundCover CoverAt(const Eigen::Vector2f& p, const Eigen::Vector2f& footprint) const override {
    const float y = std::abs(p.y());
    if (y < 4) {
      const float blur = std::max(0.01f, std::abs(footprint.y()));
      const float painted = std::clamp((0.06f - y) / blur + 0.5f, 0.f, 1.f);
      return {Pattern::kAsphalt, 0.14f + 0.4f * painted, 1, SemanticClass::kRoad};
    }
    if (y < 6) return {Pattern::kPaving, 0.28f, 1, SemanticClass::kSidewalk};
    return {Pattern::kGrass, 0.12f, 1, SemanticClass::kTerrain};
  }
  double CarriagewayDistance(const Eigen::Vector2d& p) const override {
    return std::abs(p.y()) - 4;
  }
};

inline Mesh GroundMesh(float half_m) {
  MeshBuilder builder;
  const auto ground = builder.Use({.pattern = Pattern::kGround});
  builder.Quad({-half_m, -half_m, 0}, {half_m, -half_m, 0}, {half_m, half_m, 0},
               {-half_m, half_m, 0}, ground);
  return std::move(builder).Build();
}

inline Mesh BoxMesh(const Eigen::Vector3f& size_m, const Surface& surface) {
  MeshBuilder builder;
  const Eigen::Vector3f half(size_m.x() / 2, size_m.y() / 2, 0);
  builder.Box(-half, half + Eigen::Vector3f(0, 0, size_m.z()), builder.Use(surface));
  return std::move(builder).Build();
}

inline Mesh HouseMesh(const Surface& wall) {
  MeshBuilder builder;
  const auto front = builder.Use(wall);
  const auto glass = builder.Use({Pattern::kCurtain, 0.12f, 1, 0.3f, SemanticClass::kBuilding});
  const auto roof = builder.Use({Pattern::kRoofTiles, 0.15f, 1, 0, SemanticClass::kBuilding});
  std::vector<WallOpening> windows;
  for (float floor = 0; floor < 2; ++floor) {
    for (float i = 0; i < 4; ++i) windows.push_back({0.9f + 2.4f * i, 1 + 3 * floor, 1.2f, 1.5f});
  }
  builder.Wall({-5, -4, 0}, {5, -4, 0}, 6.4f, windows, 0.15f, front, front);
  for (const WallOpening& w : windows) {
    builder.Quad({w.left_m - 5, -3.85f, w.bottom_m}, {w.left_m + w.width_m - 5, -3.85f, w.bottom_m},
                 {w.left_m + w.width_m - 5, -3.85f, w.bottom_m + w.height_m},
                 {w.left_m - 5, -3.85f, w.bottom_m + w.height_m}, glass);
  }
  builder.Wall({5, -4, 0}, {5, 4, 0}, 6.4f, {}, 0.15f, front, front);
  builder.Wall({5, 4, 0}, {-5, 4, 0}, 6.4f, {}, 0.15f, front, front);
  builder.Wall({-5, 4, 0}, {-5, -4, 0}, 6.4f, {}, 0.15f, front, front);
  builder.Prism({{-5, -4.5f, 6.2f}, {-5, 4.5f, 6.2f}, {-5, 0, 9.5f}}, {10, 0, 0}, roof, front);
  return std::move(builder).Build();
}

inline Mesh TreeMesh(int leaves) {
  MeshBuilder builder;
  const auto bark = builder.Use({Pattern::kBark, 0.15f, 1, 0, SemanticClass::kVegetation});
  const auto leaf = builder.Use({Pattern::kLeaves, 0.12f, 1, 0, SemanticClass::kVegetation});
  HashSequence random(5);
  builder.Tube({{0, 0, 0}, {0.1f, 0, 2}, {0, 0.1f, 4.5f}}, {0.16f, 0.13f, 0.05f}, 8, bark);
  for (int i = 0; i < 10; ++i) {
    const Eigen::Vector3f centre(static_cast<float>(random.Between(-1.4, 1.4)),
                                 static_cast<float>(random.Between(-1.4, 1.4)),
                                 static_cast<float>(random.Between(2.6, 5.5)));
    builder.LeafCluster(centre, {0.8f, 0.8f, 0.7f}, leaves / 10, 0.16f, leaf, random);
  }
  return std::move(builder).Build();
}

inline Mesh CarMesh() {
  MeshBuilder builder;
  const auto paint = builder.Use({Pattern::kCarPaint, 0.15f, 1, 0.15f, SemanticClass::kCar});
  const auto glass = builder.Use({Pattern::kGlass, 0.03f, 1, 0.3f, SemanticClass::kCar});
  const auto rubber = builder.Use({Pattern::kRubber, 0.04f, 1, 0, SemanticClass::kCar});
  builder.Box({-2.1f, -0.85f, 0.3f}, {2.1f, 0.85f, 0.9f}, paint);
  builder.Prism(
      {{-1.9f, -0.75f, 0.9f}, {1.1f, -0.75f, 0.9f}, {0.4f, -0.75f, 1.45f}, {-1.5f, -0.75f, 1.45f}},
      {0, 1.5f, 0}, glass, glass);
  for (const float x : {-1.3f, 1.3f}) {
    for (const float y : {-0.8f, 0.8f}) {
      builder.Cylinder({x, y - 0.1f, 0.32f}, {x, y + 0.1f, 0.32f}, 0.32f, 14, rubber);
    }
  }
  return std::move(builder).Build();
}

/// Houses, trees and hedges on both sides of the x axis from -20 to `length_m`; model 0 is the
/// ground, the last one a car.
inline std::shared_ptr<World> TestStreet(float length_m) {
  auto world = std::make_shared<World>();
  world->ground = std::make_shared<FlatGround>();
  world->models.push_back(GroundMesh(1000));
  world->models.push_back(HouseMesh({Pattern::kPlaster, 0.6f, 1, 0, SemanticClass::kBuilding}));
  world->models.push_back(HouseMesh({Pattern::kBrick, 0.25f, 1, 0, SemanticClass::kBuilding}));
  world->models.push_back(TreeMesh(2500));
  world->models.push_back(
      BoxMesh({6, 0.6f, 1.1f}, {Pattern::kLeaves, 0.1f, 1, 0, SemanticClass::kVegetation}));
  world->models.push_back(CarMesh());
  world->tiles.push_back({.model_idx = 0});
  HashSequence random(9);
  const auto place = [&](uint32_t model, double x, double y, double heading) {
    world->objects.push_back({"thing",
                              {.model_idx = model,
                               .position_in_enu = {x, y, 0},
                               .heading_rad = static_cast<float>(heading),
                               .shade = static_cast<float>(random.Between(0.7, 1.2)),
                               .texture_seed = random.Below(1000000)}});
  };
  for (double x = -20; x < length_m; x += 14) {
    for (const double side : {-1., 1.}) {
      place(1 + random.Below(2), x, side * 15, side > 0 ? 0 : M_PI);
      place(3, x + random.Between(2, 8), side * 7.5, random.Between(0, 6));
      place(4, x + 6, side * 6.6, 0);
      if (random.Chance(0.6)) place(5, x + random.Between(0, 6), side * 3, side > 0 ? M_PI : 0);
    }
  }
  return world;
}

}  // namespace carmap
