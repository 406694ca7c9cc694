#include "carmap/localize/landmark_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "carmap/map/test_street.h"

namespace carmap {

bool operator==(const LandmarkMatch& a, const LandmarkMatch& b) {
  return a.landmark_idx == b.landmark_idx && a.feature_idx == b.feature_idx;
}
void PrintTo(const LandmarkMatch& match, std::ostream* out) {
  *out << match.landmark_idx << " is " << match.feature_idx;
}

namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Descriptor WithBits(Descriptor descriptor, int count) {
  for (int bit = 0; bit < count; ++bit) descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  return descriptor;
}

/// Two landmarks 20 m ahead, seen from the origin at level 2, and a camera at the origin.
class ProjectionTest : public ::testing::Test {
 protected:
  ProjectionTest() {
    for (const double x_m : {0.0, 4.0}) {
      SnapshotLandmark& landmark = map_.landmarks.emplace_back();
      landmark.position_in_map = {x_m, 0.5, 20};
      landmark.descriptor = random_.RandomDescriptor();
      DeriveVisibility({{0, 0, 0}}, {0, 0, 0}, 2, landmark);
    }
  }

  /// What the camera sees of the landmark, moved by these pixels.
  Feature Seen(uint32_t landmark_idx, double dx = 0, double dy = 0, double ddisparity = 0) const {
    const SnapshotLandmark& landmark = map_.landmarks[landmark_idx];
    const Eigen::Vector3d uvd = kStreetRig.Project(camera_from_map_ * landmark.position_in_map);
    return {.x_px = static_cast<float>(uvd.x() + dx),
            .y_px = static_cast<float>(uvd.y() + dy),
            .disparity_px = static_cast<float>(uvd.z() + ddisparity),
            .level = 2,
            .descriptor = landmark.descriptor};
  }
  std::vector<LandmarkMatch> Match(const std::vector<Feature>& features,
                                   const ProjectionMatchOptions& options = {}) const {
    const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
    return MatchByProjection(map_, {0, 1}, grid, kStreetRig, camera_from_map_, options);
  }

  StreetRandom random_{5};
  MapSnapshot map_;
  Rigid3 camera_from_map_;
};

TEST_F(ProjectionTest, FindsLandmarksWhereTheyMustAppear) {
  EXPECT_THAT(Match({Seen(1), Seen(0)}), ElementsAre(LandmarkMatch{1, 0}, LandmarkMatch{0, 1}));
}

TEST_F(ProjectionTest, LooksAtTheLandmarksAskedForOnly) {
  const std::vector<Feature> features = {Seen(0), Seen(1)};
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  EXPECT_THAT(MatchByProjection(map_, {1}, grid, kStreetRig, camera_from_map_, {}),
              ElementsAre(LandmarkMatch{1, 1}));
}

TEST_F(ProjectionTest, TheWindowGrowsWithTheLevel) {
  const double radius = 4 * ScaleOfLevel(2);
  EXPECT_THAT(Match({Seen(0, radius - 0.1, 0.1 - radius)}), ElementsAre(LandmarkMatch{0, 0}));
  EXPECT_THAT(Match({Seen(0, radius + 0.1, 0)}), IsEmpty());
  EXPECT_THAT(Match({Seen(0, 0, -radius - 0.1)}), IsEmpty());
}

TEST_F(ProjectionTest, DisparitiesMustAgreeWhereThereIsOne) {
  EXPECT_THAT(Match({Seen(0, 0, 0, 5)}), ElementsAre(LandmarkMatch{0, 0}));
  EXPECT_THAT(Match({Seen(0, 0, 0, 7)}), IsEmpty());
  Feature mono = Seen(0);
  mono.disparity_px = Feature::kNoDisparity;
  EXPECT_THAT(Match({mono}), ElementsAre(LandmarkMatch{0, 0}));
}

TEST_F(ProjectionTest, TheLevelMustBeThatWhichTheDistancePredicts) {
  for (int level = 0; level < kLevelCount; ++level) {
    Feature feature = Seen(0);
    feature.level = static_cast<uint8_t>(level);
    EXPECT_EQ(Match({feature}).size(), std::abs(level - 2) <= 1 ? 1u : 0u) << level;
  }
  // From 20 / 1.2² m it is seen two levels further up.
  camera_from_map_.translation.z() = -20 * (1 - 1 / (kLevelScale * kLevelScale));
  Feature feature = Seen(0);
  EXPECT_THAT(Match({feature}), IsEmpty());
  feature.level = 4;
  EXPECT_EQ(Match({feature}).size(), 1u);
}

TEST_F(ProjectionTest, AppearanceMustAgree) {
  Feature feature = Seen(0);
  feature.descriptor = WithBits(feature.descriptor, 38);
  EXPECT_EQ(Match({feature}).size(), 1u);
  feature.descriptor = WithBits(Seen(0).descriptor, 39);
  EXPECT_THAT(Match({feature}), IsEmpty());
}

TEST_F(ProjectionTest, TheSecondBestMustBeClearlyWorse) {
  Feature best = Seen(0, 1), second = Seen(0, -3);  // too far apart to be one corner
  best.descriptor = WithBits(best.descriptor, 20);
  second.descriptor = WithBits(second.descriptor, 23);
  EXPECT_THAT(Match({best, second}), IsEmpty());
  second.descriptor = WithBits(Seen(0).descriptor, 30);
  EXPECT_THAT(Match({second, best}), ElementsAre(LandmarkMatch{0, 1}));
}

TEST_F(ProjectionTest, TheSameCornerAtAnotherLevelIsNoRival) {
  Feature best = Seen(0, 1), twin = Seen(0, -1);
  best.descriptor = WithBits(best.descriptor, 20);
  twin.descriptor = WithBits(twin.descriptor, 23);
  twin.level = best.level + 1;
  EXPECT_THAT(Match({best, twin}), ElementsAre(LandmarkMatch{0, 0}));
}

TEST_F(ProjectionTest, AFeatureGoesToTheLandmarkMostLikeIt) {
  map_.landmarks[1] = map_.landmarks[0];
  map_.landmarks[1].descriptor = WithBits(map_.landmarks[0].descriptor, 10);
  EXPECT_THAT(Match({Seen(1)}), ElementsAre(LandmarkMatch{1, 0}));
  EXPECT_THAT(Match({Seen(0)}), ElementsAre(LandmarkMatch{0, 0}));
}

TEST_F(ProjectionTest, WhatCannotBeSeenIsNotLookedFor) {
  const Feature feature = Seen(0);
  camera_from_map_ = {RotationExp({0, M_PI, 0}), {0, 0, 0}};  // behind the camera
  EXPECT_THAT(Match({feature}), IsEmpty());
  // Past it and looking back: seen from the other side.
  camera_from_map_ = Rigid3{RotationExp({0, M_PI, 0}), {0, 0, 40}}.Inverse();
  EXPECT_THAT(Match({Seen(0)}), IsEmpty());
  // From more than twice the largest distance it was seen from, and from less than half the least.
  camera_from_map_ = Rigid3{Eigen::Quaterniond::Identity(), {0, 0, -21}}.Inverse();
  Feature far = Seen(0);
  far.level = 0;
  EXPECT_THAT(Match({far}), IsEmpty());
  camera_from_map_ = Rigid3{Eigen::Quaterniond::Identity(), {0, 0, 10.5}}.Inverse();
  Feature near = Seen(0);
  near.level = 6;
  EXPECT_THAT(Match({near}), IsEmpty());
}

TEST_F(ProjectionTest, WithoutFeaturesOrLandmarksThereIsNothing) {
  EXPECT_THAT(Match({}), IsEmpty());
  const std::vector<Feature> features = {Seen(0)};
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  EXPECT_THAT(MatchByProjection({}, {}, grid, kStreetRig, {}, {}), IsEmpty());
}

TEST(MatchByAppearance, FindsEachLandmarkInNoise) {
  StreetRandom random(6);
  MapSnapshot map;
  std::vector<Feature> features;
  for (uint32_t i = 0; i < 200; ++i) {
    map.landmarks.push_back({.descriptor = random.RandomDescriptor()});
    features.push_back({.descriptor = map.landmarks[i].descriptor});
    FlipBits(15, random, features[i].descriptor);
  }
  std::vector<uint32_t> idxs(200);
  std::iota(idxs.begin(), idxs.end(), 0u);
  const auto matches = MatchByAppearance(map, idxs, features);
  EXPECT_EQ(matches.size(), 200u);
  for (const LandmarkMatch& match : matches) EXPECT_EQ(match.landmark_idx, match.feature_idx);
}

TEST(MatchByAppearance, RefusesWhatIsFarOrNotClear) {
  StreetRandom random(7);
  const Descriptor descriptor = random.RandomDescriptor();
  const MapSnapshot map{.landmarks = {{.descriptor = descriptor}}};
  const Feature at_20{.x_px = 100, .descriptor = WithBits(descriptor, 20)};
  const Feature at_23{.descriptor = WithBits(descriptor, 23)};
  const Feature at_38{.descriptor = WithBits(descriptor, 38)};
  const Feature at_39{.descriptor = WithBits(descriptor, 39)};
  EXPECT_EQ(MatchByAppearance(map, {0}, {at_38}).size(), 1u);
  EXPECT_THAT(MatchByAppearance(map, {0}, {at_39}), IsEmpty());
  EXPECT_THAT(MatchByAppearance(map, {0}, {at_20, at_23}), IsEmpty());
  EXPECT_THAT(MatchByAppearance(map, {0}, {at_38, at_20}), ElementsAre(LandmarkMatch{0, 1}));
  EXPECT_THAT(MatchByAppearance(map, {0}, {}), IsEmpty());
}

TEST(MatchByAppearance, GivesAFeatureToOneLandmarkOnly) {
  StreetRandom random(8);
  const Descriptor descriptor = random.RandomDescriptor();
  const MapSnapshot map{.landmarks = {{.descriptor = WithBits(descriptor, 6)},
                                      {.descriptor = WithBits(descriptor, 3)},
                                      {.descriptor = WithBits(descriptor, 10)}}};
  EXPECT_THAT(MatchByAppearance(map, {0, 1, 2}, {{.descriptor = descriptor}}),
              ElementsAre(LandmarkMatch{1, 0}));
}

TEST(MeasurementsOf, AreTheFeaturesWithoutTheRigsBias) {
  StereoRig rig = kStreetRig;
  rig.disparity_bias.coefficients_px = {0.5, 0, 0};
  const MapSnapshot map{.landmarks = {{}, {.position_in_map = {1, 2, 3}}}};
  const std::vector<Feature> features = {{.x_px = 10, .y_px = 20, .level = 1},
                                         {.x_px = 30, .y_px = 40, .disparity_px = 5, .level = 3}};
  const auto measurements = MeasurementsOf(map, features, rig, {{1, 1}, {0, 0}});
  ASSERT_EQ(measurements.size(), 2u);
  EXPECT_EQ(measurements[0].position_in_map, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(measurements[0].px, Eigen::Vector2d(30, 40));
  EXPECT_NEAR(measurements[0].disparity_px, 4.5, 1e-12);
  EXPECT_NEAR(measurements[0].scale, std::pow(1.2, 3), 1e-12);
  EXPECT_LT(measurements[1].disparity_px, 0);
}

}  // namespace
}  // namespace carmap
