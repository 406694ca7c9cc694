#include "carmap/solve/pnp.h"

#include <gtest/gtest.h>

#include <limits>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

TEST(PnpTest, RecoversThePoseExactlyWithoutNoise) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(100, 2);
    const auto measurements = MeasureScene(truth, 50, {}, random);
    const auto estimate = SolvePnpRansac(kTestRig, kTestNoise, measurements);
    ASSERT_TRUE(estimate.has_value());
    EXPECT_LT(DistanceBetween(estimate->camera_from_map, truth), 1e-7);
    EXPECT_LT(RotationBetween(estimate->camera_from_map, truth), 1e-8);
    EXPECT_EQ(estimate->inlier_count, 50);
  }
}

TEST(PnpTest, FindsThePoseAmongManyOutliers) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(100, 2);
    const auto measurements = MeasureScene(truth, 200, {1, 0.7, 0.6}, random);
    const auto estimate = SolvePnpRansac(kTestRig, kTestNoise, measurements);
    ASSERT_TRUE(estimate.has_value());
    EXPECT_LT(DistanceBetween(estimate->camera_from_map, truth), 0.1);
    EXPECT_LT(RotationBetween(estimate->camera_from_map, truth), 0.003);
    EXPECT_NEAR(estimate->inlier_count, 80, 30);
    EXPECT_EQ(estimate->is_inlier.size(), 200u);
  }
}

TEST(PnpTest, StereoFindsThePoseAmongNineOutliersOfTen) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(100, 2);
    const auto measurements = MeasureScene(truth, 300, {0.5, 0.25, 0.9, 0}, random);
    const auto estimate =
        SolvePnpRansac(kTestRig, kTestNoise, measurements, {.max_iterations = 10000});
    ASSERT_TRUE(estimate.has_value()) << seed;
    EXPECT_LT(DistanceBetween(estimate->camera_from_map, truth), 0.1);
  }
}

TEST(PnpTest, RefusesPosesThatAreNotUpright) {
  TestRandom random(3);
  const Rigid3 truth{RotationExp({0.1, -0.4, 0.2}), {1, 2, 3}};
  for (const double mono_ratio : {0.0, 1.0}) {
    const auto measurements = MeasureScene(truth, 60, {0, 0, 0, mono_ratio}, random);
    PnpOptions options;
    options.down_in_map = truth.rotation.conjugate() * Eigen::Vector3d::UnitY();
    EXPECT_TRUE(SolvePnpRansac(kTestRig, kTestNoise, measurements, options).has_value());
    options.down_in_map =
        truth.rotation.conjugate() * (RotationExp({0.5, 0, 0}) * Eigen::Vector3d::UnitY());
    EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, measurements, options).has_value());
  }
}

TEST(PnpTest, WorksWithoutDisparities) {
  TestRandom random(1);
  const Rigid3 truth = random.Pose(100, 2);
  const auto measurements = MeasureScene(truth, 60, {0, 0, 0.3, 1}, random);
  const auto estimate = SolvePnpRansac(kTestRig, kTestNoise, measurements);
  ASSERT_TRUE(estimate.has_value());
  EXPECT_LT(DistanceBetween(estimate->camera_from_map, truth), 1e-6);
}

TEST(PnpTest, DisparityTellsTwinsApart) {
  // A scene scaled about the camera looks the same to one eye; only the disparities disagree.
  TestRandom random(1);
  auto measurements = MeasureScene(Rigid3(), 60, {0, 0, 0, 0}, random);
  for (PoseMeasurement& m : measurements) m.position_in_map *= 1.5;
  EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, measurements).has_value());
  for (PoseMeasurement& m : measurements) m.disparity_px = -1;
  EXPECT_TRUE(SolvePnpRansac(kTestRig, kTestNoise, measurements).has_value());
}

TEST(PnpTest, NothingWithoutEnoughInliers) {
  TestRandom random(1);
  for (const int count : {0, 1, 2, 3, 11}) {
    const auto measurements = MeasureScene(Rigid3(), count, {}, random);
    EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, measurements).has_value()) << count;
  }
  EXPECT_TRUE(
      SolvePnpRansac(kTestRig, kTestNoise, MeasureScene(Rigid3(), 12, {}, random)).has_value());
  auto unrelated = MeasureScene(Rigid3(), 100, {}, random);
  for (PoseMeasurement& m : unrelated) m.position_in_map = random.PointInCamera();
  EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, unrelated).has_value());
}

TEST(PnpTest, DegenerateInputGivesNothing) {
  PoseMeasurement same;
  same.position_in_map = {0, 0, 10};
  same.px = {100, 100};
  EXPECT_FALSE(
      SolvePnpRansac(kTestRig, kTestNoise, std::vector<PoseMeasurement>(30, same)).has_value());

  TestRandom random(1);
  auto behind = MeasureScene(Rigid3(), 30, {0, 0, 0, 0}, random);
  for (PoseMeasurement& m : behind) m.disparity_px = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, behind).has_value());

  auto not_finite = MeasureScene(Rigid3(), 30, {}, random);
  for (PoseMeasurement& m : not_finite) m.px.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(SolvePnpRansac(kTestRig, kTestNoise, not_finite).has_value());
}

TEST(PnpTest, TheSeedDecidesTheBits) {
  TestRandom random(1);
  const auto measurements = MeasureScene(random.Pose(10, 1), 200, {1, 0.7, 0.5}, random);
  const auto first = SolvePnpRansac(kTestRig, kTestNoise, measurements, {.seed = 5});
  const auto second = SolvePnpRansac(kTestRig, kTestNoise, measurements, {.seed = 5});
  ASSERT_TRUE(first.has_value() && second.has_value());
  EXPECT_TRUE(SameBits(first->camera_from_map, second->camera_from_map));
  EXPECT_EQ(first->is_inlier, second->is_inlier);
}

}  // namespace
}  // namespace carmap
