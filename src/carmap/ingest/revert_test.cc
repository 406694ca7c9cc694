#include "carmap/ingest/revert.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "carmap/ingest/test_base.h"
#include "carmap/ingest/verify.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

class RevertTest : public BaseTest {
 protected:
  RevertTest() { Add(MapOf(street_, {.id = 1, .to_m = 300})); }

  std::map<TileId, uint64_t> Hashes() const {
    std::map<TileId, uint64_t> hashes;
    for (const TileVersion& tile : AllTiles()) {
      if (!tile.is_removed) hashes[tile.tile] = HashOf((*base_->Read(tile.tile))->map);
    }
    return hashes;
  }
  bool Mentions(DriveId drive) const {
    const MapView whole = Whole(1);
    return FindDrive(whole.map().drives, drive) != nullptr;
  }

  const Street street_ = MakeStreet(3, 430);
  const LeanMap second_ = MapOf(street_, {.id = 2, .from_m = 100, .to_m = 380, .lane_m = 1});
};

TEST_F(RevertTest, LeavesWhatWasThereBefore) {
  const auto before = Hashes();
  Add(second_);
  EXPECT_NE(Hashes(), before);
  const auto made = Revert(ToHex({2, 5}), *base_);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_GT(made->landmarks_restored, 100u);
  EXPECT_EQ(Hashes(), before);
  EXPECT_FALSE(Mentions({2, 5}));
  ExpectPatchesLeadToTiles();
  EXPECT_THAT(Verify(*base_, Mending::kNone)->problems, IsEmpty());
  EXPECT_EQ(Log().back().kind, "revert");
}

TEST_F(RevertTest, TakesAllPartsOfADriveBack) {
  const auto before = Hashes();
  for (uint32_t part = 0; part < 2; ++part) {
    const LeanMap drive =
        MapOf(street_, {.id = 4, .from_m = 20 + 100.0 * part, .to_m = 120 + 100.0 * part});
    ASSERT_TRUE(Contribute(DiffOf(drive, 1, part), "diff", *base_).ok());
  }
  EXPECT_NE(Hashes(), before);
  const auto made = Revert(ToHex({4, 5}), *base_);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(Hashes(), before);
  ExpectPatchesLeadToTiles();
  EXPECT_FALSE(Revert(ToHex({4, 5}), *base_).ok());
  // It may come again.
  const LeanMap drive = MapOf(street_, {.id = 4, .from_m = 20, .to_m = 120});
  EXPECT_TRUE(Contribute(DiffOf(drive, 1, 0), "diff", *base_).ok());
}

TEST_F(RevertTest, AsksForDigitsEnough) {
  EXPECT_EQ(Revert("", *base_).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Revert("00000", *base_).status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(RevertTest, TakesTheDriveAgainAfterwards) {
  Add(second_);
  const auto after_adding = Hashes();
  ASSERT_TRUE(Revert(ToHex({2, 5}), *base_).ok());
  Add(second_);
  EXPECT_EQ(Hashes(), after_adding);
  EXPECT_TRUE(Revert(ToHex({2, 5}), *base_).ok());
}

TEST_F(RevertTest, KeepsWhatOthersAddedLater) {
  Add(second_);
  Add(MapOf(street_, {.id = 3, .from_m = 200, .to_m = 420, .lane_m = 3}));
  const size_t landmarks = Whole(1).map().landmarks.size();
  const auto made = Revert(ToHex({2, 5}), *base_);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_TRUE(Mentions({1, 5}));
  EXPECT_TRUE(Mentions({3, 5}));
  const MapView whole = Whole(1);
  EXPECT_TRUE(CheckConsistency(whole.map()).ok());
  EXPECT_GT(whole.map().landmarks.size(), landmarks / 2);
  ExpectPatchesLeadToTiles();
  EXPECT_THAT(Verify(*base_, Mending::kNone)->problems, IsEmpty());
}

// What another drive added hangs on keyframes of the first, which stand for its own.
TEST_F(RevertTest, KeepsWhatHangsOnItsKeyframes) {
  const LeanMap same_lane = MapOf(street_, {.id = 4, .from_m = 50, .to_m = 250});
  Add(same_lane);
  const size_t of_other = [&] {
    const MapView whole = Whole(1);
    return static_cast<size_t>(
        std::count_if(whole.map().landmarks.begin(), whole.map().landmarks.end(),
                      [](const LeanLandmark& l) { return l.id.drive.input == 4; }));
  }();
  ASSERT_GT(of_other, 50u);
  const auto made = Revert(ToHex({1, 5}), *base_);
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_GT(made->keyframes_kept, 20u);
  const MapView whole = Whole(1);
  EXPECT_TRUE(CheckConsistency(whole.map()).ok());
  EXPECT_EQ(std::count_if(whole.map().landmarks.begin(), whole.map().landmarks.end(),
                          [](const LeanLandmark& l) { return l.id.drive.input == 4; }),
            static_cast<std::ptrdiff_t>(of_other));
  ExpectPatchesLeadToTiles();
  ASSERT_TRUE(Revert(ToHex({4, 5}), *base_).ok());
}

// Whatever the order, nothing is left of drives that were all taken back, but for keyframes that
// anchored what others saw.
TEST_F(RevertTest, BringsNothingBackThatWasTakenBack) {
  Add(second_);
  Add(MapOf(street_, {.id = 3, .from_m = 150, .to_m = 420}));
  for (const uint64_t id : {2, 1, 3}) {
    const auto made = Revert(ToHex({id, 5}), *base_);
    ASSERT_TRUE(made.ok()) << id << made.status();
  }
  size_t landmarks = 0;
  for (const TileVersion& tile : AllTiles()) {
    if (!tile.is_removed) landmarks += (*base_->Read(tile.tile))->map.landmarks.size();
  }
  EXPECT_EQ(landmarks, 0u);
  EXPECT_THAT(Tiles(1), IsEmpty());
}

TEST_F(RevertTest, EndsAComponentOfWhichNothingIsLeft) {
  ASSERT_TRUE(Revert(ToHex({1, 5}), *base_).ok());
  EXPECT_THAT(Tiles(1), IsEmpty());
  EXPECT_THAT(*base_->Components(), IsEmpty());
  EXPECT_EQ(Add(second_).component, 2u);
  ExpectPatchesLeadToTiles();
}

TEST_F(RevertTest, SaysWhichDrivesThereAre) {
  const auto unknown = Revert("777777", *base_);
  EXPECT_TRUE(absl::IsNotFound(unknown.status()));
  EXPECT_THAT(std::string(unknown.status().message()), HasSubstr("carmap base log"));
  Add(second_);
  EXPECT_TRUE(absl::IsInvalidArgument(Revert("000000", *base_).status()));
  ASSERT_TRUE(Revert(ToHex({2, 5}), *base_).ok());
  EXPECT_TRUE(absl::IsNotFound(Revert(ToHex({2, 5}), *base_).status()));
}

}  // namespace
}  // namespace carmap
