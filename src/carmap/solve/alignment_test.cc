#include "carmap/solve/alignment.h"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

using Positions = std::vector<Eigen::Vector3d>;

Positions Transformed(const Rigid3& b_from_a, const Positions& a) {
  Positions b;
  for (const Eigen::Vector3d& p : a) b.push_back(b_from_a * p);
  return b;
}

Positions RandomPositions(int count, TestRandom& random) {
  Positions positions;
  for (int i = 0; i < count; ++i) positions.push_back(random.Normal3(10));
  return positions;
}

double Error(const Rigid3& a, const Rigid3& b) {
  return (a.translation - b.translation).norm() + RotationBetween(a, b);
}

TEST(AlignRigidlyTest, RecoversTheTransformExactly) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(100, 2);
    const Positions a = RandomPositions(3 + static_cast<int>(seed), random);
    const auto aligned = AlignRigidly(a, Transformed(truth, a));
    ASSERT_TRUE(aligned.has_value());
    EXPECT_LT(Error(*aligned, truth), 1e-9);
  }
}

TEST(AlignRigidlyTest, IsTheLeastSquaresOptimum) {
  TestRandom random(3);
  const Positions a = RandomPositions(30, random);
  Positions b = Transformed(random.Pose(100, 2), a);
  for (Eigen::Vector3d& p : b) p += random.Normal3(0.5);
  const auto cost = [&](const Rigid3& b_from_a) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) sum += (b[i] - b_from_a * a[i]).squaredNorm();
    return sum;
  };
  const Rigid3 best = AlignRigidly(a, b).value();
  for (int c = 0; c < 6; ++c) {
    for (const double step : {-1e-3, 1e-3}) {
      EXPECT_GT(cost(Perturb(best, step * Vector6d::Unit(c))), cost(best)) << c;
    }
  }
}

TEST(AlignRigidlyTest, NeverMirrors) {
  TestRandom random(3);
  const Positions a = RandomPositions(10, random);
  Positions mirrored = a;
  for (Eigen::Vector3d& p : mirrored) p.x() *= -1;
  const Rigid3 aligned = AlignRigidly(a, mirrored).value();
  EXPECT_NEAR(aligned.rotation.toRotationMatrix().determinant(), 1, 1e-12);
  const Positions flat{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {3, 3, 0}};
  const Rigid3 truth = random.Pose(10, 2);
  EXPECT_LT(Error(AlignRigidly(flat, Transformed(truth, flat)).value(), truth), 1e-9);
}

TEST(AlignRigidlyTest, OnALineTheSmallestRotationIsTaken) {
  const Positions along_x{{0, 0, 0}, {1, 0, 0}, {5, 0, 0}, {7, 0, 0}};
  EXPECT_LT(Error(AlignRigidly(along_x, along_x).value(), Rigid3()), 1e-9);
  const Positions along_y{{2, 0, 0}, {2, 1, 0}, {2, 5, 0}, {2, 7, 0}};
  const Rigid3 quarter = AlignRigidly(along_x, along_y).value();
  EXPECT_NEAR(RotationAngle(quarter.rotation), std::numbers::pi / 2, 1e-9);
  for (size_t i = 0; i < along_x.size(); ++i) {
    EXPECT_LT((quarter * along_x[i] - along_y[i]).norm(), 1e-9);
  }
  const Positions back{{0, 0, 0}, {-1, 0, 0}, {-5, 0, 0}, {-7, 0, 0}};
  const Rigid3 turned = AlignRigidly(along_x, back).value();
  for (size_t i = 0; i < back.size(); ++i) EXPECT_LT((turned * along_x[i] - back[i]).norm(), 1e-9);
}

TEST(AlignRigidlyTest, OnOneSpotOnlyMoves) {
  const Positions a(5, Eigen::Vector3d(0.1, 0.2, 0.3)), b(5, Eigen::Vector3d(1.7, -2.9, 100.3));
  const Rigid3 aligned = AlignRigidly(a, b).value();
  EXPECT_EQ(RotationAngle(aligned.rotation), 0);
  EXPECT_LT((aligned * a[0] - b[0]).norm(), 1e-12);
}

TEST(AlignRigidlyTest, NothingForBadInput) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Positions two(2, Eigen::Vector3d::Zero()), three(3, Eigen::Vector3d::Zero());
  EXPECT_FALSE(AlignRigidly({}, {}).has_value());
  EXPECT_FALSE(AlignRigidly(two, two).has_value());
  EXPECT_FALSE(AlignRigidly(two, three).has_value());
  EXPECT_FALSE(AlignRigidly(three, {{0, 0, 0}, {1, nan, 0}, {0, 1, 0}}).has_value());
}

std::vector<Rigid3> Transformed(const Rigid3& b_from_a, const std::vector<Rigid3>& a) {
  std::vector<Rigid3> b;
  for (const Rigid3& pose : a) b.push_back(b_from_a * pose);
  return b;
}

std::vector<Rigid3> Drive(double turn_rad_per_m, int length_m) {
  std::vector<Rigid3> poses{Rigid3()};
  for (int i = 0; i < length_m; ++i) {
    const Eigen::Quaterniond turn = RotationExp({0, turn_rad_per_m, 0});
    poses.push_back(poses.back() * Rigid3{turn, {0, 0, 1}});
  }
  return poses;
}

TEST(AlignTrajectoriesTest, RecoversTheTransformExactly) {
  for (const double turn_rad_per_m : {0.0, 0.001, 0.05}) {
    TestRandom random(4);
    const Rigid3 truth = random.Pose(100, 2);
    const std::vector<Rigid3> a = Drive(turn_rad_per_m, 100);
    const auto aligned = AlignTrajectories(a, Transformed(truth, a));
    ASSERT_TRUE(aligned.has_value());
    EXPECT_LT(Error(*aligned, truth), 1e-8) << turn_rad_per_m;
  }
}

TEST(AlignTrajectoriesTest, OnAStraightRoadTheOrientationsDecideTheTurnAboutIt) {
  TestRandom random(4);
  const Rigid3 truth = random.Pose(100, 2);
  const std::vector<Rigid3> a = Drive(0, 100);
  std::vector<Rigid3> b = Transformed(truth, a);
  for (Rigid3& pose : b) pose.translation += random.Normal3(0.03);
  const Rigid3 aligned = AlignTrajectories(a, b).value();
  EXPECT_LT(RotationBetween(aligned, truth), 0.01);
}

TEST(AlignTrajectoriesTest, OnALongCurveThePositionsDominate) {
  TestRandom random(4);
  const std::vector<Rigid3> a = Drive(0.003, 1000);
  std::vector<Rigid3> b = a;
  const Eigen::Quaterniond mounting = RotationExp({0.1, 0, 0.1});
  for (Rigid3& pose : b) pose.rotation = (pose.rotation * mounting).normalized();
  EXPECT_LT(RotationBetween(AlignTrajectories(a, b).value(), Rigid3()), 0.001);
}

TEST(AlignTrajectoriesTest, StandingStillTheOrientationsDecide) {
  TestRandom random(4);
  const Rigid3 truth = random.Pose(100, 2);
  const std::vector<Rigid3> a(5, random.Pose(10, 1));
  EXPECT_LT(Error(AlignTrajectories(a, Transformed(truth, a)).value(), truth), 1e-9);
}

TEST(AlignTrajectoriesTest, NothingForBadInput) {
  EXPECT_FALSE(AlignTrajectories(Drive(0, 1), Drive(0, 1)).has_value());
  EXPECT_FALSE(AlignTrajectories(Drive(0, 5), Drive(0, 6)).has_value());
}

}  // namespace
}  // namespace carmap
