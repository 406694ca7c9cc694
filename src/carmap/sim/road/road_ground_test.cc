#include "carmap/sim/road/road_ground.h"

#include <gtest/gtest.h>

#include <cmath>

#include "carmap/base/random.h"
#include "carmap/sim/road/route_shapes.h"

namespace carmap {
namespace {

struct Ground {
  Route route;
  RoadNetwork roads;
  RoadGround ground;

  Ground(Scene scene, const Route& along, uint64_t seed)
      : route(along),
        roads(scene, route, seed),
        ground(scene, roads, HeightField(roads.Points(), {}, seed), seed) {}
};

Eigen::Vector2f Footprint(float length_m, double heading) {
  return length_m * Eigen::Vector2f(static_cast<float>(std::cos(heading)),
                                    static_cast<float>(std::sin(heading)));
}

TEST(RoadGround, KnowsEdgesToACentimetre) {
  for (const Scene scene : {Scene::kSuburb, Scene::kDowntown, Scene::kFreeway}) {
    const Route route = MakeRoute(RouteShape::kCurves, scene, 600, 11);
    const Ground world(scene, route, 11);
    const CentreLine& line = world.roads.lines().front();
    int checked = 0;
    for (double s = 5; s < line.path.length_m() - 5; s += 1.7) {
      if (line.InJunction(s, 8)) continue;
      for (const int side : {1, -1}) {
        for (const double beyond_m : {-1.0, 0.0, 0.7, 3.0}) {
          const double left_m = side * (line.section.Edge(side) + beyond_m);
          EXPECT_NEAR(world.ground.CarriagewayDistance(line.path.At(s, left_m).position_in_enu),
                      beyond_m, 0.015)
              << "at " << s;
          ++checked;
        }
      }
    }
    EXPECT_GT(checked, 500);
  }
}

TEST(RoadGround, IsLargeFarFromRoads) {
  const Ground world(Scene::kSuburb, Route({{0, 0}, {0, 200}}, false), 1);
  EXPECT_GT(world.ground.CarriagewayDistance({-400, -500}), 100);
  EXPECT_GT(world.ground.CarriagewayDistance({1e9, -1e9}), 100);
  EXPECT_GT(world.ground.CarriagewayDistance({std::nan(""), 0}), 100);
  EXPECT_EQ(world.ground.CoverAt({1e9f, 0}, {0.1f, 0}).pattern, Pattern::kGrass);
}

TEST(RoadGround, TheHeightIsSmoothEverywhere) {
  const Ground world(Scene::kSuburb, MakeRoute(RouteShape::kCurves, Scene::kSuburb, 500, 2), 2);
  for (double x = -1500; x < 1500; x += 37) {
    for (double y = -1500; y < 1500; y += 41) {
      const double a = world.ground.HeightAt({x, y}), b = world.ground.HeightAt({x + 1, y});
      ASSERT_LT(std::abs(a - b), 0.3) << x << ' ' << y;
    }
  }
  for (double s = 0; s < world.route.length_m(); s += 1) {
    const Eigen::Vector2d p = world.route.At(s).position_in_enu;
    const Eigen::Vector2d q = world.route.At(s + 1).position_in_enu;
    const Eigen::Vector2d r = world.route.At(s + 2).position_in_enu;
    const auto height = [&](const Eigen::Vector2d& at) { return world.ground.HeightAt(at); };
    EXPECT_LT(std::abs(height(q) - height(p)), 0.10);
    EXPECT_LT(std::abs(height(p) - 2 * height(q) + height(r)), 0.01);
  }
}

TEST(RoadGround, FollowsRecordedHeights) {
  std::vector<Eigen::Vector3d> heights;
  std::vector<Eigen::Vector2d> points;
  for (double y = 0; y <= 600; y += 1) {
    points.emplace_back(0, y);
    heights.emplace_back(0, y, 0.06 * y + 1.5 * std::sin(y / 80));
  }
  const HeightField field(points, heights, 1);
  for (double y = 80; y < 520; y += 10) {
    EXPECT_NEAR(field.At({0, y}), 0.06 * y + 1.5 * std::sin(y / 80), 0.25) << y;
    EXPECT_NEAR(field.At({20, y}), field.At({0, y}), 0.3) << "level across the road";
  }
}

TEST(RoadGround, DashesAreCrispNearAndEvenFar) {
  const Route route({{0, 0}, {0, 400}}, /*closed=*/false);
  const Ground world(Scene::kFreeway, route, 4);
  // Between the route's lane and the next to the left: 6 m of white, 12 m of none.
  const auto albedo_at = [&](double along_m, float footprint_m) {
    const Eigen::Vector2d p = route.At(along_m, 1.875).position_in_enu;
    return world.ground.CoverAt(p.cast<float>(), Footprint(footprint_m, M_PI / 2)).albedo;
  };
  double sum = 0;
  int white = 0, between = 0, count = 0;
  for (double s = 100; s < 280; s += 0.01, ++count) {
    const float albedo = albedo_at(s, 0.001f);
    sum += albedo;
    white += albedo > 0.55f ? 1 : 0;
    between += albedo > 0.25f && albedo <= 0.55f ? 1 : 0;
  }
  EXPECT_NEAR(white / static_cast<double>(count), 1.0 / 3, 0.002);
  EXPECT_LT(between, 40) << "each of the 20 ends blends over less than 2 cm";
  // A spot as long as a dash sees ramps, of the same mean; nowhere more than the dash.
  double mean = 0;
  for (int i = 0; i < 180; ++i) mean += albedo_at(100.25 + i, 6) / 180;
  EXPECT_NEAR(mean, sum / count, 0.005);
}

/// What a long footprint sees is the mean of what short ones see along it.
TEST(RoadGround, AFootprintSeesTheMean) {
  for (const Scene scene : {Scene::kSuburb, Scene::kDowntown, Scene::kFreeway}) {
    Ground world(scene, Route({{0, 0}, {300, 100}}, false), 9);
    Decal decal;
    decal.centre_in_enu = world.route.At(150, -0.4).position_in_enu.cast<float>();
    decal.half_length_m = 0.8f;
    decal.half_width_m = 0.5f;
    decal.cover = {Pattern::kPlain, 0.9f, 1, SemanticClass::kRoad};
    world.ground.SetDecals({decal});
    HashSequence draw(17);
    double worst = 0, mean_error = 0;
    constexpr int kSpots = 300;
    for (int i = 0; i < kSpots; ++i) {
      const Eigen::Vector2f p =
          world.route.At(draw.Between(145, 155), draw.Between(-6, 6)).position_in_enu.cast<float>();
      const double heading = std::atan2(100, 300) + (i % 2) * M_PI / 2;
      const Eigen::Vector2f footprint = Footprint(1.5f, heading);
      double mean = 0;
      for (int k = 0; k < 300; ++k) {
        mean += world.ground
                    .CoverAt(p + ((static_cast<float>(k) + 0.5f) / 300 - 0.5f) * footprint,
                             Footprint(0.004f, heading))
                    .albedo /
                300;
      }
      const double error = std::abs(world.ground.CoverAt(p, footprint).albedo - mean);
      worst = std::max(worst, error);
      mean_error += error / kSpots;
    }
    EXPECT_LT(mean_error, 0.01) << static_cast<int>(scene);
    EXPECT_LT(worst, 0.2) << static_cast<int>(scene) << ": the spot is a little wide, too";
  }
}

TEST(RoadGround, DecalsLieWhereTheyAreSaidTo) {
  Ground world(Scene::kSuburb, Route({{0, 0}, {0, 200}}, false), 4);
  Decal lawn;
  lawn.centre_in_enu = {-20, 100};
  lawn.along = Eigen::Vector2f(3, 4).normalized();
  lawn.half_length_m = 6;
  lawn.half_width_m = 2;
  lawn.cover = {Pattern::kGravel, 0.4f, 1, SemanticClass::kTerrain};
  world.ground.SetDecals({lawn});
  const auto pattern_at = [&](float x, float y) {
    const Eigen::Vector2f p =
        lawn.centre_in_enu + x * lawn.along + y * Eigen::Vector2f(-lawn.along.y(), lawn.along.x());
    return world.ground.CoverAt(p, {0.005f, 0}).pattern;
  };
  for (const float sign : {1.0f, -1.0f}) {
    EXPECT_EQ(pattern_at(sign * 5.98f, 0), Pattern::kGravel);
    EXPECT_EQ(pattern_at(sign * 6.02f, 0), Pattern::kGrass);
    EXPECT_EQ(pattern_at(3, sign * 1.98f), Pattern::kGravel);
    EXPECT_EQ(pattern_at(3, sign * 2.02f), Pattern::kGrass);
  }
}

}  // namespace
}  // namespace carmap
