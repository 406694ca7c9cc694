#include "carmap/sim/ego_motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

/// Rises towards the east.
class Slope : public GroundMap {
 public:
  explicit Slope(double rise) : rise_(rise) {}
  double HeightAt(const Eigen::Vector2d& p_in_enu) const override { return rise_ * p_in_enu.x(); }
  GroundCover CoverAt(const Eigen::Vector2f&, const Eigen::Vector2f&) const override { return {}; }
  double CarriagewayDistance(const Eigen::Vector2d&) const override { return -1; }

 private:
  double rise_;
};

const Route kEastward({{0, 0}, {200, 0}}, /*closed=*/false);

EgoMotion Drive(double rise, EgoMotionOptions options, double speed_mps = 10) {
  return EgoMotion(kEastward, std::make_shared<Slope>(rise),
                   AlongAtSpeed(kEastward, speed_mps, options.frame_rate_hz, 100), options);
}

EgoMotionOptions EvenRoad() {
  EgoMotionOptions options;
  options.unevenness = 0;
  return options;
}

TEST(EgoMotion, LooksAheadFromTheRoofWithTheSkyAbove) {
  const EgoMotion ego = Drive(0, EvenRoad());
  ASSERT_EQ(ego.frame_count(), 100u);
  const Rigid3 pose = ego.EnuFromCamera(20);
  EXPECT_NEAR((pose.translation - Eigen::Vector3d(20, 0, 1.65)).norm(), 0, 1e-6);
  EXPECT_NEAR((pose.rotation * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm(), 0,
              1e-9);
  EXPECT_NEAR((pose.rotation * Eigen::Vector3d::UnitY() + Eigen::Vector3d::UnitZ()).norm(), 0,
              1e-9);
  EXPECT_NEAR((pose.rotation * Eigen::Vector3d::UnitX() + Eigen::Vector3d::UnitY()).norm(), 0,
              1e-9);
  EXPECT_DOUBLE_EQ(ego.TimeOf(20), 2);
}

TEST(EgoMotion, FollowsTheSlopeAndTheLane) {
  EgoMotionOptions options = EvenRoad();
  options.left_m = 3.5;
  const Rigid3 up = Drive(0.1, options).EnuFromCamera(30);
  EXPECT_NEAR(up.translation.y(), 3.5, 1e-6);
  EXPECT_NEAR((up.rotation * Eigen::Vector3d::UnitZ()).z(), std::sin(std::atan(0.1)), 1e-6);

  options.reverse = true;
  const Rigid3 down = Drive(0.1, options).EnuFromCamera(30);
  EXPECT_NEAR(down.translation.y(), 3.5, 1e-6) << "left of the route, not of the vehicle";
  EXPECT_NEAR((down.rotation * Eigen::Vector3d::UnitZ()).x(), -std::cos(std::atan(0.1)), 1e-6);
  EXPECT_NEAR((down.rotation * Eigen::Vector3d::UnitZ()).z(), -std::sin(std::atan(0.1)), 1e-6);
}

TEST(EgoMotion, ItsVelocityIsThatOfItsPoses) {
  const EgoMotion ego = Drive(0.05, {});
  for (const size_t i : {5u, 40u, 80u}) {
    const ViewMotion motion = ego.MotionAt(i);
    const Rigid3 moved = ego.EnuFromCamera(i - 1).Inverse() * ego.EnuFromCamera(i + 1);
    EXPECT_NEAR(motion.velocity_in_camera.norm(), 10, 0.4);
    EXPECT_GT(motion.velocity_in_camera.z(), 9.5);
    EXPECT_NEAR(motion.velocity_in_camera.z(), moved.translation.z() / 0.2, 0.4);
    EXPECT_LT(motion.angular_velocity_in_camera.norm(), 0.2);
    EXPECT_NEAR(ego.States()[i].speed_mps, 10, 1e-3);
  }
}

TEST(EgoMotion, AnUnevenRoadRocksItALittle) {
  const EgoMotion ego = Drive(0, {});
  double worst = 0, sum = 0;
  for (size_t i = 0; i < ego.frame_count(); ++i) {
    const double nose_up = (ego.EnuFromCamera(i).rotation * Eigen::Vector3d::UnitZ()).z();
    worst = std::max(worst, std::abs(nose_up));
    sum += nose_up * nose_up;
  }
  EXPECT_NEAR(std::sqrt(sum / 100), 3e-3, 2e-3);
  EXPECT_LT(worst, 0.015);
}

TEST(AlongAtSpeed, SlowsDownForACorner) {
  const Route corner({{0, 0}, {100, 0}, {100, 100}}, /*closed=*/false);
  const std::vector<double> along = AlongAtSpeed(corner, 12, 10, 10'000);
  const auto speed = [&](size_t i) { return (along[i + 1] - along[i]) * 10; };
  EXPECT_NEAR(speed(0), 12, 1e-6);
  double slowest = 12;
  for (size_t i = 0; i + 2 < along.size(); ++i) {
    slowest = std::min(slowest, speed(i));
    EXPECT_LT(std::abs(speed(i + 1) - speed(i)), 0.25) << "1.5 m/s² and a little";
  }
  EXPECT_LT(slowest, 5);
  EXPECT_LE(along.back(), corner.length_m());
}

TEST(AlongAtSpeed, GoesRoundAClosedRouteAsOftenAsFramesLast) {
  std::vector<Eigen::Vector2d> circle;
  for (int i = 0; i < 60; ++i)
    circle.emplace_back(30 * std::cos(i * M_PI / 30), 30 * std::sin(i * M_PI / 30));
  const std::vector<double> along = AlongAtSpeed(Route(circle, true), 7, 10, 1000);
  ASSERT_EQ(along.size(), 1000u);
  EXPECT_NEAR(along.back(), 700, 70);
}

}  // namespace
}  // namespace carmap
