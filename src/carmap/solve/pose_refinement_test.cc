#include "carmap/solve/pose_refinement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

TEST(PoseRefinementTest, RecoversThePoseExactlyWithoutNoise) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(5, 0.5);
    const auto measurements = MeasureScene(truth, 100, {}, random);
    const Rigid3 initial = Perturb(truth, random.Tangent(0.3, 0.03));
    const PoseEstimate estimate = RefinePose(kTestRig, kTestNoise, measurements, initial);
    EXPECT_LT(DistanceBetween(estimate.camera_from_map, truth), 1e-8);
    EXPECT_LT(RotationBetween(estimate.camera_from_map, truth), 1e-9);
    EXPECT_EQ(estimate.inlier_count, 100);
  }
}

TEST(PoseRefinementTest, IsAccurateWithNoiseAndAThirdOfOutliers) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(5, 0.5);
    const auto measurements = MeasureScene(truth, 400, {1, 0.7, 0.3}, random);
    const Rigid3 initial = Perturb(truth, random.Tangent(0.2, 0.01));
    const PoseEstimate estimate = RefinePose(kTestRig, kTestNoise, measurements, initial);
    EXPECT_LT(DistanceBetween(estimate.camera_from_map, truth), 0.04);
    EXPECT_LT(RotationBetween(estimate.camera_from_map, truth), 0.001);
    EXPECT_NEAR(estimate.inlier_count, 400 * 0.7 * 0.95, 30);
  }
}

// Most of what is seen is on a lorry that drives by, and agrees on another pose of the camera.
TEST(PoseRefinementTest, IsNotDrawnByWhatMovesAsOne) {
  const MeasurementNoise noise{.pixel_px = 0.25, .disparity_px = 0.25};
  const Eigen::Vector3d driven(0.2, 0, -1.3);
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Rigid3 truth = random.Pose(5, 0.5);
    auto measurements = MeasureScene(truth, 150, {.pixel_px = 0.2, .disparity_px = 0.2}, random);
    for (size_t i = 50; i < measurements.size(); ++i) {
      measurements[i].position_in_map -= truth.rotation.conjugate() * driven;
    }
    const Rigid3 initial = Perturb(truth, random.Tangent(0.03, 0.002));
    const PoseEstimate estimate = RefinePose(kTestRig, noise, measurements, initial);
    EXPECT_LT(DistanceBetween(estimate.camera_from_map, truth), 0.05) << seed;
    EXPECT_GE(std::count(estimate.is_inlier.begin(), estimate.is_inlier.begin() + 50, true), 35)
        << seed;
  }
}

TEST(PoseRefinementTest, NamesTheOutliers) {
  TestRandom random(3);
  const Rigid3 truth = random.Pose(5, 0.5);
  auto measurements = MeasureScene(truth, 60, {}, random);
  measurements[7].px.x() += 40;
  measurements[21].px.y() -= 25;
  const Eigen::Vector3d behind = -(truth * measurements[33].position_in_map);
  measurements[33].position_in_map = truth.Inverse() * behind;
  const PoseEstimate estimate =
      RefinePose(kTestRig, kTestNoise, measurements, Perturb(truth, random.Tangent(0.1, 0.01)));
  EXPECT_EQ(estimate.inlier_count, 57);
  for (const size_t i : {7, 21, 33}) EXPECT_FALSE(estimate.is_inlier[i]) << i;
  EXPECT_LT(DistanceBetween(estimate.camera_from_map, truth), 1e-8);
}

TEST(PoseRefinementTest, CovarianceTellsTheScatterOfTheEstimates) {
  TestRandom random(5);
  const Rigid3 truth = random.Pose(5, 0.5);
  constexpr int kTrials = 300;
  Matrix6d scatter = Matrix6d::Zero(), predicted = Matrix6d::Zero();
  for (int trial = 0; trial < kTrials; ++trial) {
    const auto measurements = MeasureScene(truth, 80, {0.7, 0.5}, random);
    const PoseEstimate estimate = RefinePose(kTestRig, {0.7, 0.5}, measurements, truth);
    const Rigid3 turn = estimate.camera_from_map * truth.Inverse();
    Vector6d error;
    error.head<3>() = estimate.camera_from_map.translation - turn.rotation * truth.translation;
    error.tail<3>() = 2 * turn.rotation.vec() * (turn.rotation.w() < 0 ? -1 : 1);
    scatter += error * error.transpose() / kTrials;
    predicted += estimate.covariance / kTrials;
  }
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(std::sqrt(scatter(i, i) / predicted(i, i)), 1, 0.25) << i;
  }
}

TEST(PoseRefinementTest, StereoAloneGivesTheScale) {
  TestRandom random(11);
  const Rigid3 truth = random.Pose(5, 0.5);
  auto measurements = MeasureScene(truth, 50, {0, 0, 0, 0}, random);
  for (PoseMeasurement& m : measurements) m.position_in_map = truth * m.position_in_map;
  const PoseEstimate estimate =
      RefinePose(kTestRig, kTestNoise, measurements, Perturb(Rigid3(), random.Tangent(0.2, 0.02)));
  EXPECT_LT(estimate.camera_from_map.translation.norm(), 1e-8);
}

TEST(PoseRefinementTest, TooFewMeasurementsGiveTheInitialPose) {
  TestRandom random(2);
  const Rigid3 truth = random.Pose(5, 0.5), initial = Perturb(truth, random.Tangent(0.1, 0.01));
  for (const int count : {0, 1, 2}) {
    const auto measurements = MeasureScene(truth, count, {}, random);
    const PoseEstimate estimate = RefinePose(kTestRig, kTestNoise, measurements, initial);
    EXPECT_TRUE(SameBits(estimate.camera_from_map, initial));
    EXPECT_EQ(estimate.inlier_count, 0);
    EXPECT_EQ(estimate.is_inlier, std::vector<bool>(count, false));
    EXPECT_TRUE(estimate.covariance.isZero());
  }
}

TEST(PoseRefinementTest, AllBehindTheCameraGivesTheInitialPose) {
  TestRandom random(2);
  auto measurements = MeasureScene(Rigid3(), 50, {}, random);
  for (PoseMeasurement& m : measurements) m.position_in_map *= -1;
  const PoseEstimate estimate = RefinePose(kTestRig, kTestNoise, measurements, Rigid3());
  EXPECT_TRUE(SameBits(estimate.camera_from_map, Rigid3()));
  EXPECT_EQ(estimate.inlier_count, 0);
}

TEST(PoseRefinementTest, SingularSystemKeepsAFinitePose) {
  PoseMeasurement same;
  same.position_in_map = {0, 0, 10};
  same.px = {607, 185};
  const PoseEstimate estimate =
      RefinePose(kTestRig, kTestNoise, std::vector<PoseMeasurement>(20, same), Rigid3());
  EXPECT_TRUE(estimate.camera_from_map.translation.allFinite());
  EXPECT_LT(estimate.camera_from_map.translation.norm(), 1e-6);
  EXPECT_TRUE(estimate.covariance.allFinite());
}

TEST(PoseRefinementTest, NumbersThatAreNotFiniteAreOutliers) {
  TestRandom random(4);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  auto measurements = MeasureScene(Rigid3(), 50, {}, random);
  measurements[0].px.x() = nan;
  measurements[1].position_in_map.z() = nan;
  measurements[2].disparity_px = std::numeric_limits<double>::infinity();
  measurements[3].scale = 0;
  const PoseEstimate estimate =
      RefinePose(kTestRig, kTestNoise, measurements, random.Pose(0.1, 0.01));
  EXPECT_EQ(estimate.inlier_count, 46);
  EXPECT_LT(estimate.camera_from_map.translation.norm(), 1e-8);
}

TEST(PoseRefinementTest, SameBitsTwice) {
  TestRandom random(6);
  const auto measurements = MeasureScene(Rigid3(), 200, {1, 0.7, 0.3}, random);
  const Rigid3 initial = random.Pose(0.2, 0.01);
  const PoseEstimate first = RefinePose(kTestRig, kTestNoise, measurements, initial);
  const PoseEstimate second = RefinePose(kTestRig, kTestNoise, measurements, initial);
  EXPECT_TRUE(SameBits(first.camera_from_map, second.camera_from_map));
  EXPECT_EQ(first.is_inlier, second.is_inlier);
  EXPECT_EQ(first.covariance, second.covariance);
}

}  // namespace
}  // namespace carmap
