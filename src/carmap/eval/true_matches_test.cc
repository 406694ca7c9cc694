#include "carmap/eval/true_matches.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace carmap {
namespace {

const StereoRig kRig{{700, 700, 600, 180, 1200, 360}, 0.5};
/// 1.2 m ahead, a little to the left.
const Rigid3 kNextFromThis{RotationExp({0.001, 0.02, 0}), {0.05, 0, -1.2}};

Descriptor RandomDescriptor(std::mt19937_64& random) {
  Descriptor descriptor;
  for (uint64_t& word : descriptor.words) word = random();
  return descriptor;
}

Descriptor WithFlippedBits(Descriptor descriptor, int bits) {
  for (int i = 0; i < bits; ++i) descriptor.words[i / 64] ^= uint64_t{1} << (i % 64);
  return descriptor;
}

Feature FeatureAt(const Eigen::Vector3d& p_in_camera, int level, const Descriptor& descriptor) {
  const Eigen::Vector3d uvd = kRig.Project(p_in_camera);
  return {.x_px = static_cast<float>(uvd.x()),
          .y_px = static_cast<float>(uvd.y()),
          .disparity_px = static_cast<float>(uvd.z()),
          .level = static_cast<uint8_t>(level),
          .descriptor = descriptor};
}

/// Points before the camera, as both frames see them: feature i of both is the same point.
struct World {
  std::vector<Feature> from, to;
};

World MakeWorld(size_t count, int flipped_bits = 0) {
  std::mt19937_64 random(5);
  World world;
  while (world.from.size() < count) {
    const auto uniform = [&](double low, double high) {
      return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
    };
    const Eigen::Vector3d p =
        kRig.Triangulate({uniform(100, 1100), uniform(60, 300)}, uniform(10, 50));
    const Eigen::Vector3d p_in_next = kNextFromThis * p;
    if (!kRig.camera.Contains(kRig.camera.Project(p_in_next))) continue;
    const Descriptor descriptor = RandomDescriptor(random);
    world.from.push_back(FeatureAt(p, 0, descriptor));
    world.to.push_back(FeatureAt(p_in_next, 0, WithFlippedBits(descriptor, flipped_bits)));
  }
  return world;
}

std::vector<TrueMatch> Match(const World& world, const Rigid3& motion) {
  const FeatureGrid grid(world.to, kRig.camera.width, kRig.camera.height);
  return FindTrueMatches(PredictFeatures(world.from, motion, kRig), grid, kRig);
}

TEST(EstimateMotion, FindsTheMotionToTheMillimetre) {
  const World world = MakeWorld(300, 20);
  const auto motion = EstimateMotion(world.from, world.to, kRig);
  ASSERT_TRUE(motion);
  const Rigid3 error = *motion * kNextFromThis.Inverse();
  EXPECT_LT(error.translation.norm(), 1e-3);
  EXPECT_LT(RotationAngle(error.rotation), 1e-4);
}

TEST(EstimateMotion, SaysWhenThereIsNone) {
  const World world = MakeWorld(300);
  std::mt19937_64 random(6);
  std::vector<Feature> strangers = world.to;
  for (Feature& feature : strangers) feature.descriptor = RandomDescriptor(random);
  EXPECT_FALSE(EstimateMotion(world.from, strangers, kRig));
  EXPECT_FALSE(EstimateMotion(world.from, {}, kRig));
  EXPECT_FALSE(EstimateMotion({}, world.to, kRig));
}

TEST(PredictFeatures, SaysWhereAndHowLarge) {
  const Eigen::Vector3d p(0.5, 0.2, 6);
  const Rigid3 ahead{Eigen::Quaterniond::Identity(), {0, 0, -1}};
  const auto predictions = PredictFeatures({FeatureAt(p, 2, {})}, ahead, kRig);
  ASSERT_EQ(predictions.size(), 1);
  EXPECT_LT((predictions[0].uvd - kRig.Project({0.5, 0.2, 5})).norm(), 1e-3);
  // 6 m became 5 m: one level of 1.2, nearly, since the point is a little aside.
  EXPECT_NEAR(predictions[0].level, 3, 0.02);
}

TEST(PredictFeatures, LeavesOutWhatTheNextFrameCannotHave) {
  const Rigid3 ahead{Eigen::Quaterniond::Identity(), {0, 0, -2}};
  Feature without_depth = FeatureAt({0, 0, 10}, 0, {});
  without_depth.disparity_px = Feature::kNoDisparity;
  const std::vector<Feature> features = {
      without_depth,
      FeatureAt({0, 0, 1.5}, 0, {}),     // the camera passes it
      FeatureAt({4, 0, 6}, 0, {}),       // leaves the image
      FeatureAt({0, 0.95, 5.9}, 4, {}),  // within the margin of its level
      FeatureAt({0, 0, 3}, 7, {}),       // grows beyond the last level
      FeatureAt({0, 0, 10}, 0, {}),
  };
  const auto predictions = PredictFeatures(features, ahead, kRig);
  ASSERT_EQ(predictions.size(), 1);
  EXPECT_EQ(predictions[0].feature_idx, 5);
}

TEST(FindTrueMatches, FindsAllByPlaceWhateverTheDescriptor) {
  World world = MakeWorld(300);
  std::mt19937_64 random(6);
  for (Feature& feature : world.to) feature.descriptor = RandomDescriptor(random);
  const auto predictions = PredictFeatures(world.from, kNextFromThis, kRig);
  const auto matches = Match(world, kNextFromThis);
  EXPECT_EQ(matches.size(), predictions.size());
  for (const TrueMatch& match : matches) {
    EXPECT_EQ(predictions[match.prediction_idx].feature_idx, match.feature_idx);
    EXPECT_LT(match.distance_px, 1e-3);
  }
}

TEST(FindTrueMatches, RejectsMovingThingsAndWrongMotions) {
  World world = MakeWorld(300);
  for (size_t i = 0; i < 100; ++i) world.to[i].x_px += 8;
  const auto matches = Match(world, kNextFromThis);
  EXPECT_NEAR(static_cast<double>(matches.size()), 200, 5);  // a few find a stranger by chance
  const Rigid3 wrong = Rigid3{RotationExp({0, 0.02, 0})} * kNextFromThis;
  EXPECT_LT(Match(MakeWorld(300), wrong).size(), 15);
}

TEST(FindTrueMatches, NeedsPlaceLevelAndDisparity) {
  const Eigen::Vector3d p(1, 0.3, 12);
  World world{{FeatureAt(p, 3, {})}, {FeatureAt(kNextFromThis * p, 3, {})}};
  EXPECT_EQ(Match(world, kNextFromThis).size(), 1);
  const Feature right = world.to[0];
  const auto matches_with = [&](auto change) {
    world.to[0] = right;
    change(world.to[0]);
    return Match(world, kNextFromThis).size();
  };
  EXPECT_EQ(matches_with([](Feature& f) { f.y_px += 3; }), 1);  // 1.7 px of level 3
  EXPECT_EQ(matches_with([](Feature& f) { f.y_px += 4; }), 0);
  EXPECT_EQ(matches_with([](Feature& f) { f.disparity_px += 3; }), 1);
  EXPECT_EQ(matches_with([](Feature& f) { f.disparity_px += 5; }), 0);
  EXPECT_EQ(matches_with([](Feature& f) { f.disparity_px = Feature::kNoDisparity; }), 0);
  EXPECT_EQ(matches_with([](Feature& f) { f.level = 4; }), 1);
  EXPECT_EQ(matches_with([](Feature& f) { f.level = 1; }), 0);
}

TEST(FindTrueMatches, GivesAFeatureToTheNearestPrediction) {
  const Eigen::Vector3d p(1, 0.3, 12);
  World world{{FeatureAt(p, 0, {}), FeatureAt(p, 0, {})}, {FeatureAt(kNextFromThis * p, 0, {})}};
  world.from[0].x_px += 1;
  const auto matches = Match(world, kNextFromThis);
  ASSERT_EQ(matches.size(), 1);
  EXPECT_EQ(matches[0].prediction_idx, 1);
}

/// A true match of 20 bits, and another feature `bits` away beside it.
bool AmbiguousBeside(int bits, double aside_px, int level = 0) {
  const Eigen::Vector3d p(1, 0.3, 12);
  World world{{FeatureAt(p, 0, {})}, {FeatureAt(kNextFromThis * p, 0, WithFlippedBits({}, 20))}};
  Feature other = world.to[0];
  other.descriptor = WithFlippedBits({}, bits);
  other.x_px += static_cast<float>(aside_px);
  other.level = static_cast<uint8_t>(level);
  world.to.push_back(other);
  const auto predictions = PredictFeatures(world.from, kNextFromThis, kRig);
  const FeatureGrid grid(world.to, kRig.camera.width, kRig.camera.height);
  return IsAmbiguous({}, predictions.front(), TrueMatch{0, 0, 0}, grid, /*window_px=*/60);
}

TEST(IsAmbiguous, WhereAnotherPlaceLooksAlmostTheSame) {
  EXPECT_TRUE(AmbiguousBeside(10, 30));
  EXPECT_TRUE(AmbiguousBeside(25, 30));
  EXPECT_FALSE(AmbiguousBeside(26, 30));
  EXPECT_TRUE(AmbiguousBeside(10, -30));
  EXPECT_FALSE(AmbiguousBeside(10, 61)) << "outside the window";
  EXPECT_FALSE(AmbiguousBeside(10, 1)) << "the same corner";
  EXPECT_TRUE(AmbiguousBeside(10, 30, 1));
  EXPECT_FALSE(AmbiguousBeside(10, 30, 3));
}

}  // namespace
}  // namespace carmap
