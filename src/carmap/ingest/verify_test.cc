#include "carmap/ingest/verify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "carmap/ingest/evidence.h"
#include "carmap/ingest/test_base.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class VerifyTest : public BaseTest {
 protected:
  VerifyTest() {
    const Street street = MakeStreet(3, 230);
    Add(MapOf(street, {.id = 1, .to_m = 120}));
    Add(MapOf(street, {.id = 2, .from_m = 60, .to_m = 200}));
  }

  /// Puts other bytes in a tile's place, as a disk or a bug may.
  void Spoil(TileId id, const std::string& bytes) {
    const uint64_t version = *base_->reader().VersionOf(id);
    const StoredPatch last = base_->reader().ReadPatches(id, version - 1)->front();
    Commit commit;
    commit.tiles = {{id, version, bytes, last.patch, last.inverse, ""}};
    commit.journal_text = ToJournal(LoggedChange{.kind = "spoil"});
    ASSERT_TRUE(base_->Apply(commit).ok());
  }
};

TEST_F(VerifyTest, CountsWhatASoundBaseHolds) {
  const auto found = Verify(*base_, Mending::kNone);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_THAT(found->problems, IsEmpty());
  EXPECT_EQ(found->tiles, Tiles(1).size());
  EXPECT_EQ(found->landmarks, Whole(1).map().landmarks.size());
  EXPECT_EQ(found->keyframes, Whole(1).map().keyframes.size());
  EXPECT_GE(found->patches, found->tiles);
  EXPECT_EQ(found->journal_entries, 2u);
}

TEST_F(VerifyTest, ForgetsEvidenceThatIsDamaged) {
  const TileId id = Tiles(1).front();
  Commit spoil;
  ASSERT_TRUE(DropEvidence(base_->reader(), id, spoil).ok());
  spoil.contributions.emplace_back(spoil.withdrawn.front() + "1", "not evidence");
  spoil.journal_text = ToJournal(LoggedChange{.kind = "spoil"});
  ASSERT_TRUE(base_->Apply(spoil).ok());
  EXPECT_TRUE(absl::IsDataLoss(ReadEvidence(base_->reader(), id).status()));
  const auto found = Verify(*base_, Mending::kNone);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_THAT(found->problems, ElementsAre(HasSubstr("--repair")));
  const auto mended = Verify(*base_, Mending::kRepair);
  ASSERT_TRUE(mended.ok()) << mended.status();
  EXPECT_EQ(mended->evidence_dropped, 1u);
  EXPECT_THAT(Verify(*base_, Mending::kNone)->problems, IsEmpty());
  EXPECT_EQ(ReadEvidence(base_->reader(), id)->revision, 0u);
}

TEST_F(VerifyTest, NamesTheTileThatIsDamaged) {
  const TileId id = Tiles(1).front();
  Spoil(id, "not a tile");
  const auto found = Verify(*base_, Mending::kNone);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_GE(found->problems.size(), 1u);
  EXPECT_THAT(found->problems.back(), HasSubstr("tile 1/"));
  EXPECT_EQ(found->tiles, Tiles(1).size());
}

TEST_F(VerifyTest, ListsAgainWhatTilesAndJournalTell) {
  const Component before = base_->Components()->front();
  Commit commit;
  commit.components = {{1, ""}};
  commit.withdrawn = {KeyOf(DriveId{2, 5})};
  commit.journal_text = ToJournal(LoggedChange{.kind = "spoil"});
  ASSERT_TRUE(base_->Apply(commit).ok());
  const auto found = Verify(*base_, Mending::kNone);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_THAT(found->problems,
              ::testing::IsSupersetOf({HasSubstr("component 1: is not listed"),
                                       HasSubstr(ToHex(DriveId{2, 5}) + ": is not listed")}));
  const auto repaired = Verify(*base_, Mending::kRepair);
  ASSERT_TRUE(repaired.ok()) << repaired.status();
  EXPECT_THAT(repaired->problems, IsEmpty());
  EXPECT_EQ(repaired->relisted_components, 1u);
  EXPECT_EQ(repaired->relisted_drives, 1u);
  ASSERT_EQ(base_->Components()->size(), 1u);
  EXPECT_EQ(base_->Components()->front().grid, before.grid);
  EXPECT_TRUE(base_->reader().ReadContribution(KeyOf(DriveId{2, 5}))->has_value());
}

TEST_F(VerifyTest, RepairsATileFromItsPatches) {
  const TileId id = Tiles(1).front();
  const uint64_t hash = HashOf((*base_->Read(id))->map);
  // A tile that is lost, of which the patches are whole: as after the loss of its table.
  const uint64_t version = *base_->reader().VersionOf(id);
  Tile tile = **base_->Read(id), next = tile;
  next.version = version + 1;
  Commit commit;
  commit.tiles = {{id, version, "not a tile", EncodePatch(MakePatch(tile, next)).value(),
                   EncodePatch(MakePatch(next, tile)).value(), ""}};
  commit.journal_text = ToJournal(LoggedChange{.kind = "spoil"});
  ASSERT_TRUE(base_->Apply(commit).ok());
  EXPECT_FALSE(Verify(*base_, Mending::kNone)->problems.empty());
  const auto repaired = Verify(*base_, Mending::kRepair);
  ASSERT_TRUE(repaired.ok()) << repaired.status();
  EXPECT_EQ(repaired->repaired, 1u);
  EXPECT_EQ(repaired->landmarks, Whole(1).map().landmarks.size());
  EXPECT_EQ(HashOf((*base_->Read(id))->map), hash);
  EXPECT_THAT(Verify(*base_, Mending::kNone)->problems, IsEmpty());
}

}  // namespace
}  // namespace carmap
