#include "carmap/slam/link_matches.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

namespace carmap {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr DriveId kDrive{7};
constexpr KeyframeId kFirst{kDrive, 1}, kSecond{kDrive, 2};
constexpr LandmarkId kOlder{kDrive, 10}, kNewer{kDrive, 11};

/// Two features this far apart, at these levels.
Keyframe KeyframeOf(KeyframeId id, float apart_px, uint8_t level) {
  Keyframe keyframe{.id = id};
  keyframe.features = std::make_shared<const std::vector<Feature>>(std::vector<Feature>{
      {.x_px = 100, .y_px = 50}, {.x_px = 100 + apart_px, .y_px = 50, .level = level}});
  return keyframe;
}

/// The second keyframe sees the newer landmark as its first feature. The first one sees the older
/// and, if it sees both, the newer one as its features.
Map MakeMap(bool sees_both, float apart_px, uint8_t level) {
  MapEdit edit;
  edit.added_keyframes = {KeyframeOf(kFirst, apart_px, level), KeyframeOf(kSecond, 9, 0)};
  edit.added_landmarks = {{.id = kOlder, .observations = {{kFirst, 0}}},
                          {.id = kNewer, .observations = {{kSecond, 0}}}};
  if (sees_both) edit.added_observations = {{kNewer, {kFirst, 1}}};
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

/// What it means that the older landmark was matched with the newer one's feature.
MapEdit LinkOne(const Map& map) {
  MapSnapshot snapshot;
  snapshot.landmarks.emplace_back().id = kOlder;
  MapEdit edit{.base_version = map.version()};
  LinkMatches(map, snapshot, kSecond, {{0, 0}}, edit);
  EXPECT_THAT(edit.added_observations, IsEmpty());
  return edit;
}

TEST(LinkMatches, ACornerOfAnotherLandmarkShowsThatTheTwoAreOne) {
  const MapEdit edit = LinkOne(MakeMap(false, 9, 0));
  ASSERT_THAT(edit.merges, SizeIs(1));
  EXPECT_EQ(edit.merges[0].from, kNewer);
  EXPECT_EQ(edit.merges[0].into, kOlder);
}

TEST(LinkMatches, LandmarksThatAKeyframeSeesSideBySideAreTwo) {
  EXPECT_THAT(LinkOne(MakeMap(true, 9, 0)).merges, IsEmpty());
}

TEST(LinkMatches, OneCornerAtTwoLevelsIsNotSideBySide) {
  EXPECT_THAT(LinkOne(MakeMap(true, 2, 3)).merges, SizeIs(1));
}

}  // namespace
}  // namespace carmap
