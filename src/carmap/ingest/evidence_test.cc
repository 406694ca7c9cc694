#include "carmap/ingest/evidence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr LandmarkId kCorner{{1, 1}, 7};

DriveId DriveOf(uint64_t number) { return {number, 1}; }

std::vector<Sighting> OutcomesOf(const TileEvidence& evidence, LandmarkId landmark) {
  std::vector<Sighting> outcomes;
  for (const PassSighting& pass : evidence.PassesOf(landmark)) outcomes.push_back(pass.outcome);
  return outcomes;
}

TEST(TileEvidence, OrdersPassesByTimeWheneverTheyCome) {
  TileEvidence evidence;
  evidence.AddPass(DriveOf(3), 300);
  evidence.Record(kCorner, DriveOf(3), Sighting::kMissed, 0.5);
  evidence.AddPass(DriveOf(2), 200);
  evidence.Record(kCorner, DriveOf(2), Sighting::kSeen, -0.5);
  EXPECT_THAT(OutcomesOf(evidence, kCorner), ElementsAre(Sighting::kSeen, Sighting::kMissed));
  EXPECT_DOUBLE_EQ(evidence.PassesOf(kCorner)[0].log_odds, -0.5);
}

TEST(TileEvidence, CountsADriveOnceHoweverOftenItTells) {
  TileEvidence evidence;
  evidence.AddPass(DriveOf(2), 200);
  evidence.AddPass(DriveOf(2), 210);
  evidence.Record(kCorner, DriveOf(2), Sighting::kMissed, 0);
  evidence.Record(kCorner, DriveOf(2), Sighting::kSeen, 0);
  evidence.Record(kCorner, DriveOf(2), Sighting::kMissed, 0);
  EXPECT_EQ(evidence.pass_count(), 1u);
  EXPECT_THAT(OutcomesOf(evidence, kCorner), ElementsAre(Sighting::kSeen));
}

TEST(TileEvidence, PassesBeforeALandmarkWasThereDoNotCount) {
  TileEvidence evidence;
  evidence.AddPass(kCorner.drive, 500);
  evidence.AddPass(DriveOf(2), 200);
  evidence.Record(kCorner, DriveOf(2), Sighting::kMissed, 0);
  EXPECT_THAT(OutcomesOf(evidence, kCorner), IsEmpty());
}

TEST(TileEvidence, KeepsTheNewestPasses) {
  TileEvidence evidence;
  for (uint64_t i = 0; i < TileEvidence::kMaxPasses + 5; ++i) {
    evidence.AddPass(DriveOf(100 + i), static_cast<int64_t>(i));
    evidence.Record(kCorner, DriveOf(100 + i), i < 5 ? Sighting::kSeen : Sighting::kMissed, 0);
  }
  EXPECT_EQ(evidence.pass_count(), TileEvidence::kMaxPasses);
  EXPECT_EQ(evidence.CountsOf(kCorner).seen, 0u);
  EXPECT_EQ(evidence.CountsOf(kCorner).missed, TileEvidence::kMaxPasses);
}

TEST(TileEvidence, ConfirmsByAnotherDriveOnce) {
  TileEvidence evidence;
  evidence.AwaitConfirmation(kCorner);
  evidence.AddPass(kCorner.drive, 100);
  evidence.Record(kCorner, kCorner.drive, Sighting::kSeen, 0);
  EXPECT_THAT(evidence.TakeConfirmed(), IsEmpty());
  evidence.AddPass(DriveOf(2), 200);
  evidence.Record(kCorner, DriveOf(2), Sighting::kSeen, 0);
  EXPECT_THAT(evidence.TakeConfirmed(), ElementsAre(kCorner));
  EXPECT_THAT(evidence.TakeConfirmed(), IsEmpty());
}

/// After how many misses in such light it is refuted.
int MissesUntilRefuted(double log_odds, Sighting outcome = Sighting::kMissed) {
  TileEvidence evidence;
  evidence.AwaitConfirmation(kCorner);
  for (int misses = 0; misses < 40; ++misses) {
    if (!evidence.TakeRefuted().empty()) {
      EXPECT_EQ(evidence.CountsOf(kCorner).missed, 0u) << "it is forgotten";
      return misses;
    }
    evidence.AddPass(DriveOf(static_cast<uint64_t>(misses) + 2), misses);
    evidence.Record(kCorner, DriveOf(static_cast<uint64_t>(misses) + 2), outcome, log_odds);
  }
  return 40;
}

TEST(TileEvidence, RefutesWhatOthersWouldHardlyHaveMissed) {
  EXPECT_EQ(MissesUntilRefuted(0), 4);
  EXPECT_EQ(MissesUntilRefuted(2), 2);
  EXPECT_GT(MissesUntilRefuted(-2), 15) << "in that light little is recognised";
  EXPECT_EQ(MissesUntilRefuted(-2, Sighting::kSeenThrough), 2);
}

TEST(TileEvidence, KnowsWhatComesBack) {
  TileEvidence evidence;
  Descriptor look, other;
  for (uint64_t& word : other.words) word = ~uint64_t{0};
  evidence.AddVanished({kCorner, {5, 1, 20}, look, 4, 3, 100});
  EXPECT_FALSE(evidence.TakeReturned({5, 1, 22}, look)) << "elsewhere";
  EXPECT_FALSE(evidence.TakeReturned({5, 1, 20}, other)) << "another look";
  const auto returned = evidence.TakeReturned({5.1, 1, 20}, look);
  ASSERT_TRUE(returned);
  EXPECT_EQ(returned->drive_count, 4);
  EXPECT_THAT(evidence.vanished(), IsEmpty());
}

TileEvidence Sample() {
  TileEvidence evidence;
  for (uint64_t drive = 2; drive < 6; ++drive) {
    evidence.AddPass(DriveOf(drive), 1'790'000'000 + static_cast<int64_t>(drive) * 86'400);
    for (uint32_t i = 0; i < 50; ++i) {
      evidence.Record({{1, 1}, i}, DriveOf(drive), static_cast<Sighting>((drive + i) % 4),
                      0.25 * static_cast<double>(i % 5) - 0.5);
    }
  }
  evidence.AwaitConfirmation({{9, 9}, 3});
  evidence.AddVanished({{{1, 1}, 49}, {1.5f, -2, 30}, {}, 3, 2.5f, 1'790'900'000});
  return evidence;
}

TEST(TileEvidence, ComesBackFromItsBytes) {
  const TileEvidence evidence = Sample();
  const auto back = TileEvidence::Decode(evidence.Encode());
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(*back, evidence);
  EXPECT_EQ(*TileEvidence::Decode(TileEvidence().Encode()), TileEvidence());
}

TEST(TileEvidence, DamagedBytesAreRefusedOrMeanSomething) {
  const std::string bytes = Sample().Encode();
  for (size_t cut = 0; cut < bytes.size(); ++cut) {
    EXPECT_FALSE(TileEvidence::Decode(bytes.substr(0, cut)).ok()) << cut;
  }
  for (size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x41);
    const auto decoded = TileEvidence::Decode(damaged);
    EXPECT_TRUE(!decoded.ok() || decoded->pass_count() <= TileEvidence::kMaxPasses);
  }
}

TEST(StoredEvidence, IsReplacedByOneWriterAlone) {
  const auto store = MakeMemoryStore("header");
  constexpr TileId kTile{1, 42};
  EXPECT_EQ(ReadEvidence(*store, kTile)->revision, 0u);
  Commit first, second;
  ReplaceEvidence(kTile, 0, Sample(), first);
  ReplaceEvidence(kTile, 0, TileEvidence(), second);
  ASSERT_TRUE(store->Apply(first).ok());
  EXPECT_TRUE(absl::IsAlreadyExists(store->Apply(second).status()));
  const auto stored = ReadEvidence(*store, kTile);
  ASSERT_TRUE(stored.ok());
  EXPECT_EQ(stored->revision, 1u);
  EXPECT_EQ(stored->evidence, Sample());
  Commit third;
  ReplaceEvidence(kTile, 1, TileEvidence(), third);
  ASSERT_TRUE(store->Apply(third).ok());
  EXPECT_EQ(ReadEvidence(*store, kTile)->evidence, TileEvidence());
}

}  // namespace
}  // namespace carmap
