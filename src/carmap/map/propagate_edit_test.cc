#include "carmap/map/propagate_edit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

namespace carmap {
namespace {

using ::testing::IsEmpty;

constexpr DriveId kDrive{7}, kOtherDrive{9};
const Rigid3 kMove{RotationExp({0, 0.3, 0}), {5, 0, 1}}, kSmallMove{RotationExp({0.1, 0, 0}), {}};

Keyframe KeyframeAt(KeyframeId id, double z) {
  Keyframe keyframe{.id = id};
  keyframe.map_from_camera.translation.z() = z;
  keyframe.features = std::make_shared<const std::vector<Feature>>(3);
  return keyframe;
}

/// Keyframes 10, 20, 30, 40 of a drive and 5 of another, each with a landmark one metre ahead.
/// Landmark 10 is seen by keyframe 30 as well.
Map MakeMap() {
  MapEdit edit;
  for (const uint32_t index : {10u, 20u, 30u, 40u}) {
    edit.added_keyframes.push_back(KeyframeAt({kDrive, index}, index));
    edit.added_landmarks.push_back({.id = {kDrive, index},
                                    .position_in_map = {0, 0, index + 1.0},
                                    .observations = {{{kDrive, index}, 0}}});
  }
  edit.added_keyframes.push_back(KeyframeAt({kOtherDrive, 5}, 0));
  edit.added_landmarks.push_back({.id = {kOtherDrive, 5},
                                  .position_in_map = {0, 0, 1},
                                  .observations = {{{kOtherDrive, 5}, 0}}});
  edit.added_observations.push_back({{kDrive, 10}, {{kDrive, 30}, 1}});
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

/// The map after the propagated edit.
Map Propagated(const Map& before, const MapEdit& edit) {
  Map map = before;
  EXPECT_EQ(*Apply(PropagateEdit(map, edit), map), 0u);
  EXPECT_TRUE(CheckConsistency(map).ok());
  return map;
}

void ExpectMoved(const Map& before, const Map& after, uint32_t index, const Rigid3& move) {
  const KeyframeId keyframe{kDrive, index};
  const Rigid3 pose = move * before.Find(keyframe)->map_from_camera;
  EXPECT_LT((after.Find(keyframe)->map_from_camera.Inverse() * pose).translation.norm(), 1e-12);
  EXPECT_LT(
      RotationAngle(after.Find(keyframe)->map_from_camera.rotation.conjugate() * pose.rotation),
      1e-7);
}
void ExpectLandmarkMoved(const Map& before, const Map& after, uint32_t index, const Rigid3& move) {
  const LandmarkId landmark{kDrive, index};
  EXPECT_LT((after.Find(landmark)->position_in_map - move * before.Find(landmark)->position_in_map)
                .norm(),
            1e-12);
}

TEST(PropagateEdit, MovesKeyframesAndLandmarksAsTheMovedOneBefore) {
  const Map before = MakeMap();
  MapEdit edit{.base_version = before.version()};
  for (const auto& [index, move] : {std::pair(20u, kMove), std::pair(30u, kSmallMove)}) {
    const KeyframeId id{kDrive, index};
    edit.moved_keyframes.push_back({id, move * before.Find(id)->map_from_camera});
  }
  const Map after = Propagated(before, edit);
  ExpectMoved(before, after, 10, kMove);  // none before it
  ExpectMoved(before, after, 20, kMove);
  ExpectMoved(before, after, 30, kSmallMove);
  ExpectMoved(before, after, 40, kSmallMove);
  for (const uint32_t index : {10u, 20u}) ExpectLandmarkMoved(before, after, index, kMove);
  for (const uint32_t index : {30u, 40u}) ExpectLandmarkMoved(before, after, index, kSmallMove);
}

TEST(PropagateEdit, LeavesWhatTheEditMovesItselfAndOtherDrives) {
  const Map before = MakeMap();
  MapEdit edit{.base_version = before.version()};
  edit.moved_keyframes.push_back({{kDrive, 10}, kMove});
  edit.moved_landmarks.push_back({{kDrive, 20}, {1, 2, 3}});
  const Map after = Propagated(before, edit);
  EXPECT_EQ(after.Find(LandmarkId{kDrive, 20})->position_in_map, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(after.Find(KeyframeId{kOtherDrive, 5})->map_from_camera.translation.z(), 0);
  EXPECT_EQ(after.Find(LandmarkId{kOtherDrive, 5})->position_in_map.z(), 1);
}

// What was improved since the edit was worked out keeps its new place among its neighbours.
TEST(PropagateEdit, TakesAlongWhatMovedSinceTheEditsVersion) {
  Map map = MakeMap();
  MapEdit edit{.base_version = map.version()};
  for (const uint32_t index : {20u, 30u}) {
    const KeyframeId id{kDrive, index};
    edit.moved_keyframes.push_back({id, kMove * map.Find(id)->map_from_camera});
    edit.moved_landmarks.push_back({{kDrive, index}, kMove * Eigen::Vector3d(0, 0, index + 1.0)});
  }
  const Rigid3 improved{RotationExp({0, 0.01, 0}), {0.2, 0, 30}};
  EXPECT_EQ(*Apply({.base_version = map.version(),
                    .moved_keyframes = {{{kDrive, 30}, improved}},
                    .moved_landmarks = {{{kDrive, 30}, {0.2, 0, 31}}}},
                   map),
            0u);
  const Map before = map;
  const Map after = Propagated(before, edit);
  for (const uint32_t index : {20u, 30u, 40u}) {
    ExpectMoved(before, after, index, kMove);
    ExpectLandmarkMoved(before, after, index, kMove);
  }
}

TEST(PropagateEdit, AnEditOfPosesErasedSinceMovesNothing) {
  const Map map = MakeMap();
  MapEdit edit;
  edit.moved_keyframes.push_back({{kDrive, 99}, kMove});
  EXPECT_THAT(PropagateEdit(map, edit).moved_landmarks, IsEmpty());
  EXPECT_THAT(PropagateEdit(Map(), edit).moved_landmarks, IsEmpty());
}

}  // namespace
}  // namespace carmap
