#include "carmap/sim/road/lane_line.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace carmap {
namespace {

Route Circle(double radius_m) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 200; ++i) {
    const double angle = 2 * M_PI * i / 200;
    points.emplace_back(radius_m * std::cos(angle), radius_m * std::sin(angle));
  }
  return Route(points, /*closed=*/true);
}

/// East, and to the left or right by 90 degrees with a radius of 5 m.
Route Corner(int side) {
  std::vector<Eigen::Vector2d> points{{0, 0}};
  for (int i = 0; i <= 10; ++i) {
    const double angle = M_PI / 20 * i;
    points.emplace_back(40 + 5 * std::sin(angle), side * 5 * (1 - std::cos(angle)));
  }
  points.emplace_back(45, side * 50);
  return Route(points, /*closed=*/false);
}

TEST(LaneLine, IsBesideTheRoute) {
  const Route route = Circle(40);
  const LaneLine inner(route, 4), outer(route, -4);
  EXPECT_NEAR(inner.path().length_m(), 2 * M_PI * 36, 1);
  EXPECT_NEAR(outer.path().length_m(), 2 * M_PI * 44, 1);
  for (const LaneLine* line : {&inner, &outer}) {
    for (double along_m = -300; along_m < 600; along_m += 7) {
      const Eigen::Vector2d on_line = line->path().At(line->Beside(along_m)).position_in_enu;
      EXPECT_NEAR((on_line - route.At(along_m).position_in_enu).norm(), 4, 0.2) << along_m;
    }
  }
}

TEST(LaneLine, NeverFoldsBack) {
  for (const int side : {-1, 1}) {
    const Route route = Corner(side);
    const LaneLine inside(route, side * 7), outside(route, side * -7);
    for (const LaneLine* line : {&inside, &outside}) {
      const Route& path = line->path();
      for (double along_m = 0; along_m + 1 < path.length_m(); along_m += 0.5) {
        const RoutePoint a = path.At(along_m), b = path.At(along_m + 0.5);
        const double turn = std::remainder(b.heading_rad - a.heading_rad, 2 * M_PI);
        EXPECT_GE(side * turn, -0.05) << "turns the other way";
        EXPECT_LT(side * turn, 0.4) << "turns on the spot";
      }
      double before = line->Beside(-20);
      for (double along_m = -20; along_m < route.length_m() + 20; along_m += 0.3) {
        EXPECT_GE(line->Beside(along_m), before);
        before = line->Beside(along_m);
      }
    }
    EXPECT_GT(outside.path().length_m(), inside.path().length_m() + 15);
  }
}

TEST(SpeedLimit, SlowsDownForCurves) {
  const SpeedLimit round(Circle(40), 2.5, 1.5);
  EXPECT_NEAR(round.At(17), 10, 0.5);
  EXPECT_NEAR(round.At(17 + 5 * 2 * M_PI * 40), 10, 0.5);

  const Route corner = Corner(1);
  const SpeedLimit limit(corner, 2.5, 1.5);
  EXPECT_LT(limit.At(44), 4.5);
  for (double along_m = 0; along_m < corner.length_m() - 0.5; along_m += 0.5) {
    const double v = limit.At(along_m), next = limit.At(along_m + 0.5);
    EXPECT_LT(std::abs(next * next - v * v), 2 * 1.5 * 0.5 * 1.1) << along_m;
    const double curvature = std::abs(corner.At(along_m).curvature_per_m);
    EXPECT_LE(v * v * curvature, 2.5 * 1.05) << along_m;
  }
}

}  // namespace
}  // namespace carmap
