#include "carmap/eval/street_change_score.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

const ChangedThing kBillboard{"billboard-1", false, {10, 5, 0}, M_PI / 2, {4, 1, 3}};
const ChangedThing kContainer{"new-container-1", true, {20, -5, 0}, 0, {6, 2, 2}};

LeanMap MapOf(const std::vector<Eigen::Vector3d>& places, uint32_t first_index = 0) {
  LeanMap map;
  map.drives = {{{1, 1}, kStreetRig}};
  map.keyframes = {{{{1, 1}, 0}, {}, {}, {}}};
  for (const Eigen::Vector3d& place : places) {
    LeanLandmark& landmark = map.landmarks.emplace_back();
    landmark.id = {{1, 1}, first_index++};
    landmark.position_in_map = place;
    landmark.keyframe_idxs = {0};
  }
  return map;
}

TEST(StreetChangeScore, KnowsWhatIsOnAThing) {
  EXPECT_TRUE(IsOn(kBillboard, {10, 6.9, 2.9}, 0)) << "its length lies along y";
  EXPECT_FALSE(IsOn(kBillboard, {11.9, 5, 1}, 0));
  EXPECT_TRUE(IsOn(kBillboard, {10.9, 5, 1}, 0.5));
  EXPECT_FALSE(IsOn(kBillboard, {10, 5, 4}, 0.5));
}

TEST(StreetChangeScore, CountsWhatIsLeftLostAndNew) {
  const LeanMap before = MapOf({{10, 5, 1}, {10, 6, 1}, {30, 5, 1}, {40, 5, 1}});
  LeanMap after = before;
  after.landmarks.erase(after.landmarks.begin() + 2);  // one that stands
  after.landmarks.erase(after.landmarks.begin());      // one of the billboard
  const LeanMap news = MapOf({{20, -5, 1}, {21, -5, 1}, {50, 0, 0}}, 10);
  after.landmarks.insert(after.landmarks.end(), news.landmarks.begin(), news.landmarks.end());
  const LeanMap fresh = MapOf({{20, -5, 1}, {21, -5, 1}, {22, -5, 1}});
  const StreetChangeScore score =
      ScoreStreetChanges({kBillboard, kContainer}, {before, {}}, {after, {}}, {{fresh, {}}});
  ASSERT_EQ(score.things.size(), 2u);
  EXPECT_EQ(score.removed_before(), 2u);
  EXPECT_EQ(score.removed_left(), 1u);
  EXPECT_EQ(score.things[1].after, 2u);
  EXPECT_EQ(score.things[1].fresh, 3u);
  EXPECT_EQ(score.standing, 2u);
  EXPECT_EQ(score.standing_lost, 1u);
}

TEST(StreetChangeScore, ReadsWhatTheSimulatorWrote) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "street_change_score_test";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "world.json")
      << R"({"options": {"changes": [{"what": "removed", "name": "kiosk-3", "kind": "kiosk",
             "position_in_enu": [1, 2, 3], "heading_rad": 0.5, "size_m": [2, 2, 3]}]}})";
  const auto things = ReadChangedThings(folder);
  ASSERT_TRUE(things.ok()) << things.status();
  ASSERT_EQ(things->size(), 1u);
  EXPECT_EQ(things->front().name, "kiosk-3");
  EXPECT_FALSE(things->front().is_added);
  std::ofstream(folder / "world.json") << "{}";
  EXPECT_TRUE(absl::IsInvalidArgument(ReadChangedThings(folder).status()));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace carmap
