#include "carmap/slam/map_parts.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

namespace carmap {
namespace {

using ::testing::ElementsAre;

constexpr DriveId kDrive{7};

KeyframeId Frame(uint32_t index) { return {kDrive, index}; }

/// Keyframes 0 to 5, each 1 m on; landmarks link 0-1, 1-2 and 3-4.
Map MakeMap() {
  MapEdit edit;
  for (uint32_t i = 0; i < 6; ++i) {
    Keyframe keyframe{.id = Frame(i)};
    keyframe.map_from_camera.translation = {0, 0, 1.0 * i};
    keyframe.features = std::make_shared<const std::vector<Feature>>(4);
    edit.added_keyframes.push_back(keyframe);
  }
  const auto add = [&](uint32_t index, std::vector<Observation> observations) {
    edit.added_landmarks.push_back({.id = {kDrive, index},
                                    .position_in_map = {1, 2, 3},
                                    .observations = std::move(observations)});
  };
  add(0, {{Frame(0), 0}, {Frame(1), 0}});
  add(1, {{Frame(1), 1}, {Frame(2), 0}});
  add(2, {{Frame(3), 0}, {Frame(4), 0}});
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

TEST(ConnectedParts, AreThoseThatShareLandmarks) {
  EXPECT_THAT(ConnectedParts(MakeMap()),
              ElementsAre(ElementsAre(Frame(0), Frame(1), Frame(2)),
                          ElementsAre(Frame(3), Frame(4)), ElementsAre(Frame(5))));
  EXPECT_TRUE(ConnectedParts(Map()).empty());
}

TEST(MovePart, MovesWhatBeginsThere) {
  Map map = MakeMap();
  const Rigid3 moved{RotationExp({0, 0.5, 0}), {10, 0, 0}};
  const MapEdit edit = MovePart(map, Frame(3), moved);
  EXPECT_EQ(*Apply(edit, map), 0u);
  EXPECT_EQ(map.Find(Frame(2))->map_from_camera.translation, Eigen::Vector3d(0, 0, 2));
  EXPECT_EQ(map.Find(LandmarkId{kDrive, 1})->position_in_map, Eigen::Vector3d(1, 2, 3));
  for (const uint32_t i : {3, 4, 5}) {
    const Eigen::Vector3d expected = moved * Eigen::Vector3d(0, 0, i);
    EXPECT_LT((map.Find(Frame(i))->map_from_camera.translation - expected).norm(), 1e-12);
  }
  EXPECT_LT(
      (map.Find(LandmarkId{kDrive, 2})->position_in_map - moved * Eigen::Vector3d(1, 2, 3)).norm(),
      1e-12);
}

// A vehicle that speeds up evenly is where the mean of its speeds before and after puts it.
TEST(BridgeGap, IsExactAtConstantAcceleration) {
  const Rigid3 map_from_reference{RotationExp({0, 0.3, 0}), {5, 0, 2}};
  const auto step = [](double metres, double yaw) {
    return Rigid3{RotationExp({0, yaw, 0}), {0, 0, -metres}};
  };
  const Gap gap{.reference = Frame(0),
                .camera_from_reference = {},
                .motion_before = step(1.0, 0),
                .motion_before_s = 0.1,
                .duration_s = 2};
  const Rigid3 at_constant_speed = BridgeGap(gap, map_from_reference, step(1.0, 0), 0.1);
  EXPECT_LT((at_constant_speed.translation - map_from_reference * Eigen::Vector3d(0, 0, 20)).norm(),
            1e-9);
  const Rigid3 sped_up = BridgeGap(gap, map_from_reference, step(2.8, 0), 0.2);
  EXPECT_LT((sped_up.translation - map_from_reference * Eigen::Vector3d(0, 0, 24)).norm(), 1e-9);
  const Rigid3 turned = BridgeGap(gap, map_from_reference, step(0, 0.01), 0.1);
  EXPECT_NEAR(RotationAngle((map_from_reference.Inverse() * turned).rotation), 0.1, 1e-9);
}

TEST(BridgeGap, StaysWhereNoSpeedIsKnown) {
  const Rigid3 map_from_reference{RotationExp({0, 0.3, 0}), {5, 0, 2}};
  const Gap gap{.reference = Frame(0),
                .camera_from_reference = {Eigen::Quaterniond::Identity(), {0, 0, -1}},
                .duration_s = 2};
  EXPECT_LT((BridgeGap(gap, map_from_reference, {}, 0).translation -
             map_from_reference * Eigen::Vector3d(0, 0, 1))
                .norm(),
            1e-12);
}

}  // namespace
}  // namespace carmap
