#include "carmap/sim/mesh/mesh_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "carmap/sim/mesh/mesh_testing.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

Mesh Built(const std::function<void(MeshBuilder&, SurfaceIdx)>& add,
           const Eigen::Affine3f& frame = Eigen::Affine3f::Identity()) {
  MeshBuilder builder;
  builder.SetFrame(frame);
  add(builder, builder.Use({.pattern = Pattern::kBrick}));
  return std::move(builder).Build();
}

/// A star of five points in the plane x = 2, counter-clockwise seen from +x.
Points3 Star() {
  Points3 points;
  for (int i = 0; i < 10; ++i) {
    const float angle = 2 * static_cast<float>(M_PI) * i / 10, radius = i % 2 ? 0.4f : 1.0f;
    points.emplace_back(2, radius * std::cos(angle), radius * std::sin(angle));
  }
  return points;
}
constexpr double kStarArea = 5 * 1.0 * 0.4 * 0.5877852523;  // ten triangles, sin 36°

struct Solid {
  const char* name;
  std::function<void(MeshBuilder&, SurfaceIdx)> add;
  double volume, tolerance;
  Vector3f min, max;
};

std::vector<Solid> Solids() {
  return {
      {"box",
       [](auto& b, auto s) {
         b.Box({1, 2, 3}, {2, 4, 6}, s);
       },
       6,
       1e-5,
       {1, 2, 3},
       {2, 4, 6}},
      {"prism",
       [](auto& b, auto s) {
         b.Prism(Star(), {3, 0, 0}, s, s);
       },
       3 * kStarArea,
       1e-5,
       {2, -0.809f, -0.9511f},
       {5, 1, 0.9511f}},
      {"prism given the other way round",
       [](auto& b, auto s) {
         b.Prism(Star(), {-3, 0, 0}, s, s);
       },
       3 * kStarArea,
       1e-5,
       {-1, -0.809f, -0.9511f},
       {2, 1, 0.9511f}},
      {"cylinder",
       [](auto& b, auto s) {
         b.Cylinder({0, 0, 1}, {0, 0, 5}, 0.5, 64, s);
       },
       M_PI * 0.25 * 4,
       0.01,
       {-0.5, -0.5, 1},
       {0.5, 0.5, 5}},
      {"tube that ends in a point",
       [](auto& b, auto s) {
         b.Tube({{0, 0, 0}, {0, 0, 3}}, {1, 0}, 64, s);
       },
       M_PI,
       0.01,
       {-1, -1, 0},
       {1, 1, 3}},
      {"bent tube",
       [](auto& b, auto s) {
         b.Tube({{0, 0, 0}, {0, 0, 10}, {10, 0, 10}}, {0.1f, 0.1f, 0.1f}, 32, s);
       },
       M_PI * 0.01 * 20,
       0.1,
       {-0.1f, -0.1f, 0},
       {10, 0.1f, 10.1f}},
      {"lathe",
       [](auto& b, auto s) {
         b.Lathe({{0, 1}, {2, 1}, {2, 2}, {0, 5}}, 64, s);
       },
       4 * M_PI + 4 * M_PI,
       0.05,
       {-2, -2, 1},
       {2, 2, 5}},
      {"ellipsoid",
       [](auto& b, auto s) {
         b.Ellipsoid({1, 1, 1}, {1, 2, 3}, 64, 32, s);
       },
       4.0 / 3 * M_PI * 6,
       0.2,
       {0, -1, -2},
       {2, 3, 4}},
  };
}

TEST(MeshBuilder, SolidsAreClosedAndTurnOutwards) {
  const Eigen::Affine3f mirror(Eigen::Scaling(1.f, -1.f, 1.f));
  for (const Solid& solid : Solids()) {
    SCOPED_TRACE(solid.name);
    const Mesh mesh = Built(solid.add);
    EXPECT_EQ(FaultOf(mesh), "");
    EXPECT_TRUE(IsClosed(mesh));
    EXPECT_NEAR(VolumeOf(mesh), solid.volume, solid.tolerance);
    EXPECT_LT((BoundsOf(mesh).min() - solid.min).norm(), 0.01) << BoundsOf(mesh).min().transpose();
    EXPECT_LT((BoundsOf(mesh).max() - solid.max).norm(), 0.01) << BoundsOf(mesh).max().transpose();

    EXPECT_NEAR(VolumeOf(Built(solid.add, mirror)), solid.volume, solid.tolerance) << "mirrored";
  }
}

/// How far uv stretch the edges of triangles: 1 where they are metres along the surface.
std::pair<float, float> StretchOf(const Mesh& mesh) {
  float low = INFINITY, high = 0;
  for (const auto& triangle : mesh.triangles) {
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t a = triangle[k], b = triangle[(k + 1) % 3];
      const float stretch =
          (mesh.uv_m[a] - mesh.uv_m[b]).norm() / (mesh.vertices[a] - mesh.vertices[b]).norm();
      low = std::min(low, stretch), high = std::max(high, stretch);
    }
  }
  return {low, high};
}

TEST(MeshBuilder, UvAreMetres) {
  for (const char* exact : {"box", "prism", "cylinder"}) {
    SCOPED_TRACE(exact);
    for (const Solid& solid : Solids()) {
      if (solid.name != std::string(exact)) continue;
      const auto [low, high] = StretchOf(Built(solid.add));
      EXPECT_NEAR(low, 1, 1e-4);
      EXPECT_NEAR(high, 1, 1e-4);
    }
  }
}

TEST(MeshBuilder, LetteringReadsFromOutside) {
  // Facing -y, so that its right is +x.
  const Mesh sign = Built([](auto& b, auto s) {
    b.Quad({1, 0, 2}, {4, 0, 2}, {4, 0, 3}, {1, 0, 3}, s, {10, 20});
  });
  EXPECT_EQ(sign.triangles.size(), 2);
  EXPECT_THAT(sign.uv_m, testing::ElementsAre(Vector2f(10, 20), Vector2f(13, 20), Vector2f(13, 21),
                                              Vector2f(10, 21)));
  EXPECT_LT((sign.vertices[1] - sign.vertices[0]).cross(sign.vertices[2] - sign.vertices[0]).y(),
            0);

  const Mesh gable = Built([](auto& b, auto s) {
    b.Polygon({{4, 0, 2}, {2.5, 0, 4}, {1, 0, 2}}, s);  // in any order of starting
  });
  EXPECT_EQ(gable.uv_m[2], Vector2f(0, 0));
  EXPECT_EQ(gable.uv_m[0], Vector2f(3, 0));
  EXPECT_EQ(gable.uv_m[1], Vector2f(1.5, 2));
}

TEST(MeshBuilder, PolygonsMayBeHollow) {
  const Mesh star = Built([](auto& b, auto s) { b.Polygon(Star(), s); });
  EXPECT_EQ(star.triangles.size(), 8);
  EXPECT_NEAR(AreaOf(star), kStarArea, 1e-5) << "no part twice, none outside";
  const Mesh with_corner_in_line = Built([](auto& b, auto s) {
    b.Polygon({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, 2, 0}, {0, 2, 0}}, s);
  });
  EXPECT_NEAR(AreaOf(with_corner_in_line), 4, 1e-5);
}

TEST(MeshBuilder, LoftsLeaveCellsOut) {
  const Mesh grid = Built([](auto& b, auto s) {
    const auto surface_of = [s](size_t ring, size_t side) {
      return ring == 1 && side == 1 ? kNoSurface : s;
    };
    std::vector<Points3> rings;
    for (int y = 0; y < 4; ++y) {
      Points3& ring = rings.emplace_back();
      for (int x = 0; x < 4; ++x) ring.emplace_back(x, y, 0);
    }
    b.Loft(rings, /*closed=*/false, surface_of);
  });
  EXPECT_NEAR(AreaOf(grid), 8, 1e-5);
  for (size_t i = 0; i < grid.vertices.size(); ++i) {
    EXPECT_EQ(grid.uv_m[i], grid.vertices[i].head<2>());
  }
  for (const auto& [a, b, c] : grid.triangles) {
    const Vector3f ab = grid.vertices[b] - grid.vertices[a];
    EXPECT_GT(ab.cross(grid.vertices[c] - grid.vertices[a]).z(), 0);
  }
}

TEST(MeshBuilder, WallsHaveOpenings) {
  const std::vector<WallOpening> openings = {
      {1, 1, 1, 1.5}, {3, 1, 2, 1.5}, {1, 3.5, 1, 1}, {7, 0, 1, 2}};
  const auto add = [&](float reveal_m) {
    return Built([&](auto& b, auto s) {
      b.Wall({0, 0, 0}, {10, 0, 0}, 5, openings, reveal_m, s, s);
    });
  };
  const double wall = 50 - 1.5 - 3 - 1 - 2;
  EXPECT_NEAR(AreaOf(add(0)), wall, 1e-4);
  const double rims = 2 * (1 + 1.5) + 2 * (2 + 1.5) + 2 * 2 + 2 * (1 + 2);
  const Mesh deep = add(0.2f);
  EXPECT_NEAR(AreaOf(deep), wall + 0.2 * rims, 1e-4);
  EXPECT_NEAR(BoundsOf(deep).max().y(), 0.2, 1e-6) << "inwards is away from the viewer at -y";
  // From a point in an opening, a little inside, all of its sides are seen from their outsides.
  for (size_t i = 0; i < deep.triangles.size(); ++i) {
    const auto& [a, b, c] = deep.triangles[i];
    const Vector3f normal = (deep.vertices[b] - deep.vertices[a])
                                .cross(deep.vertices[c] - deep.vertices[a])
                                .normalized();
    const Vector3f middle = (deep.vertices[a] + deep.vertices[b] + deep.vertices[c]) / 3;
    if (middle.x() < 3 || middle.x() > 5 || middle.z() < 1 || middle.z() > 2.5) continue;
    EXPECT_GT(normal.dot(Vector3f(4, 0.1f, 1.75) - middle), 0);
  }
}

TEST(MeshBuilder, PartsBringTheirSurfaces) {
  MeshBuilder part;
  part.Box({0, 0, 0}, {1, 1, 1}, part.Use({.pattern = Pattern::kWood}));
  MeshBuilder whole;
  const SurfaceIdx glass = whole.Use({.pattern = Pattern::kGlass});
  whole.Box({0, 0, 0}, {2, 2, 2}, glass);
  whole.Add(part.mesh(), FrameAt({5, 0, 0}));
  whole.Add(part.mesh(), FrameAt({0, 5, 0}, static_cast<float>(M_PI / 2)));
  EXPECT_EQ(whole.Use({.pattern = Pattern::kGlass}), glass);
  const Mesh mesh = std::move(whole).Build();
  EXPECT_EQ(FaultOf(mesh), "");
  EXPECT_EQ(mesh.surfaces.size(), 2);
  EXPECT_NEAR(VolumeOf(mesh), 10, 1e-4);
  EXPECT_LT((BoundsOf(mesh).max() - Vector3f(6, 6, 2)).norm(), 1e-5);
  EXPECT_LT((BoundsOf(mesh).min() - Vector3f(-1, 0, 0)).norm(), 1e-5) << "turned left";
}

TEST(MeshBuilder, LeavesFollowFromTheSequence) {
  const auto cluster = [](uint64_t seed) {
    return Built([seed](auto& b, auto s) {
      HashSequence random(seed);
      b.LeafCluster({0, 0, 3}, {2, 2, 1}, 200, 0.2f, s, random);
    });
  };
  const Mesh mesh = cluster(1);
  EXPECT_EQ(FaultOf(mesh), "");
  EXPECT_LE(mesh.triangles.size(), 400);
  EXPECT_GT(mesh.triangles.size(), 380);
  EXPECT_TRUE(SameBytes(mesh, cluster(1)));
  EXPECT_FALSE(SameBytes(mesh, cluster(2)));
  const Eigen::AlignedBox3f bounds = BoundsOf(mesh);
  EXPECT_GT(bounds.min().z(), 1.7);
  EXPECT_LT(bounds.max().z(), 4.3);
}

TEST(MeshBuilder, FramesTurnLeftNoseDownRightSideDown) {
  const float quarter = static_cast<float>(M_PI / 2);
  const Vector3f origin(1, 2, 3);
  EXPECT_LT((FrameAt(origin, quarter) * Vector3f::UnitX() - Vector3f(1, 3, 3)).norm(), 1e-6);
  EXPECT_LT((FrameAt(origin, 0, quarter) * Vector3f::UnitX() - Vector3f(1, 2, 2)).norm(), 1e-6);
  EXPECT_LT((FrameAt(origin, 0, 0, quarter) * -Vector3f::UnitY() - Vector3f(1, 2, 2)).norm(), 1e-6);
}

}  // namespace
}  // namespace carmap
