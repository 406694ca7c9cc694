#include "carmap/sim/road/route.h"

#include <gtest/gtest.h>

#include <cmath>

namespace carmap {
namespace {

std::vector<Eigen::Vector2d> Circle(double radius_m) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 100; ++i) {
    const double angle = 2 * M_PI * i / 100;
    points.emplace_back(radius_m * std::cos(angle), radius_m * std::sin(angle));
  }
  return points;
}

TEST(Route, GoesStraightOnBeyondItsEnds) {
  const Route route({{0, 0}, {30, 0}, {100, 0}}, /*closed=*/false);
  EXPECT_NEAR(route.length_m(), 100, 1e-9);
  for (const double along_m : {-10.0, 0.0, 33.3, 100.0, 112.0}) {
    const RoutePoint point = route.At(along_m, 2);
    EXPECT_NEAR((point.position_in_enu - Eigen::Vector2d(along_m, 2)).norm(), 0, 1e-9);
    EXPECT_NEAR(point.heading_rad, 0, 1e-12);
  }
}

TEST(Route, AClosedOneGoesRound) {
  const Route route(Circle(40), /*closed=*/true);
  EXPECT_NEAR(route.length_m(), 2 * M_PI * 40, 1);
  EXPECT_NEAR(
      (route.At(10).position_in_enu - route.At(10 + 3 * route.length_m()).position_in_enu).norm(),
      0, 1e-6);
  for (double along_m = 0; along_m < route.length_m(); along_m += 7.3) {
    EXPECT_NEAR(route.At(along_m).position_in_enu.norm(), 40, 0.15) << along_m;
    EXPECT_NEAR(route.At(along_m, 5).position_in_enu.norm(), 35, 0.2) << "left is inside";
    EXPECT_NEAR(route.At(along_m).curvature_per_m, 1.0 / 40, 0.01) << along_m;
  }
}

TEST(Route, HasNoKinks) {
  const Route route({{0, 0}, {50, 0}, {50, 50}}, /*closed=*/false);
  for (double along_m = 0; along_m < route.length_m(); along_m += 0.25) {
    const RoutePoint a = route.At(along_m), b = route.At(along_m + 0.25);
    EXPECT_NEAR((a.position_in_enu - b.position_in_enu).norm(), 0.25, 0.02);
    EXPECT_LT(std::abs(std::remainder(a.heading_rad - b.heading_rad, 2 * M_PI)), 0.15);
  }
}

}  // namespace
}  // namespace carmap
