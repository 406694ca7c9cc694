#include "carmap/update/landmark_pairs.h"

#include <gtest/gtest.h>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

const Rigid3 kBaseFromSegment{RotationExp({0.2, -1.1, 0.3}), {900, -20, 4000}};

std::vector<PointPair> RandomPairs(size_t count, double sigma_m, double outlier_ratio) {
  StreetRandom random(8);
  std::vector<PointPair> pairs;
  for (size_t i = 0; i < count; ++i) {
    PointPair& pair = pairs.emplace_back();
    pair.p_in_segment = {random.Uniform(-15, 15), random.Uniform(-5, 2), random.Uniform(0, 60)};
    pair.p_in_base = kBaseFromSegment * pair.p_in_segment;
    // Far landmarks are ten times as uncertain as near ones.
    const double sigma = i % 2 ? sigma_m : 10 * sigma_m;
    const double assumed = std::max(sigma, 0.01);
    pair.base_covariance = pair.segment_covariance =
        assumed * assumed / 2 * Eigen::Matrix3d::Identity();
    for (int axis = 0; axis < 3; ++axis) pair.p_in_base[axis] += random.Normal(sigma);
    if (random.Uniform(0, 1) < outlier_ratio) pair.p_in_base.x() += random.Uniform(3, 9);
  }
  return pairs;
}

Rigid3 Disturbed(const Rigid3& base_from_segment) {
  return base_from_segment * Rigid3{RotationExp({0.01, -0.02, 0.01}), {0.3, -0.1, 0.4}};
}

TEST(AlignPairs, IsExactWithoutNoiseDespiteOutliers) {
  const auto pairs = RandomPairs(300, 0, 0.25);
  const auto alignment = AlignPairs(pairs, Disturbed(kBaseFromSegment));
  ASSERT_TRUE(alignment);
  const Rigid3 error = kBaseFromSegment.Inverse() * alignment->base_from_segment;
  EXPECT_LT(error.translation.norm(), 1e-6);
  EXPECT_LT(RotationAngle(error.rotation), 1e-8);
  EXPECT_NEAR(alignment->inlier_count, 225, 25);
}

TEST(AlignPairs, WeighsPairsByTheirUncertainty) {
  const auto alignment = AlignPairs(RandomPairs(400, 0.02, 0.1), Disturbed(kBaseFromSegment));
  ASSERT_TRUE(alignment);
  const Rigid3 error = kBaseFromSegment.Inverse() * alignment->base_from_segment;
  const Eigen::Vector3d center(0, 0, 30);
  // 180 pairs of 2 cm: 1.5 mm an axis. Unweighted, those of 20 cm would leave 10 mm.
  EXPECT_LT((error * center - center).norm(), 0.006);
  EXPECT_GT(alignment->inlier_count, 340);
}

TEST(AlignPairs, RefusesPairsThatDetermineNothing) {
  EXPECT_FALSE(AlignPairs({}, Rigid3()));
  EXPECT_FALSE(AlignPairs(RandomPairs(4, 0, 0), kBaseFromSegment));
  EXPECT_FALSE(AlignPairs(std::vector<PointPair>(50, RandomPairs(1, 0, 0)[0]), kBaseFromSegment));
}

TEST(LandmarkCovariance, GrowsAlongTheLineOfSight) {
  LeanMap lean;
  lean.drives = {{{1}, kStreetRig}};
  lean.keyframes.resize(1);
  lean.keyframes[0].id = {{1}, 0};
  for (uint32_t i = 0; i < 2; ++i) {
    LeanLandmark landmark;
    landmark.id = {{1}, i};
    landmark.position_in_map = {0, 0, i == 0 ? 10.0 : 40.0};
    landmark.keyframe_idxs = {0};
    lean.landmarks.push_back(landmark);
  }
  const ReconstructedMap map = Reconstruct(lean);
  const MeasurementNoise noise{.pixel_px = 1, .disparity_px = 0.7};
  const Eigen::Matrix3d near = LandmarkCovariance(map, 0, noise);
  const Eigen::Matrix3d far = LandmarkCovariance(map, 1, noise);
  const double depth_sigma_m = 40 * 40 / (718 * 0.54) * noise.disparity_px;
  EXPECT_NEAR(std::sqrt(far(2, 2)), depth_sigma_m, 0.01 * depth_sigma_m);
  EXPECT_NEAR(std::sqrt(far(0, 0)), std::hypot(40.0 / 718 * noise.pixel_px, 0.02), 0.005);
  EXPECT_NEAR(std::sqrt(far(2, 2) / near(2, 2)), 16, 0.5);
}

}  // namespace
}  // namespace carmap
