#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "carmap/solve/bundle_adjustment.h"
#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

const Eigen::Vector3d kBias(0.2, -0.15, 0.3);

/// Options that leave nothing but the measurements to say what the bias is.
constexpr BundleOptions kWithoutPrior{.robust_iterations = 20,
                                      .final_iterations = 20,
                                      .min_relative_decrease = 1e-12,
                                      .estimate_disparity_bias = true,
                                      .bias_step_sigma_px = 1e4};

/// A drive whose first pose alone is known and whose rig measures disparities with a bias.
Bundle MakeBiasedBundle(const TestNoise& noise, uint64_t seed,
                        const Eigen::Vector3d& bias = kBias) {
  TestRandom random(seed);
  Bundle bundle = MakeBundle(8, 400, noise, random);
  std::fill(bundle.pose_is_fixed.begin() + 1, bundle.pose_is_fixed.end(), false);
  StereoRig rig = kTestRig;
  rig.disparity_bias.coefficients_px = bias;
  for (BundleObservation& o : bundle.observations) {
    if (o.disparity_px <= 0) continue;
    o.disparity_px += rig.disparity_bias.At((o.px.x() - rig.camera.cx) / rig.camera.fx);
  }
  return bundle;
}

double BiasError(const Bundle& bundle, const Eigen::Vector3d& truth = kBias) {
  return (bundle.rig.disparity_bias.coefficients_px - truth).cwiseAbs().maxCoeff();
}

TEST(DisparityBias, IsWhatWithoutBiasTakesAway) {
  StereoRig rig = kTestRig;
  rig.disparity_bias.coefficients_px = {0.5, 1, 2};
  EXPECT_NEAR(rig.WithoutBias(rig.camera.cx, 10), 9.5, 1e-12);
  EXPECT_NEAR(rig.WithoutBias(rig.camera.cx + rig.camera.fx, 10), 6.5, 1e-12);
  EXPECT_NEAR(rig.WithoutBias(rig.camera.cx - rig.camera.fx, 10), 8.5, 1e-12);
}

// Few iterations reach the exact solution only if all derivatives are right.
TEST(DisparityBias, IsFoundExactlyWithoutNoise) {
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    const Bundle truth = MakeBiasedBundle({}, seed);
    Bundle bundle = truth;
    TestRandom random(seed + 10);
    Disturb(bundle, 0.05, 0.003, random);
    const BundleSummary summary = AdjustBundle(bundle, kWithoutPrior);
    EXPECT_LT(BiasError(bundle), 1e-6) << seed;
    EXPECT_LT(summary.final_cost, 1e-8) << seed;
    EXPECT_LT(summary.iterations, 15) << seed;
    for (size_t i = 0; i < truth.camera_from_map.size(); ++i) {
      EXPECT_LT(DistanceBetween(bundle.camera_from_map[i], truth.camera_from_map[i]), 1e-6);
    }
  }
}

TEST(DisparityBias, OneStepTakesAlmostAllOfIt) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    Bundle bundle = MakeBiasedBundle({}, seed);
    BundleOptions one_step = kWithoutPrior;
    one_step.robust_iterations = 1;
    one_step.final_iterations = 0;
    AdjustBundle(bundle, one_step);
    EXPECT_LT(BiasError(bundle), 0.003) << seed;
  }
}

TEST(DisparityBias, IsFoundWithAllPosesKnown) {
  Bundle bundle = MakeBiasedBundle({}, 5);
  bundle.pose_is_fixed.assign(bundle.pose_is_fixed.size(), true);
  AdjustBundle(bundle, kWithoutPrior);
  EXPECT_LT(BiasError(bundle), 1e-6);
}

TEST(DisparityBias, IsFoundToAFewHundredthsWithNoiseAndOutliers) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    Bundle bundle = MakeBiasedBundle({0.5, 0.3, 0.1}, seed);
    bundle.noise = {0.5, 0.3};
    // The bias is expected to move little in one adjustment; several get there.
    for (int n = 0; n < 3; ++n) AdjustBundle(bundle, {.estimate_disparity_bias = true});
    EXPECT_LT(BiasError(bundle), 0.09) << seed;
  }
}

TEST(DisparityBias, BentDepthsBendTheDriveUnlessItIsEstimated) {
  const Bundle truth = MakeBiasedBundle({0.1, 0.1}, 6);
  Bundle without = truth, with = truth;
  without.noise = with.noise = {0.25, 0.25};
  AdjustBundle(without);
  AdjustBundle(with, {.estimate_disparity_bias = true});
  const auto end_error = [&](const Bundle& bundle) {
    return DistanceBetween(bundle.camera_from_map.back(), truth.camera_from_map.back());
  };
  EXPECT_LT(end_error(with), 0.02);
  EXPECT_GT(end_error(without), 3 * end_error(with));
}

TEST(DisparityBias, StaysAsItIsUnlessAskedFor) {
  Bundle bundle = MakeBiasedBundle({0.5, 0.3}, 7);
  bundle.rig.disparity_bias.coefficients_px = {0.01, 0.02, 0.03};
  AdjustBundle(bundle);
  EXPECT_EQ(bundle.rig.disparity_bias.coefficients_px, Eigen::Vector3d(0.01, 0.02, 0.03));
}

TEST(DisparityBias, OfTheRigIsTakenIntoAccountAlsoWhenNotEstimated) {
  const Bundle truth = MakeBiasedBundle({}, 8);
  Bundle bundle = truth;
  bundle.rig.disparity_bias.coefficients_px = kBias;
  EXPECT_LT(AdjustBundle(bundle).final_cost, 1e-9);
  EXPECT_LT(DistanceBetween(bundle.camera_from_map.back(), truth.camera_from_map.back()), 1e-8);
}

TEST(DisparityBias, StaysWithinItsBound) {
  BundleOptions options = kWithoutPrior;
  options.max_bias_px = 0.1;
  Bundle bundle = MakeBiasedBundle({}, 9);
  AdjustBundle(bundle, options);
  EXPECT_LE(bundle.rig.disparity_bias.coefficients_px.cwiseAbs().maxCoeff(), 0.1);
  EXPECT_NEAR(bundle.rig.disparity_bias.coefficients_px.x(), 0.1, 1e-9);
}

TEST(DisparityBias, MovesNoFurtherThanExpectedWhereLittleIsMeasured) {
  // Two poses at one place: any bias fits, so that which was there stays.
  Bundle bundle;
  bundle.rig = kTestRig;
  bundle.rig.disparity_bias.coefficients_px = {0.1, 0, 0};
  bundle.camera_from_map.resize(2);
  bundle.pose_is_fixed = {true, false};
  TestRandom random(10);
  for (uint32_t j = 0; j < 100; ++j) {
    bundle.points_in_map.push_back(random.PointInCamera());
    const Eigen::Vector3d uvd = kTestRig.Project(bundle.points_in_map[j]);
    for (uint32_t i : {0u, 1u}) {
      bundle.observations.push_back({i, j, uvd.head<2>(), uvd.z() + 0.3, 1});
    }
  }
  AdjustBundle(bundle, {.estimate_disparity_bias = true});
  EXPECT_LT(BiasError(bundle, {0.1, 0, 0}), 0.02);
}

TEST(DisparityBias, StaysWithoutDisparities) {
  Bundle bundle = MakeBiasedBundle({0.5, 0, 0, 1}, 11);
  bundle.rig.disparity_bias.coefficients_px = {0.01, 0.02, 0.03};
  AdjustBundle(bundle, {.estimate_disparity_bias = true});
  EXPECT_LT(BiasError(bundle, {0.01, 0.02, 0.03}), 1e-9);
}

TEST(DisparityBias, SameBitsTwice) {
  Bundle first = MakeBiasedBundle({0.5, 0.3, 0.1}, 12);
  Bundle second = first;
  const BundleOptions options{.estimate_disparity_bias = true};
  EXPECT_EQ(AdjustBundle(first, options).final_cost, AdjustBundle(second, options).final_cost);
  EXPECT_EQ(first.rig.disparity_bias.coefficients_px, second.rig.disparity_bias.coefficients_px);
  EXPECT_EQ(first.points_in_map, second.points_in_map);
}

}  // namespace
}  // namespace carmap
