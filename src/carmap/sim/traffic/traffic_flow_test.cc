#include "carmap/sim/traffic/traffic_flow.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "carmap/sim/traffic/car_following.h"

namespace carmap {
namespace {

constexpr double kStepS = EgoTrack::kStepS;

TEST(CarFollowing, ReachesItsSpeedAndItsGap) {
  const DriverModel driver;
  double along_m = 0, speed_mps = 0, ahead_m = 60;
  for (double t = 0; t < 120; t += kStepS) {
    const double acceleration =
        FollowingAcceleration(driver, speed_mps, 20, {ahead_m - along_m, 10});
    EXPECT_LE(acceleration, driver.acceleration);
    EXPECT_GT(acceleration, -2 * driver.deceleration);
    speed_mps = std::max(0.0, speed_mps + acceleration * kStepS);
    along_m += speed_mps * kStepS;
    ahead_m += 10 * kStepS;
  }
  EXPECT_NEAR(speed_mps, 10, 0.05);
  const double gap_m = (driver.standing_gap_m + driver.headway_s * 10) / std::sqrt(1 - 1.0 / 16);
  EXPECT_NEAR(ahead_m - along_m, gap_m, 0.3) << "the model's equilibrium";

  EXPECT_NEAR(FollowingAcceleration(driver, 20, 20, {}), 0, 1e-6);
  EXPECT_LT(FollowingAcceleration(driver, 25, 20, {}), -0.3);
  EXPECT_NEAR(FollowingAcceleration(driver, 25, 0, {}), -driver.deceleration, 1e-6);
  EXPECT_EQ(FollowingAcceleration(driver, 20, 20, {1, 0}), -driver.hardest_braking);
}

TEST(CarFollowing, StopsBehindWhatStands) {
  double along_m = 0, speed_mps = 14;
  for (double t = 0; t < 60; t += kStepS) {
    const double acceleration = FollowingAcceleration({}, speed_mps, 14, {100 - along_m, 0});
    EXPECT_GT(acceleration, -4);
    speed_mps = std::max(0.0, speed_mps + acceleration * kStepS);
    along_m += speed_mps * kStepS;
  }
  EXPECT_LT(along_m, 100);
  EXPECT_NEAR(along_m, 100 - 2.5, 1);
}

TEST(GroundBox, OverlapBySeparatingAxes) {
  const GroundBox box{{10, 5}, 0.3, 2, 1};
  const Eigen::Vector2d forward = box.Forward(), left(-forward.y(), forward.x());
  for (const double turn : {0.0, M_PI / 2, M_PI}) {
    const double ahead_m = turn == M_PI / 2 ? 3 : 4, aside_m = turn == M_PI / 2 ? 3 : 2;
    const auto at = [&](double ahead, double aside) {
      return GroundBox{box.centre_in_enu + ahead * forward + aside * left, 0.3 + turn, 2, 1};
    };
    EXPECT_TRUE(Overlap(box, at(ahead_m - 0.01, 0)));
    EXPECT_FALSE(Overlap(box, at(ahead_m + 0.01, 0)));
    EXPECT_TRUE(Overlap(at(0, aside_m - 0.01), box));
    EXPECT_FALSE(Overlap(at(0, aside_m + 0.01), box));
  }
  const GroundBox askew{box.centre_in_enu + 2.6 * forward + 2 * left, 0.3 + M_PI / 4, 1, 1};
  EXPECT_FALSE(Overlap(box, askew)) << "only a side of the second one lies between them";
  const GroundBox nearer{box.centre_in_enu + 2.4 * forward + 1.9 * left, 0.3 + M_PI / 4, 1, 1};
  EXPECT_TRUE(Overlap(box, nearer));
}

TEST(ObstacleMap, KnowsHowMuchRoomThereIs) {
  World world;
  Mesh gantry;  // legs 4 m to both sides, a beam above
  const auto add = [&](Eigen::Vector3f a, Eigen::Vector3f b, Eigen::Vector3f c) {
    const auto first = static_cast<uint32_t>(gantry.vertices.size());
    for (const auto& v : {a, b, c}) gantry.vertices.push_back(v);
    gantry.triangles.push_back({first, first + 1, first + 2});
  };
  for (const float y : {-4.f, 4.f}) add({0, y, 0}, {0.1f, y, 0}, {0, y, 6});
  add({0, -4, 5}, {0, 4, 5}, {0, 0, 6});
  world.models.push_back(gantry);
  world.objects.emplace_back();
  world.objects[0].placement.position_in_enu << 20, 0, 0;
  world.objects[0].placement.scale = 0.5f;
  ObstacleMap obstacles(world);
  EXPECT_EQ(obstacles.FreeHalfWidth({20, 0}, 0, 1.5), 1.5) << "nobody hits the beam";
  EXPECT_NEAR(obstacles.FreeHalfWidth({20, 1}, 0, 1.5), 1, 0.21);
  EXPECT_TRUE(obstacles.IsBlocked({20, -2}));

  obstacles.Add({{50, 1}, M_PI / 2, 1, 0.5});
  EXPECT_NEAR(obstacles.FreeHalfWidth({50, -1}, 0, 3), 1, 0.21);
  EXPECT_NEAR(obstacles.FreeHalfWidth({50, -1}, M_PI / 2, 3), 3, 0.21);

  const Route lane({{0, -1}, {100, -1}}, /*closed=*/false);
  const NarrowPlaces narrows(lane, obstacles);
  EXPECT_NEAR(narrows.DistanceFrom(30, 1, 1.4), 19.5, 0.6);
  EXPECT_NEAR(narrows.DistanceFrom(60, -1, 1.4), 9.5, 0.6);
  EXPECT_GT(narrows.DistanceFrom(30, 1, 0.7), 1e6) << "is narrow enough to pass";
  EXPECT_GT(narrows.DistanceFrom(60, 1, 1.4), 1e6);
  EXPECT_GT(narrows.DistanceFrom(-500, 1, 1.4), 1e6) << "out of sight";
}

TEST(EgoTrack, GoesOnLapByLap) {
  const Route route({{0, 0}, {100, 0}, {100, 100}, {0, 100}}, /*closed=*/true);
  std::vector<EgoState> ego;
  for (int i = 0; i < 600; ++i) {
    const double along_m = std::fmod(2.0 * i, route.length_m());
    ego.push_back({0.2 * i, along_m, i * 0.01, 10});
  }
  const EgoTrack track(route, ego);
  EXPECT_NEAR(track.instants().back().progress_m, 1199, 1.1);
  EXPECT_NEAR(track.instants()[500].progress_m, 500, 1e-6) << "at 50 s";
  EXPECT_NEAR(track.instants()[500].speed_mps, 10, 1e-6);
  EXPECT_NEAR(track.LeftAt(500), 2.5, 1e-6);
  EXPECT_EQ(track.LeftAt(-50), 0);
  EXPECT_NEAR(static_cast<double>(track.StepNear(700)), 700, 1);
  EXPECT_EQ(track.StepNear(1e5), track.instants().size() - 1);
  EXPECT_NEAR(track.StepAt(12.34), 123.4, 1e-9);

  const EgoTrack single(route, {{7, 30, 0, 5}});
  EXPECT_GE(single.instants().size(), 2);
}

}  // namespace
}  // namespace carmap
