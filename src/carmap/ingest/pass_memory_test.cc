#include "carmap/ingest/pass_memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "carmap/ingest/revert.h"
#include "carmap/ingest/test_base.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

constexpr int64_t kDayS = 86'400, kFirstS = 1'790'000'000;

class PassMemoryTest : public BaseTest {
 protected:
  PassMemoryTest() {
    LeanMap first = MapOf(street_, {.id = 1, .to_m = 120});
    first.drives[0].unix_start = Timestamp::FromSeconds(kFirstS);
    Add(first);
  }

  /// Of the landmark, in the frame of its tile.
  using Look = std::function<Sighting(const LeanLandmark&)>;

  /// A drive on the day that passes and adds nothing; it has the tiles as they are now, or as
  /// `tiles` has them.
  MapDiff PassOf(uint64_t day, const Look& look,
                 std::vector<std::shared_ptr<const Tile>> tiles = {}) const {
    if (tiles.empty()) tiles = TilesNow();
    MapDiff diff;
    diff.frame = tiles.front()->id;
    diff.drive.drives = {{{100 + day, 5}, kStreetRig}};
    diff.drive.drives[0].unix_start =
        Timestamp::FromSeconds(static_cast<double>(kFirstS + kDayS * static_cast<int64_t>(day)));
    diff.drive.keyframes = {{{diff.drive.drives[0].id, 0}, {}, {}, {}}};
    for (const auto& tile : tiles) {
      TileSightings& sightings = diff.sightings.emplace_back();
      sightings.tile = tile->id;
      sightings.version = tile->version;
      for (const LeanLandmark& landmark : tile->map.landmarks) {
        sightings.of_landmarks.push_back(look(landmark));
      }
    }
    return diff;
  }
  std::vector<std::shared_ptr<const Tile>> TilesNow() const {
    std::vector<std::shared_ptr<const Tile>> tiles;
    for (const TileId& id : Tiles(1)) tiles.push_back(base_->Read(id).value());
    return tiles;
  }
  Contribution Take(const MapDiff& diff) {
    const auto made = Contribute(diff, "part", *base_);
    EXPECT_TRUE(made.ok()) << made.status();
    return made.value_or(Contribution{});
  }

  /// What stood within four metres of a corner that the first tile has.
  bool IsBillboard(const LeanLandmark& landmark) const {
    return (landmark.position_in_map - billboard_).norm() < 4;
  }
  Sighting WithoutBillboard(const LeanLandmark& landmark) const {
    return IsBillboard(landmark) ? Sighting::kSeenThrough : Sighting::kSeen;
  }
  size_t BillboardLeft() const {
    const auto& landmarks = TilesNow().front()->map.landmarks;
    return static_cast<size_t>(std::count_if(landmarks.begin(), landmarks.end(),
                                             [&](const auto& l) { return IsBillboard(l); }));
  }

  const Street street_ = MakeStreet(3, 160);
  Eigen::Vector3d billboard_;
  void SetUp() override {
    const auto& landmarks = TilesNow().front()->map.landmarks;
    billboard_ = landmarks[landmarks.size() / 2].position_in_map;
    ASSERT_GT(BillboardLeft(), 4u);
  }
};

TEST_F(PassMemoryTest, APassThatSeesWhatIsThereChangesNoTile) {
  const auto before = AllTiles();
  const Contribution made = Take(PassOf(1, [](const auto&) { return Sighting::kSeen; }));
  EXPECT_GT(made.seen, 100u);
  EXPECT_TRUE(made.tiles.empty());
  EXPECT_EQ(made.patch_bytes, 0u);
  for (size_t i = 0; i < before.size(); ++i) EXPECT_EQ(AllTiles()[i].version, before[i].version);
  const StoredEvidence stored = ReadEvidence(base_->reader(), Tiles(1).front()).value();
  EXPECT_EQ(stored.evidence.pass_count(), 2u) << "with the drive that mapped it";
}

TEST_F(PassMemoryTest, ABillboardGoesAfterSeveralDrives) {
  const size_t at_first = BillboardLeft();
  const auto seen = [](const auto&) { return Sighting::kSeen; };
  for (uint64_t day = 1; day <= 3; ++day) Take(PassOf(day, seen));
  const auto look = [&](const LeanLandmark& landmark) { return WithoutBillboard(landmark); };
  EXPECT_EQ(Take(PassOf(4, look)).landmarks_vanished, 0u) << "one drive takes nothing away";
  size_t vanished = 0;
  for (uint64_t day = 5; day <= 7; ++day) vanished += Take(PassOf(day, look)).landmarks_vanished;
  EXPECT_EQ(vanished, at_first);
  EXPECT_EQ(BillboardLeft(), 0u);
  EXPECT_TRUE(CheckConsistency(Whole(1).map()).ok());
  ExpectPatchesLeadToTiles();
}

TEST_F(PassMemoryTest, OneDriveCountsOnceHoweverManyPartsItSends) {
  const auto look = [&](const LeanLandmark& landmark) { return WithoutBillboard(landmark); };
  for (uint32_t part = 0; part < 6; ++part) {
    MapDiff diff = PassOf(1, look);
    diff.part = part;
    EXPECT_EQ(Take(diff).landmarks_vanished, 0u);
  }
  EXPECT_TRUE(absl::IsAlreadyExists(Contribute(PassOf(1, look), "again", *base_).status()));
}

TEST_F(PassMemoryTest, UnderstandsOlderVersionsOfATile) {
  const auto old_tiles = TilesNow();
  const auto look = [&](const LeanLandmark& landmark) { return WithoutBillboard(landmark); };
  for (uint64_t day = 1; day <= 6; ++day) Take(PassOf(day, look));
  ASSERT_EQ(BillboardLeft(), 0u);
  const Contribution made = Take(PassOf(7, look, old_tiles));
  EXPECT_EQ(made.sightings_ignored, 0u);
  EXPECT_GT(made.seen_through, 4u);
  ASSERT_TRUE(base_->store().DropPatches(0).ok());
  EXPECT_GT(Take(PassOf(8, look, old_tiles)).sightings_ignored, 0u);
}

TEST_F(PassMemoryTest, SightingsOfAnotherNumberOfLandmarksAreIgnored) {
  MapDiff diff = PassOf(1, [](const auto&) { return Sighting::kMissed; });
  diff.sightings.front().of_landmarks.pop_back();
  EXPECT_EQ(Take(diff).sightings_ignored, 1u);
}

TEST_F(PassMemoryTest, APassThatSeesNothingIsNotBelieved) {
  for (uint64_t day = 1; day <= 8; ++day) {
    const Contribution made = Take(PassOf(day, [](const auto&) { return Sighting::kSeenThrough; }));
    EXPECT_TRUE(made.is_doubted);
    EXPECT_EQ(made.landmarks_vanished, 0u);
  }
}

TEST_F(PassMemoryTest, ARevertedDriveHasNotPassed) {
  const auto look = [&](const LeanLandmark& landmark) { return WithoutBillboard(landmark); };
  Take(PassOf(1, look));
  ASSERT_TRUE(Revert(ToHex({101, 5}), *base_).ok());
  const StoredEvidence stored = ReadEvidence(base_->reader(), Tiles(1).front()).value();
  EXPECT_EQ(stored.evidence.pass_count(), 1u);
  EXPECT_EQ(Take(PassOf(1, look)).missed, 0u) << "it may be added again";
}

TEST_F(PassMemoryTest, NewsAreConfirmedByAnotherDriveOrGo) {
  MapDiff news = PassOf(1, [](const auto&) { return Sighting::kNone; });
  LeanLandmark landmark;
  landmark.id = {news.drive.drives[0].id, 0};
  landmark.keyframe_idxs = {0};
  landmark.position_in_map = {0, 3, 1};
  const Eigen::Vector3d center =
      TilesNow().front()->map.keyframes.front().map_from_camera.translation;
  news.drive.keyframes[0].map_from_camera.translation = center + Eigen::Vector3d(3, 0, 0);
  for (uint32_t i = 0; i < 2; ++i) {
    landmark.id.index = i;
    landmark.position_in_map = center + Eigen::Vector3d(3, 10 + 2.0 * i, 1);
    news.drive.landmarks.push_back(landmark);
  }
  EXPECT_EQ(Take(news).landmarks_added, 2u);
  const auto sees_the_first = [&](const LeanLandmark& seen) {
    if (seen.id.drive != landmark.id.drive) return Sighting::kSeen;
    return seen.id.index == 0 ? Sighting::kSeen : Sighting::kMissed;
  };
  size_t confirmed = 0, refuted = 0;
  for (uint64_t day = 2; day <= 4; ++day) {
    const Contribution made = Take(PassOf(day, sees_the_first));
    confirmed += made.landmarks_confirmed;
    refuted += made.landmarks_refuted;
  }
  EXPECT_EQ(confirmed, 1u);
  EXPECT_EQ(refuted, 1u);
  const LeanMap map = Whole(1).map();
  EXPECT_EQ(FindById(map.landmarks, LandmarkId{landmark.id.drive, 0})->drive_count, 2);
  EXPECT_EQ(FindById(map.landmarks, LandmarkId{landmark.id.drive, 1}), nullptr);
  ExpectPatchesLeadToTiles();
}

TEST_F(PassMemoryTest, APartOfNoDriveIsRefused) {
  EXPECT_TRUE(absl::IsInvalidArgument(Contribute(MapDiff{}, "nobody's", *base_).status()));
}

TEST_F(PassMemoryTest, APartWithoutAPlaceIsFitted) {
  MapDiff part;
  part.part = 3;
  part.drive = MapOf(street_, {.id = 2, .from_m = 60, .to_m = 150});
  const Contribution made = Take(part);
  EXPECT_TRUE(made.fit.has_value());
  EXPECT_EQ(made.component, 1u);
  EXPECT_TRUE(absl::IsAlreadyExists(Contribute(part, "again", *base_).status()));
}

}  // namespace
}  // namespace carmap
