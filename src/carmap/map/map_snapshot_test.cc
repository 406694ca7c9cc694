#include "carmap/map/map_snapshot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "carmap/map/map_edit.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr DriveId kDrive{7};

KeyframeId Frame(uint32_t index) { return {kDrive, index}; }
LandmarkId Mark(uint32_t index) { return {kDrive, index}; }

TEST(DeriveVisibility, FollowsFromWhereTheLandmarkWasSeen) {
  SnapshotLandmark landmark{.position_in_map = {0, 0, 10}};
  DeriveVisibility({{0, 0, 0}, {0, 0, 6}, {0, 3, 6}}, {0, 0, 0}, 2, landmark);
  EXPECT_FLOAT_EQ(landmark.min_distance_m, 4);
  EXPECT_FLOAT_EQ(landmark.max_distance_m, 10);
  const Eigen::Vector3f mean = Eigen::Vector3f(0, 0.6f, -2.8f).normalized();
  EXPECT_LT((landmark.direction_to_viewers - mean).norm(), 1e-6f);
  EXPECT_NEAR(PredictLevel(landmark, 10), 2, 1e-5) << "the level of its first viewer, there";
}

TEST(DeriveVisibility, StaysFiniteWhereAViewerStandsOnTheLandmark) {
  SnapshotLandmark landmark{.position_in_map = {1, 2, 3}};
  DeriveVisibility({{1, 2, 3}}, {1, 2, 3}, 0, landmark);
  EXPECT_TRUE(landmark.direction_to_viewers.allFinite());
  EXPECT_TRUE(std::isfinite(landmark.level_at_1m));
  EXPECT_GT(landmark.max_distance_m, 0);
}

TEST(DeriveVisibility, StaysFiniteWhereViewersStandOpposite) {
  SnapshotLandmark landmark;
  DeriveVisibility({{0, 0, 1}, {0, 0, -1}}, {0, 0, 1}, 0, landmark);
  EXPECT_TRUE(landmark.direction_to_viewers.allFinite());
}

TEST(PredictLevel, FallsByOneForEachScaleOfDistance) {
  SnapshotLandmark landmark;
  DeriveVisibility({{0, 0, 20}}, {0, 0, 20}, 3, landmark);
  EXPECT_NEAR(PredictLevel(landmark, 20 * kLevelScale), 2, 1e-5);
  EXPECT_NEAR(PredictLevel(landmark, 20 / kLevelScale), 4, 1e-5);
  EXPECT_NEAR(PredictLevel(landmark, 1), landmark.level_at_1m, 1e-6);
}

class SnapshotOfTest : public ::testing::Test {
 protected:
  SnapshotOfTest() {
    MapEdit edit;
    for (const uint32_t index : {1u, 2u, 3u}) {
      Keyframe& keyframe = edit.added_keyframes.emplace_back();
      keyframe.id = Frame(index);
      keyframe.timestamp.ns = 10 * index;
      keyframe.map_from_camera.translation.z() = index;
      keyframe.gps = GpsFix{49, 8, 100.0 + index};
      std::vector<Feature> features(4);
      for (size_t i = 0; i < 4; ++i) features[i].level = static_cast<uint8_t>(i + index);
      keyframe.features = std::make_shared<const std::vector<Feature>>(features);
    }
    Descriptor descriptor;
    descriptor.words[1] = 77;
    edit.added_landmarks = {
        {Mark(30), {0, 0, 11}, descriptor, {{Frame(1), 1}, {Frame(2), 0}, {Frame(3), 3}}},
        {Mark(20), {0, 0, 12}, {}, {{Frame(2), 2}}},
        {Mark(10), {0, 0, 13}, {}, {{Frame(3), 2}}},
        {Mark(40), {0, 0, 14}, {}, {{Frame(1), 0}}}};
    EXPECT_EQ(*Apply(edit, map_), 0u);
  }

  Map map_;
};

TEST_F(SnapshotOfTest, HoldsTheKeyframesAndAllThatTheySee) {
  const MapSnapshot snapshot = SnapshotOf(map_, {Frame(1), Frame(2)});
  EXPECT_EQ(snapshot.version, map_.version());
  ASSERT_EQ(snapshot.keyframes.size(), 2u);
  ASSERT_EQ(snapshot.landmarks.size(), 3u);
  EXPECT_EQ(snapshot.landmarks[0].id, Mark(20));
  EXPECT_EQ(snapshot.landmarks[1].id, Mark(30));
  EXPECT_EQ(snapshot.landmarks[2].id, Mark(40));
  EXPECT_THAT(snapshot.keyframes[0].landmark_idxs, ElementsAre(1, 2));
  EXPECT_THAT(snapshot.keyframes[1].landmark_idxs, ElementsAre(0, 1));
  EXPECT_EQ(snapshot.keyframes[1].id, Frame(2));
  EXPECT_EQ(snapshot.keyframes[1].timestamp.ns, 20);
  EXPECT_EQ(snapshot.keyframes[1].map_from_camera.translation.z(), 2);
  ASSERT_TRUE(snapshot.keyframes[1].gps);
  EXPECT_EQ(snapshot.landmarks[1].position_in_map.z(), 11);
  EXPECT_EQ(snapshot.landmarks[1].descriptor.words[1], 77u);
}

TEST_F(SnapshotOfTest, DerivesVisibilityFromAllViewersAlsoThoseOutside) {
  const SnapshotLandmark landmark = SnapshotOf(map_, {Frame(2)}).landmarks.at(1);
  EXPECT_EQ(landmark.id, Mark(30));
  EXPECT_FLOAT_EQ(landmark.max_distance_m, 10);  // from keyframe 1
  EXPECT_FLOAT_EQ(landmark.min_distance_m, 8);   // from keyframe 3
  EXPECT_NEAR(PredictLevel(landmark, 10), 2, 1e-5) << "feature 1 of keyframe 1";
  EXPECT_LT((landmark.direction_to_viewers - Eigen::Vector3f(0, 0, -1)).norm(), 1e-6f);
}

TEST_F(SnapshotOfTest, DoesNotChangeWithTheMap) {
  const MapSnapshot snapshot = SnapshotOf(map_, {Frame(3)});
  ASSERT_TRUE(Apply({.base_version = 1, .removed_landmarks = {Mark(10), Mark(30)}}, map_).ok());
  EXPECT_EQ(snapshot.landmarks.size(), 2u);
  EXPECT_EQ(snapshot.landmarks[0].id, Mark(10));
}

TEST_F(SnapshotOfTest, OfNoKeyframesIsEmpty) {
  const MapSnapshot snapshot = SnapshotOf(map_, {});
  EXPECT_THAT(snapshot.keyframes, IsEmpty());
  EXPECT_THAT(snapshot.landmarks, IsEmpty());
}

}  // namespace
}  // namespace carmap
