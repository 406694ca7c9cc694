#include "carmap/solve/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

constexpr BundleOptions kThorough{
    .robust_iterations = 20, .final_iterations = 20, .min_relative_decrease = 1e-12};

double WorstPoseError(const Bundle& a, const Bundle& b) {
  double worst = 0;
  for (size_t i = 0; i < a.camera_from_map.size(); ++i) {
    worst = std::max(worst, DistanceBetween(a.camera_from_map[i], b.camera_from_map[i]));
    worst = std::max(worst, RotationBetween(a.camera_from_map[i], b.camera_from_map[i]));
  }
  return worst;
}

void ExpectSameBits(const Bundle& a, const Bundle& b) {
  for (size_t i = 0; i < a.camera_from_map.size(); ++i) {
    EXPECT_TRUE(SameBits(a.camera_from_map[i], b.camera_from_map[i])) << i;
  }
  EXPECT_EQ(a.points_in_map, b.points_in_map);
}

TEST(BundleAdjustmentTest, RecoversTheTruthExactlyWithoutNoise) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    TestRandom random(seed);
    const Bundle truth = MakeBundle(6, 150, {}, random);
    Bundle bundle = truth;
    Disturb(bundle, 0.1, 0.005, random);
    const BundleSummary summary = AdjustBundle(bundle, kThorough);
    EXPECT_LT(WorstPoseError(bundle, truth), 1e-8);
    EXPECT_LT(summary.final_cost, 1e-12);
    EXPECT_GT(summary.initial_cost, 1000);
    EXPECT_EQ(summary.is_outlier, std::vector<bool>(truth.observations.size(), false));
  }
}

TEST(BundleAdjustmentTest, IsAccurateWithNoiseAndAThirdOfOutliers) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    TestRandom random(seed);
    const Bundle truth = MakeBundle(8, 400, {1, 0.7, 0.3}, random);
    Bundle bundle = truth;
    Disturb(bundle, 0.1, 0.005, random);
    const double before = WorstPoseError(bundle, truth);
    const BundleSummary summary = AdjustBundle(bundle);
    EXPECT_LT(WorstPoseError(bundle, truth), 0.05);
    EXPECT_LT(WorstPoseError(bundle, truth), before / 2);
    const auto outliers = std::count(summary.is_outlier.begin(), summary.is_outlier.end(), true);
    const double share = static_cast<double>(outliers) / summary.is_outlier.size();
    // The wrong 30 %, 5 % of the others, and others at points of which most observations are wrong.
    EXPECT_GT(share, 0.30);
    EXPECT_LT(share, 0.45);
  }
}

TEST(BundleAdjustmentTest, FixedPosesDoNotMove) {
  TestRandom random(3);
  Bundle bundle = MakeBundle(6, 100, {1, 0.7}, random);
  bundle.pose_is_fixed = {false, true, false, true, false, true};
  const Bundle before = bundle;
  AdjustBundle(bundle);
  for (const size_t i : {1, 3, 5}) {
    EXPECT_TRUE(SameBits(bundle.camera_from_map[i], before.camera_from_map[i]));
  }
  for (const size_t i : {0, 2, 4}) {
    EXPECT_FALSE(SameBits(bundle.camera_from_map[i], before.camera_from_map[i]));
  }
}

TEST(BundleAdjustmentTest, WithAllPosesFixedThePointsMove) {
  TestRandom random(3);
  const Bundle truth = MakeBundle(4, 50, {0, 0, 0, 0}, random);
  Bundle bundle = truth;
  bundle.pose_is_fixed.assign(4, true);
  for (Eigen::Vector3d& point : bundle.points_in_map) point += random.Normal3(0.1);
  AdjustBundle(bundle, kThorough);
  for (const BundleObservation& o : truth.observations) {
    EXPECT_LT((bundle.points_in_map[o.point_idx] - truth.points_in_map[o.point_idx]).norm(), 1e-7);
  }
}

TEST(BundleAdjustmentTest, OrderOfTheObservationsDoesNotMatter) {
  TestRandom random(8);
  Bundle bundle = MakeBundle(5, 80, {1, 0.7, 0.1}, random);
  Bundle reversed = bundle;
  std::reverse(reversed.observations.begin(), reversed.observations.end());
  AdjustBundle(bundle);
  AdjustBundle(reversed);
  ExpectSameBits(bundle, reversed);
}

TEST(BundleAdjustmentTest, APointSeenTwiceByOnePoseCountsTwice) {
  TestRandom random(8);
  Bundle twice = MakeBundle(4, 60, {1, 0.7}, random);
  Bundle sharper = twice;
  const size_t count = twice.observations.size();
  for (size_t i = 0; i < count; ++i) twice.observations.push_back(twice.observations[i]);
  sharper.noise.pixel_px /= std::sqrt(2.0);
  sharper.noise.disparity_px /= std::sqrt(2.0);
  // Without outliers and within Huber's quadratic part both are the same least-squares problem.
  for (Bundle* bundle : {&twice, &sharper}) {
    bundle->noise.pixel_px *= 10;
    bundle->noise.disparity_px *= 10;
    AdjustBundle(*bundle, kThorough);
  }
  EXPECT_LT(WorstPoseError(twice, sharper), 1e-6);
}

TEST(BundleAdjustmentTest, SameBitsTwice) {
  TestRandom random(9);
  Bundle first = MakeBundle(6, 200, {1, 0.7, 0.2}, random);
  Disturb(first, 0.1, 0.005, random);
  Bundle second = first;
  const BundleSummary summary_1 = AdjustBundle(first), summary_2 = AdjustBundle(second);
  ExpectSameBits(first, second);
  EXPECT_EQ(summary_1.final_cost, summary_2.final_cost);
  EXPECT_EQ(summary_1.is_outlier, summary_2.is_outlier);
}

TEST(BundleAdjustmentTest, StopFlagReturnsTheStateSoFar) {
  TestRandom random(9);
  Bundle bundle = MakeBundle(6, 100, {1, 0.7}, random);
  Disturb(bundle, 0.1, 0.005, random);
  const Bundle before = bundle;
  const std::atomic<bool> stop = true;
  const BundleSummary summary = AdjustBundle(bundle, {.stop = &stop});
  EXPECT_EQ(summary.iterations, 0);
  EXPECT_EQ(summary.initial_cost, summary.final_cost);
  ExpectSameBits(bundle, before);
}

TEST(BundleAdjustmentTest, PointsWithoutInliersStay) {
  TestRandom random(4);
  Bundle bundle = MakeBundle(4, 60, {1, 0.7}, random);
  const auto unseen = static_cast<uint32_t>(bundle.points_in_map.size());
  bundle.points_in_map.push_back({1, 2, 3});
  bundle.points_in_map.push_back({0, 0, -50});
  for (uint32_t i = 0; i < 4; ++i) {
    bundle.observations.push_back({i, unseen + 1, {607, 185}, 5, 1});
  }
  const BundleSummary summary = AdjustBundle(bundle);
  EXPECT_EQ(bundle.points_in_map[unseen], Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(bundle.points_in_map[unseen + 1], Eigen::Vector3d(0, 0, -50));
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_TRUE(summary.is_outlier[summary.is_outlier.size() - 1 - k]);
  }
}

TEST(BundleAdjustmentTest, EmptyAndUnobservedBundlesStay) {
  Bundle bundle;
  bundle.rig = kTestRig;
  EXPECT_EQ(AdjustBundle(bundle).final_cost, 0);
  bundle.camera_from_map.resize(2);
  bundle.pose_is_fixed = {true, false};
  bundle.points_in_map.push_back({0, 0, 10});
  const Bundle before = bundle;
  EXPECT_EQ(AdjustBundle(bundle).final_cost, 0);
  ExpectSameBits(bundle, before);
}

TEST(BundleAdjustmentTest, OnePointSeenOnceStaysFinite) {
  for (const double disparity_px : {-1.0, 20.0}) {
    Bundle bundle;
    bundle.rig = kTestRig;
    bundle.camera_from_map.resize(1);
    bundle.pose_is_fixed = {false};
    bundle.points_in_map.push_back({1, 1, 10});
    bundle.observations.push_back({0, 0, {700, 250}, disparity_px, 1});
    const BundleSummary summary = AdjustBundle(bundle);
    EXPECT_LE(summary.final_cost, summary.initial_cost);
    EXPECT_TRUE(bundle.points_in_map[0].allFinite());
    EXPECT_TRUE(bundle.camera_from_map[0].translation.allFinite());
  }
}

TEST(BundleAdjustmentTest, AFreeGaugeStillConverges) {
  TestRandom random(5);
  Bundle bundle = MakeBundle(5, 100, {}, random);
  Disturb(bundle, 0.05, 0.002, random);
  bundle.pose_is_fixed.assign(5, false);
  EXPECT_LT(AdjustBundle(bundle, kThorough).final_cost, 1e-6);
}

TEST(BundleAdjustmentTest, NumbersThatAreNotFiniteAreOutliers) {
  TestRandom random(5);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Bundle truth = MakeBundle(5, 100, {}, random);
  Bundle bundle = truth;
  bundle.observations[3].px.x() = nan;
  bundle.points_in_map[20].y() = nan;
  const BundleSummary summary = AdjustBundle(bundle);
  EXPECT_TRUE(summary.is_outlier[3]);
  for (size_t i = 0; i < bundle.observations.size(); ++i) {
    EXPECT_EQ(summary.is_outlier[i], i == 3 || bundle.observations[i].point_idx == 20) << i;
  }
  EXPECT_LT(WorstPoseError(bundle, truth), 1e-8);
}

TEST(BundleAdjustmentTest, WrongIndicesAreABugOfTheCaller) {
  TestRandom random(5);
  const Bundle good = MakeBundle(3, 20, {}, random);
  Bundle bad = good;
  bad.observations[0].pose_idx = 3;
  EXPECT_THROW(AdjustBundle(bad), std::invalid_argument);
  bad = good;
  bad.observations[0].point_idx = 20;
  EXPECT_THROW(AdjustBundle(bad), std::invalid_argument);
  bad = good;
  bad.pose_is_fixed.pop_back();
  EXPECT_THROW(AdjustBundle(bad), std::invalid_argument);
}

}  // namespace
}  // namespace carmap
