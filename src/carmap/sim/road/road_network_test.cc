#include "carmap/sim/road/road_network.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "carmap/sim/road/route_shapes.h"

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2d>;

int CountOf(const RoadNetwork& roads, CentreLine::Kind kind) {
  return static_cast<int>(std::count_if(roads.lines().begin(), roads.lines().end(),
                                        [&](const CentreLine& line) { return line.kind == kind; }));
}

/// Up a street, round a small circle at its end, and back down it in the other lane.
Route OutAndBack() {
  Points points;
  for (double y = 0; y <= 300; y += 2) points.emplace_back(1.5, y);
  for (double a = 0.1; a < 3.1; a += 0.1) {
    points.emplace_back(-10.5 + 12 * std::cos(a), 300 + 12 * std::sin(a));
  }
  for (double y = 300; y >= 260; y -= 2) points.emplace_back(-22.5, y);
  for (double t = 0; t <= 1; t += 0.02) {  // swings over to the other lane of the way up
    points.emplace_back(-22.5 + 21 * (3 * t * t - 2 * t * t * t), 259 - 60 * t);
  }
  for (double y = 197; y >= 0; y -= 2) points.emplace_back(-1.5, y);
  return Route(points, /*closed=*/false);
}

/// A figure of eight: crosses itself at a right angle.
Route Eight() {
  Points points;
  for (int i = 0; i < 400; ++i) {
    const double t = 2 * M_PI * i / 400;
    points.emplace_back(200 * std::sin(t), 120 * std::sin(2 * t));
  }
  return Route(points, /*closed=*/true);
}

void ExpectOnCarriageway(const RoadNetwork& roads, const Route& route) {
  for (double s = 0; s <= route.length_m(); s += 0.5) {
    ASSERT_LT(roads.EdgeDistance(route.At(s).position_in_enu, 30), -0.9) << "at " << s << " m";
  }
}

TEST(RoadNetwork, TheRouteRunsInTheRightLane) {
  const Route route({{0, 0}, {0, 300}}, /*closed=*/false);
  for (const auto& [scene, offset_m] :
       {std::pair{Scene::kSuburb, -1.55}, {Scene::kDowntown, -1.625}, {Scene::kFreeway, -11.25}}) {
    const RoadNetwork roads(scene, route, 3);
    for (double s = 0; s <= 300; s += 10) {
      const auto hits = roads.Near(route.At(s).position_in_enu, 14);
      ASSERT_FALSE(hits.empty());
      const auto main = std::find_if(hits.begin(), hits.end(), [&](const RoadHit& hit) {
        return roads.lines()[hit.line].kind == CentreLine::Kind::kMain;
      });
      EXPECT_NEAR(main->left_m, offset_m, 1e-6);
      EXPECT_NEAR(main->heading_rad, M_PI / 2, 1e-6);
    }
    EXPECT_EQ(CountOf(roads, CentreLine::Kind::kMain), 1);
  }
}

TEST(RoadNetwork, ARevisitedStreetIsOneRoad) {
  const Route route = OutAndBack();
  const RoadNetwork roads(Scene::kSuburb, route, 5);
  ExpectOnCarriageway(roads, route);
  // Where both passes run, all hits with the street's direction are the same line.
  for (double y = 20; y < 180; y += 5) {
    int along = 0;
    for (const RoadHit& hit : roads.Near({0, y}, 12)) {
      along += std::abs(std::sin(hit.heading_rad)) > 0.9 ? 1 : 0;
    }
    EXPECT_EQ(along, 1) << "at " << y;
  }
}

TEST(RoadNetwork, ACrossingIsTwoRoadsWithAJunction) {
  const Route route = Eight();
  const RoadNetwork roads(Scene::kDowntown, route, 5);
  ExpectOnCarriageway(roads, route);
  const auto hits = roads.Near({0, 0}, 6);
  ASSERT_EQ(hits.size(), 2u);
  EXPECT_GT(std::abs(std::sin(hits[0].heading_rad - hits[1].heading_rad)), 0.7);
  for (const RoadHit& hit : hits) {
    EXPECT_TRUE(roads.lines()[hit.line].InJunction(hit.along_m, 0));
    const double width_m = roads.lines()[hit.line].section.Edge(1);
    EXPECT_FALSE(roads.lines()[hit.line].InJunction(hit.along_m - 3 * width_m, 0));
  }
}

TEST(RoadNetwork, JunctionDistancesCountFromTheirEdges) {
  CentreLine line{.path = Route({{0, 0}, {100, 0}}, false), .junctions = {{20, 30}, {60, 70}}};
  EXPECT_DOUBLE_EQ(line.ToJunctionAhead(5), 15);
  EXPECT_DOUBLE_EQ(line.ToJunctionAhead(25), 0);
  EXPECT_DOUBLE_EQ(line.ToJunctionAhead(40), 20);
  EXPECT_GT(line.ToJunctionAhead(71), 1000);
  EXPECT_GT(line.ToJunctionBehind(5), 1000);
  EXPECT_DOUBLE_EQ(line.ToJunctionBehind(40), 10);
  EXPECT_TRUE(line.InJunction(31, 2));
  EXPECT_FALSE(line.InJunction(33, 2));
}

TEST(RoadNetwork, TurnsOfAFreewaySharperThanItIsWideStillCarryTheRoute) {
  Points points;
  for (double a = 0; a < 4.5; a += 0.02) {
    const double radius = 9;
    points.emplace_back(radius * std::cos(a), radius * std::sin(a));
  }
  const Route route(points, /*closed=*/false);
  const RoadNetwork roads(Scene::kFreeway, route, 5);
  for (double s = 0; s <= route.length_m(); s += 0.5) {
    ASSERT_LT(roads.EdgeDistance(route.At(s).position_in_enu, 30), -0.9) << "at " << s << " m";
  }
}

TEST(RoadNetwork, SideStreetsKeepAwayFromOtherRoads) {
  for (uint64_t seed = 0; seed < 5; ++seed) {
    const Route route = MakeRoute(RouteShape::kCurves, Scene::kDowntown, 1000, seed);
    const RoadNetwork roads(Scene::kDowntown, route, seed);
    EXPECT_GT(CountOf(roads, CentreLine::Kind::kSide), 5);
    for (uint32_t idx = 0; idx < roads.lines().size(); ++idx) {
      const CentreLine& line = roads.lines()[idx];
      if (line.kind != CentreLine::Kind::kSide) continue;
      const double end_m = std::min(35.0, line.path.length_m());
      EXPECT_EQ(roads.Near(line.path.At(end_m).position_in_enu, 14).size(), 1u);
    }
  }
}

}  // namespace
}  // namespace carmap
