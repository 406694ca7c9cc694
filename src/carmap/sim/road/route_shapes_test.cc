#include "carmap/sim/road/route_shapes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace carmap {
namespace {

constexpr Scene kScenes[] = {Scene::kSuburb, Scene::kDowntown, Scene::kFreeway};

Trajectory PosesAlong(const std::vector<Eigen::Vector3d>& positions_in_kitti) {
  Trajectory poses;
  for (const Eigen::Vector3d& p : positions_in_kitti) {
    poses.push_back({std::nullopt, Rigid3{Eigen::Quaterniond::Identity(), p}});
  }
  return poses;
}

std::vector<Eigen::Vector3d> Line(int count, const Eigen::Vector3d& step) {
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < count; ++i) positions.push_back(i * step);
  return positions;
}

double MaxCurvature(const Route& route) {
  const double from_ends_m = route.closed() ? 0 : 10;  // where it is smoothed less
  double largest = 0;
  for (double s = from_ends_m; s < route.length_m() - from_ends_m; s += 0.5) {
    largest = std::max(largest, std::abs(route.At(s).curvature_per_m));
  }
  return largest;
}

/// Between points that are further apart than that along the route.
double LeastGap(const Route& route, double along_m) {
  const auto& points = route.points();
  const auto apart = static_cast<size_t>(along_m * 2);
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < points.size(); i += 8) {
    for (size_t k = i + apart; k < points.size(); k += 8) {
      least = std::min(least, (points[i] - points[k]).norm());
    }
  }
  return least;
}

TEST(MakeRoute, HasTheLengthAskedFor) {
  for (const Scene scene : kScenes) {
    for (const RouteShape shape :
         {RouteShape::kStraight, RouteShape::kCurves, RouteShape::kBlock}) {
      for (const double length_m : {300.0, 1000.0, 4000.0}) {
        const Route route = MakeRoute(shape, scene, length_m, 7);
        EXPECT_NEAR(route.length_m(), length_m, 0.02 * length_m) << static_cast<int>(shape);
        EXPECT_EQ(route.closed(), shape == RouteShape::kBlock);
      }
    }
  }
}

TEST(MakeRoute, StraightIsNearlySo) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    const Route route = MakeRoute(RouteShape::kStraight, Scene::kSuburb, 1000, seed);
    EXPECT_GT((route.points().back() - route.points().front()).norm(), 990);
    EXPECT_LT(MaxCurvature(route), 1 / 200.0);
  }
}

TEST(MakeRoute, CurvesBendAsRoadsOfTheirKindAndNeverMeet) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const Route street = MakeRoute(RouteShape::kCurves, Scene::kDowntown, 1500, seed);
    EXPECT_LT(MaxCurvature(street), 1 / 24.0) << seed;
    EXPECT_GT(MaxCurvature(street), 1 / 120.0) << seed;
    EXPECT_GT(LeastGap(street, 100), 60) << seed;
    const Route freeway = MakeRoute(RouteShape::kCurves, Scene::kFreeway, 3000, seed);
    EXPECT_LT(MaxCurvature(freeway), 1 / 290.0) << seed;
    EXPECT_GT(LeastGap(freeway, 200), 150) << seed;
  }
}

TEST(MakeRoute, ABlockGoesRoundFourCornersToTheLeft) {
  const Route route = MakeRoute(RouteShape::kBlock, Scene::kDowntown, 600, 3);
  double turn = 0;
  for (double s = 0; s < route.length_m(); s += 0.5) {
    turn += 0.5 * route.At(s).curvature_per_m;
    EXPECT_LT((route.At(s).position_in_enu - route.At(s + 0.5).position_in_enu).norm(), 0.51);
  }
  EXPECT_NEAR(turn, 2 * M_PI, 0.02);
  EXPECT_LT(MaxCurvature(route), 1 / 9.0);
  EXPECT_GT(MaxCurvature(route), 1 / 12.0);
  EXPECT_LT(std::abs(route.At(0).curvature_per_m), 1e-3) << "begins on a straight street";
}

TEST(MakeRoute, FollowsFromTheSeed) {
  const auto make = [](uint64_t seed) {
    return MakeRoute(RouteShape::kCurves, Scene::kSuburb, 500, seed).points();
  };
  EXPECT_EQ(make(5), make(5));
  EXPECT_NE(make(5), make(6));
}

TEST(RouteAlong, LaysKittiFrameIntoEnu) {
  // Ahead (z) and climbing (y is down), 1 m a frame.
  const auto path = RouteAlong(PosesAlong(Line(101, {0, -0.05, 1})));
  ASSERT_TRUE(path.ok()) << path.status();
  EXPECT_NEAR(path->route.length_m(), 100, 0.1);
  EXPECT_NEAR(path->route.At(50).heading_rad, M_PI / 2, 1e-9) << "north";
  for (const Eigen::Vector3d& p : path->positions_in_enu) {
    EXPECT_NEAR(p.x(), 0, 1e-9);
    EXPECT_NEAR(p.z(), 0.05 * p.y() - 1.65, 0.01);
  }
}

TEST(RouteAlong, SmoothsNoiseAndStandsStill) {
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < 200; ++i) {
    const int moved = std::min(i, 100) + std::max(0, i - 150);  // waits for 50 frames
    positions.push_back({i % 2 == 0 ? 0.03 : -0.03, 0, 0.8 * moved});
  }
  const auto path = RouteAlong(PosesAlong(positions));
  ASSERT_TRUE(path.ok()) << path.status();
  EXPECT_NEAR(path->route.length_m(), 0.8 * 149, 0.5);
  for (double s = 10; s < path->route.length_m() - 10; s += 1) {
    EXPECT_NEAR(path->route.At(s).position_in_enu.x(), 0, 0.02);
    EXPECT_LT(std::abs(path->route.At(s).curvature_per_m), 0.01);
  }
}

TEST(RouteAlong, LeavesOutLostFrames) {
  Trajectory poses = PosesAlong(Line(60, {0, 0, 1}));
  for (size_t i = 20; i < 28; ++i) poses[i].world_from_camera.reset();
  const auto path = RouteAlong(poses);
  ASSERT_TRUE(path.ok()) << path.status();
  EXPECT_NEAR(path->route.length_m(), 59, 0.1);
}

TEST(RouteAlong, SaysWhatIsWrong) {
  using ::testing::HasSubstr;
  const auto error_of = [](const std::vector<Eigen::Vector3d>& positions) {
    const auto path = RouteAlong(PosesAlong(positions));
    EXPECT_FALSE(path.ok());
    EXPECT_EQ(path.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(path.status().message());
  };
  EXPECT_THAT(error_of({}), HasSubstr("two poses"));
  EXPECT_THAT(error_of({{1, 2, 3}}), HasSubstr("two poses"));
  EXPECT_THAT(error_of(Line(50, {0, 0, 0.001})), HasSubstr("within 0.3 m"));
  EXPECT_THAT(error_of({{0, 0, 0}, {0, 0, 1}, {0, 0, 1e300}}), HasSubstr("pose 2"));
  EXPECT_THAT(error_of({{0, 0, 0}, {0, 0, 6}}), HasSubstr("pose 1"));
  EXPECT_THAT(error_of({{0, 0, 0}, {0, 0, std::nan("")}}), HasSubstr("pose 1"));
  EXPECT_THAT(error_of(Line(50, {0, -0.5, 1})), HasSubstr("50 %"));
  EXPECT_THAT(error_of(Line(50, {0, -1, 0})), HasSubstr("within 0.3 m"));
  EXPECT_THAT(error_of(Line(11000, {0, 0, 4.9})), HasSubstr("50 km"));
}

}  // namespace
}  // namespace carmap
