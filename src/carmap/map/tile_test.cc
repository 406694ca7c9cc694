#include "carmap/map/tile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr TileId kTile{3, 0x4797064e40000000};

/// The first 40 m of a street, of which the last keyframes belong to the next tile.
Tile FirstVersion() {
  Tile tile{kTile, 1,
            MapStreet(MakeStreet(5, 60), {7}, kStreetRig, DriveAlong(0, 0, 40), Rigid3())};
  for (size_t i = tile.map.keyframes.size() - 5; i < tile.map.keyframes.size(); ++i) {
    tile.map.keyframes[i].is_stub = true;
  }
  return tile;
}

/// What another drive adds to it: a keyframe, the landmarks that it is the first to see, and its
/// view of others.
Tile SecondVersion() {
  Tile tile = FirstVersion();
  tile.version = 2;
  LeanMap& map = tile.map;
  map.drives.push_back({{9}, kStreetRig});
  LeanKeyframe added = map.keyframes[4];
  added.id = {{9}, 0};
  added.map_from_camera.translation.x() += 3;
  map.keyframes.push_back(added);
  const auto added_idx = static_cast<uint32_t>(map.keyframes.size() - 1);
  for (size_t i = 0; i < map.landmarks.size(); i += 3) {
    map.landmarks[i].keyframe_idxs.push_back(added_idx);
    map.landmarks[i].position_in_map.y() += 0.125;
  }
  for (uint32_t i = 0; i < 5; ++i) {
    LeanLandmark landmark;
    landmark.id = {{9}, i};
    landmark.position_in_map = {2, 0.5 * i, 20};
    landmark.keyframe_idxs = {3, added_idx};
    landmark.anchor_idx = added_idx;
    map.landmarks.push_back(landmark);
  }
  map.landmarks.erase(map.landmarks.begin() + 1);
  return tile;
}

void ExpectSame(const Tile& a, const Tile& b) {
  EXPECT_EQ(a.version, b.version);
  const Patch difference = DifferenceOf(a, b);
  EXPECT_THAT(difference.put.keyframes, IsEmpty());
  EXPECT_THAT(difference.put.landmarks, IsEmpty());
  EXPECT_THAT(difference.put.drives, IsEmpty());
  EXPECT_THAT(difference.removed_keyframes, IsEmpty());
  EXPECT_THAT(difference.removed_landmarks, IsEmpty());
  EXPECT_EQ(a.map.drives.size(), b.map.drives.size());
}

TEST(Patch, MakesOneVersionOfTheOther) {
  const Tile first = FirstVersion(), second = SecondVersion();
  const auto forth = Applied(DifferenceOf(first, second), first);
  ASSERT_TRUE(forth.ok()) << forth.status();
  ExpectSame(*forth, second);

  Patch back = DifferenceOf(second, first);
  back.to_version = 3;
  auto again = Applied(back, second);
  ASSERT_TRUE(again.ok()) << again.status();
  again->version = 1;
  ExpectSame(*again, first);
}

TEST(Patch, HoldsWhatChangedAlone) {
  const Tile first = FirstVersion(), second = SecondVersion();
  const Patch patch = DifferenceOf(first, second);
  EXPECT_THAT(patch.removed_landmarks, ElementsAre(first.map.landmarks[1].id));
  const size_t changed = (first.map.landmarks.size() + 2) / 3 + 5;
  EXPECT_EQ(patch.put.landmarks.size(), changed);
  EXPECT_LT(patch.put.keyframes.size(), second.map.keyframes.size() + 1);
  ExpectSame(first, first);
}

TEST(Patch, MovesLandmarksWithTheirAnchors) {
  const Tile first = FirstVersion();
  Tile moved = first;
  moved.version = 2;
  const Rigid3 nudge{RotationExp({0, 0.01, 0}), {0.1, 0, -0.2}};
  moved.map = Moved(first.map, nudge);
  Patch patch = DifferenceOf(first, moved);
  EXPECT_EQ(patch.put.keyframes.size(), first.map.keyframes.size());
  EXPECT_THAT(patch.put.landmarks, IsEmpty()) << "they ride";
  const auto applied = Applied(patch, first);
  ASSERT_TRUE(applied.ok()) << applied.status();
  for (size_t i = 0; i < moved.map.landmarks.size(); ++i) {
    EXPECT_LT(
        (applied->map.landmarks[i].position_in_map - moved.map.landmarks[i].position_in_map).norm(),
        1e-9);
  }
}

TEST(Patch, LeavesNothingThatNothingRefersTo) {
  const Tile first = FirstVersion();
  Patch patch{.tile = kTile, .from_version = 1, .to_version = 2};
  for (const LeanLandmark& landmark : first.map.landmarks) {
    if (first.map.keyframes[landmark.keyframe_idxs.back()].is_stub) {
      patch.removed_landmarks.push_back(landmark.id);
    }
  }
  const auto applied = Applied(patch, first);
  ASSERT_TRUE(applied.ok()) << applied.status();
  EXPECT_EQ(applied->map.keyframes.size(), first.map.keyframes.size() - 5);
}

TEST(Patch, IsRefusedWhereItDoesNotFit) {
  const Tile first = FirstVersion(), second = SecondVersion();
  const Patch patch = DifferenceOf(first, second);
  const auto message_of = [](const Patch& bad, const Tile& tile) {
    return std::string(Applied(bad, tile).status().message());
  };
  EXPECT_THAT(message_of(patch, second), HasSubstr("from version 1 to 2, the tile has version 2"));
  Patch bad = patch;
  bad.tile.cell = 1;
  EXPECT_THAT(message_of(bad, first), HasSubstr("another tile"));
  bad = patch;
  bad.removed_landmarks.push_back({{7}, 999999});
  EXPECT_THAT(message_of(bad, first), HasSubstr("removes 2 landmarks of which the tile has 1"));
  bad = {.tile = kTile, .from_version = 1, .to_version = 2};
  bad.removed_keyframes = {first.map.keyframes[2].id};
  EXPECT_THAT(message_of(bad, first), HasSubstr("removes a keyframe that a landmark still names"));
  bad = patch;
  bad.put.landmarks[0].position_in_map.x() = 1.0 / 0.0;
  EXPECT_THAT(message_of(bad, first), HasSubstr("not finite"));
}

}  // namespace
}  // namespace carmap
