#include "carmap/ingest/contribute.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "carmap/ingest/revert.h"
#include "carmap/ingest/test_base.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using ContributeTest = BaseTest;

TEST_F(ContributeTest, BeginsWithTheFirstSegment) {
  const Street street = MakeStreet(3, 330);
  const LeanMap segment = MapOf(street, {.to_m = 300});
  const Contribution made = Add(segment);
  EXPECT_TRUE(made.is_new_component);
  EXPECT_EQ(made.component, 1u);
  EXPECT_EQ(made.sequence, 1u);
  EXPECT_GE(made.tiles.size(), 3u);
  const MapView whole = Whole(1);
  EXPECT_TRUE(whole.grid().is_on_earth);
  ASSERT_EQ(whole.map().keyframes.size(), segment.keyframes.size());
  ASSERT_EQ(whole.map().landmarks.size(), segment.landmarks.size());
  for (size_t i = 0; i < segment.keyframes.size(); ++i) {
    EXPECT_LT((EcefFromEnu(*whole.map().keyframes[i].gps).translation -
               EcefFromEnu(*segment.keyframes[i].gps).translation)
                  .norm(),
              0.3);
  }
  const Rigid3 view_from_segment =
      whole.map().keyframes[0].map_from_camera * segment.keyframes[0].map_from_camera.Inverse();
  for (size_t i = 0; i < segment.landmarks.size(); ++i) {
    EXPECT_LT((whole.map().landmarks[i].position_in_map -
               view_from_segment * segment.landmarks[i].position_in_map)
                  .norm(),
              0.01);
  }
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, MergesWhatBothSaw) {
  const Street street = MakeStreet(3, 330);
  const Contribution first = Add(MapOf(street, {.id = 1, .to_m = 200}));
  const LeanMap segment =
      MapOf(street, {.id = 2, .from_m = 100, .to_m = 300, .lane_m = 0.5, .gps_error = {4, -3, 2}});
  const Contribution second = Add(segment);
  EXPECT_FALSE(second.is_new_component);
  EXPECT_EQ(second.component, 1u);
  ASSERT_TRUE(second.fit);
  EXPECT_LT(second.keyframes_added, segment.keyframes.size() * 6 / 10);
  EXPECT_LT(second.landmarks_added, segment.landmarks.size() * 7 / 10);
  const MapView whole = Whole(1);
  EXPECT_TRUE(CheckConsistency(whole.map()).ok());
  EXPECT_EQ(whole.map().landmarks.size(),
            first.landmarks + second.landmarks_added - second.landmarks_replaced);
  EXPECT_EQ(whole.map().keyframes.size(), first.keyframes + second.keyframes_added);
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, TouchesTheTilesAroundAlone) {
  const Street street = MakeStreet(3, 1030);
  const Contribution first = Add(MapOf(street, {.id = 1, .to_m = 1000}));
  const Contribution second = Add(MapOf(street, {.id = 2, .from_m = 20, .to_m = 80}));
  EXPECT_GE(first.tiles.size(), 7u);
  EXPECT_LE(second.tiles.size(), 3u);
  for (const TileVersion& tile : second.tiles) EXPECT_EQ(tile.version, 2u);
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, TakesADriveOnce) {
  const Street street = MakeStreet(3, 130);
  const LeanMap segment = MapOf(street, {});
  Add(segment);
  const auto before = AllTiles();
  const auto again = Contribute(segment, "again", *base_);
  EXPECT_TRUE(absl::IsAlreadyExists(again.status())) << again.status();
  EXPECT_EQ(AllTiles().size(), before.size());
  EXPECT_EQ(Log().size(), 1u);
}

TEST_F(ContributeTest, FindsASegmentWithoutGpsByWords) {
  const Street street = MakeStreet(3, 430);
  Add(MapOf(street, {.id = 1, .to_m = 400, .has_gps = false}));
  EXPECT_FALSE(base_->Components()->front().grid.is_on_earth);
  const Contribution second =
      Add(MapOf(street, {.id = 2, .from_m = 230, .to_m = 330, .has_gps = false}));
  EXPECT_FALSE(second.is_new_component);
  EXPECT_THAT(second.joined, IsEmpty());
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, KeepsApartWhatDoesNotTouchAndJoinsItLater) {
  const Street street = MakeStreet(3, 430);
  const Contribution first = Add(MapOf(street, {.id = 1, .to_m = 120}));
  const Contribution second = Add(MapOf(street, {.id = 2, .from_m = 220, .to_m = 330}));
  EXPECT_TRUE(second.is_new_component);
  EXPECT_EQ(second.component, 2u);
  const Contribution third = Add(MapOf(street, {.id = 3, .from_m = 60, .to_m = 280}));
  EXPECT_EQ(third.component, 1u);
  EXPECT_THAT(third.joined, ElementsAre(2));
  EXPECT_EQ(base_->Components()->size(), 1u);
  EXPECT_THAT(Tiles(2), IsEmpty());
  const MapView whole = Whole(1);
  EXPECT_TRUE(CheckConsistency(whole.map()).ok());
  EXPECT_GT(whole.map().keyframes.size(), first.keyframes + second.keyframes);
  // One road: keyframes stand where the street has them, from one end to the other.
  const auto& keyframes = whole.map().keyframes;
  const auto key = [](const LeanKeyframe& k) { return k.map_from_camera.translation.z(); };
  const auto [south, north] =
      std::minmax_element(keyframes.begin(), keyframes.end(),
                          [&](const auto& a, const auto& b) { return key(a) < key(b); });
  EXPECT_NEAR(key(*north) - key(*south), 330, 1.5);
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, TakesEachPartOfADriveOnceInAnyOrder) {
  const Street street = MakeStreet(3, 330);
  const LeanMap base = MapOf(street, {.id = 1, .to_m = 300});
  Add(base);
  const MapDiff first = DiffOf(MapOf(street, {.id = 2, .from_m = 20, .to_m = 120}), 1, 0);
  const MapDiff second = DiffOf(MapOf(street, {.id = 2, .from_m = 120, .to_m = 220}), 1, 1);
  const auto add = [&](const MapDiff& diff) {
    const auto made = Contribute(diff, "diff", *base_);
    EXPECT_TRUE(made.ok()) << made.status();
  };
  add(first);
  add(second);
  const auto tiles = AllTiles();
  EXPECT_TRUE(absl::IsAlreadyExists(Contribute(first, "again", *base_).status()));
  EXPECT_EQ(AllTiles().size(), tiles.size());
  EXPECT_EQ(Log().size(), 3u);
  const LeanMap in_order = Whole(1).map();
  ExpectPatchesLeadToTiles();

  base_ = BaseMap::Over(MakeMemoryStore(BaseMap::NewHeader()), "base").value();
  Add(base);
  add(second);
  add(first);
  const LeanMap reversed = Whole(1).map();
  // But for what few drives saw, which may make way, both have the same landmarks where they are.
  size_t both = 0, apart = 0;
  for (const LeanLandmark& landmark : in_order.landmarks) {
    const LeanLandmark* other = FindById(reversed.landmarks, landmark.id);
    if (other == nullptr) continue;
    ++both;
    apart += (other->position_in_map - landmark.position_in_map).norm() > 0.1;
  }
  EXPECT_LT(apart, both / 100);  // far ones, of which a disparity tells little
  EXPECT_GT(both, 9 * in_order.landmarks.size() / 10);
}

TEST_F(ContributeTest, FixesThatTellNoPlaceBeginNoComponentOnTheEarth) {
  const Street street = MakeStreet(3, 230);
  LeanMap scattered = MapOf(street, {.id = 1, .to_m = 200});
  StreetRandom random(5);
  for (LeanKeyframe& keyframe : scattered.keyframes) {
    const LocalEnu enu(*keyframe.gps);
    keyframe.gps = enu.ToGps({random.Normal(5), random.Normal(5), 0});
  }
  Add(scattered);
  EXPECT_FALSE(base_->Components()->front().grid.is_on_earth);
  // A drive that knows where it is takes it along.
  const Contribution second = Add(MapOf(street, {.id = 2, .from_m = 40, .to_m = 220}));
  EXPECT_EQ(second.component, 2u);
  EXPECT_THAT(second.joined, ElementsAre(1));
  ASSERT_EQ(base_->Components()->size(), 1u);
  EXPECT_TRUE(base_->Components()->front().grid.is_on_earth);
  EXPECT_THAT(Tiles(1), IsEmpty());
  EXPECT_GT(Whole(2).map().keyframes.size(), second.keyframes);
  ExpectPatchesLeadToTiles();
}

TEST_F(ContributeTest, GivesNoNumberOfAComponentTwice) {
  Add(MapOf(MakeStreet(3, 130), {.id = 1}));
  Add(MapOf(MakeStreet(4, 130), {.id = 2, .has_gps = false}));
  ASSERT_TRUE(Revert(ToHex(DriveId{2, 5}), *base_).ok());
  EXPECT_EQ(base_->Components()->size(), 1u);
  EXPECT_EQ(Add(MapOf(MakeStreet(5, 130), {.id = 3, .has_gps = false})).component, 3u);
}

TEST_F(ContributeTest, RefusesWhatContradictsTheBaseAndChangesNothing) {
  const Street street = MakeStreet(3, 230);
  Add(MapOf(street, {.id = 1, .to_m = 200}));
  LeanMap bent = MapOf(street, {.id = 2, .to_m = 200});
  // From its middle on the drive believes to turn aside, by a metre every ten.
  const auto error_m = [](const LeanKeyframe& keyframe) {
    return 0.1 * std::max(0.0, keyframe.map_from_camera.translation.z() - 100);
  };
  for (LeanLandmark& landmark : bent.landmarks) {
    landmark.position_in_map.x() += error_m(bent.keyframes[landmark.anchor_idx]);
  }
  for (LeanKeyframe& keyframe : bent.keyframes) {
    keyframe.map_from_camera.translation.x() += error_m(keyframe);
  }
  const auto made = Contribute(bent, "bent", *base_);
  EXPECT_TRUE(absl::IsFailedPrecondition(made.status())) << made.status();
  EXPECT_THAT(std::string(made.status().message()), HasSubstr("contradicts the base"));
  for (const TileVersion& tile : AllTiles()) EXPECT_EQ(tile.version, 1u);
  EXPECT_EQ(Log().size(), 1u);
}

TEST_F(ContributeTest, RefusesSuspectDrives) {
  LeanMap segment = MapOf(MakeStreet(3, 130), {});
  segment.drives[0].faults.set(static_cast<size_t>(DriveFault::kUnsynchronised));
  const auto made = Contribute(segment, "segment", *base_);
  EXPECT_TRUE(absl::IsFailedPrecondition(made.status()));
  EXPECT_THAT(std::string(made.status().message()), HasSubstr("suspect"));
  EXPECT_TRUE(Contribute(segment, "segment", *base_, {.accept_suspect = true}).ok());
}

TEST_F(ContributeTest, TellsInTheJournal) {
  const Street street = MakeStreet(3, 230);
  Add(MapOf(street, {.id = 1, .to_m = 120}));
  Add(MapOf(street, {.id = 2, .from_m = 60, .to_m = 200}));
  const auto log = Log();
  ASSERT_EQ(log.size(), 2u);
  EXPECT_EQ(log[1].kind, "add");
  EXPECT_EQ(log[1].name, "segment.cmap");
  EXPECT_THAT(log[1].drives, ElementsAre(ToHex({2, 5})));
  EXPECT_THAT(log[1].tiles, Not(IsEmpty()));
}

}  // namespace
}  // namespace carmap
