#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <map>
#include <random>
#include <thread>

#include "carmap/base/byte_io.h"
#include "carmap/base/file.h"
#include "carmap/store/map_store.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;

constexpr TileId kTile{1, 0x89c25a3100000000};
constexpr TileId kOther{1, 0x89c25a3300000000};

/// Where there is room, in memory: nothing here is about the disk itself, and syncing one is slow.
fs::path ScratchPlace() {
  const fs::path memory = "/dev/shm";
  constexpr uintmax_t kRoom = uintmax_t{1} << 30;
  std::error_code error;
  const fs::space_info space = fs::space(memory, error);
  const bool is_good = !error && space.available > kRoom && ::access(memory.c_str(), W_OK) == 0;
  return is_good ? memory : fs::path(testing::TempDir());
}

/// A folder of its own for each test, gone after it.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string name = (ScratchPlace() / "carmap_store_XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~ScratchFolder() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;

  fs::path operator/(std::string_view name) const { return path_ / name; }

 private:
  fs::path path_;
};

int CountFromEnvironment(const char* name, int otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr ? otherwise : std::atoi(value);
}

std::string Noise(uint64_t seed, size_t size) {
  std::mt19937_64 random(seed);
  std::string bytes;
  bytes.reserve(size + sizeof(uint64_t));
  while (bytes.size() < size) AppendUint(random(), bytes);
  bytes.resize(size);
  return bytes;
}

TileChange Change(TileId tile, uint64_t from_version, std::optional<std::string> bytes) {
  const std::string name = fmt::format("{}>{}", from_version, from_version + 1);
  return {tile,           from_version, std::move(bytes), "patch " + name, "inverse " + name,
          "words " + name};
}

Commit CommitOf(std::vector<TileChange> tiles) {
  Commit commit;
  commit.tiles = std::move(tiles);
  commit.journal_text = fmt::format("{} tiles", commit.tiles.size());
  return commit;
}

Commit Put(TileId tile, uint64_t from_version, std::string bytes) {
  return CommitOf({Change(tile, from_version, std::move(bytes))});
}

std::map<TileId, std::string> WordsOf(const MapReader& reader) {
  std::map<TileId, std::string> words;
  EXPECT_TRUE(reader
                  .VisitWords([&](TileId tile, std::string_view text) {
                    EXPECT_TRUE(words.empty() || words.rbegin()->first < tile);
                    words[tile] = text;
                  })
                  .ok());
  return words;
}

std::vector<uint64_t> PatchVersions(const std::vector<StoredPatch>& patches) {
  std::vector<uint64_t> versions;
  for (const StoredPatch& patch : patches) versions.push_back(patch.to_version);
  return versions;
}

std::string BytesOf(const MapReader& reader, TileId tile) {
  const auto read = reader.ReadTile(tile);
  EXPECT_TRUE(read.ok()) << read.status();
  return read.ok() && *read ? (*read)->bytes : "none";
}

/// What could not be read.
struct Losses {
  int tiles = 0;
  std::vector<std::string> messages;

  template <typename T>
  bool Note(const absl::StatusOr<T>& value) {
    if (!value.ok()) messages.emplace_back(value.status().message());
    return value.ok();
  }
};

void ComparePatches(const MapReader& reader, const MapReader& truth, const TileVersion& tile,
                    Losses& losses) {
  const uint64_t after = tile.version > 20 ? tile.version - 20 : 0;
  const auto patches = reader.ReadPatches(tile.tile, after);
  if (!losses.Note(patches)) return;
  const auto expected = truth.ReadPatches(tile.tile, after);
  ASSERT_EQ(PatchVersions(*patches), PatchVersions(*expected));
  for (size_t i = 0; i < patches->size(); ++i) {
    ASSERT_EQ((*patches)[i].patch, (*expected)[i].patch);
    ASSERT_EQ((*patches)[i].inverse, (*expected)[i].inverse);
  }
}

void CompareTiles(const MapReader& reader, const MapReader& truth, Losses& losses) {
  const auto expected = *truth.ListTiles();
  if (const auto tiles = reader.ListTiles(); losses.Note(tiles)) {
    ASSERT_EQ(tiles->size(), expected.size());
  }
  for (const TileVersion& tile : expected) {
    if (const auto version = reader.VersionOf(tile.tile); losses.Note(version)) {
      ASSERT_EQ(*version, tile.version);
    }
    const auto stored = reader.ReadTile(tile.tile);
    if (losses.Note(stored)) {
      ASSERT_EQ(stored->has_value(), !tile.is_removed);
      if (!tile.is_removed) {
        ASSERT_EQ((*stored)->version, tile.version);
        ASSERT_TRUE((*stored)->bytes == BytesOf(truth, tile.tile));
      }
    } else {
      ++losses.tiles;
    }
    ComparePatches(reader, truth, tile, losses);
  }
  const auto words = WordsOf(truth);
  size_t seen = 0;
  const absl::Status status = reader.VisitWords([&](TileId tile, std::string_view text) {
    ASSERT_TRUE(words.contains(tile));
    EXPECT_EQ(words.at(tile), text);
    ++seen;
  });
  if (!status.ok()) losses.messages.emplace_back(status.message());
  ASSERT_TRUE(!status.ok() || seen == words.size());
}

/// That each value which `reader` returns is what `truth` returns; `keys` are of contributions.
Losses Compare(const MapReader& reader, const MapReader& truth,
               const std::vector<std::string>& keys) {
  Losses losses;
  if (const auto header = reader.Header(); losses.Note(header)) {
    EXPECT_EQ(*header, *truth.Header());
  }
  CompareTiles(reader, truth, losses);
  if (const auto components = reader.ReadComponents(); losses.Note(components)) {
    EXPECT_EQ(*components, *truth.ReadComponents());
  }
  for (const std::string& key : keys) {
    if (const auto value = reader.ReadContribution(key); losses.Note(value)) {
      EXPECT_EQ(*value, *truth.ReadContribution(key)) << key;
    }
  }
  const auto expected = *truth.ReadJournal(1, SIZE_MAX);
  if (const auto journal = reader.ReadJournal(1, SIZE_MAX); losses.Note(journal)) {
    EXPECT_EQ(journal->size(), expected.size());
    for (size_t i = 0; i < std::min(journal->size(), expected.size()); ++i) {
      EXPECT_EQ((*journal)[i].sequence, expected[i].sequence);
      EXPECT_EQ((*journal)[i].text, expected[i].text);
    }
  }
  return losses;
}

/// What is the same for every store.
class StoreTest : public testing::TestWithParam<bool> {
 protected:
  StoreTest() {
    if (GetParam()) {
      auto created = CreateRocksStore(scratch_ / "base", "the header");
      EXPECT_TRUE(created.ok()) << created.status();
      store_ = *std::move(created);
    } else {
      store_ = MakeMemoryStore("the header");
    }
  }

  MapStore& store() { return *store_; }

  uint64_t Commit(const carmap::Commit& commit) {
    const auto sequence = store_->Apply(commit);
    EXPECT_TRUE(sequence.ok()) << sequence.status();
    return sequence.value_or(0);
  }

  /// That a commit is refused and changes nothing.
  void ExpectRefused(const carmap::Commit& commit, absl::StatusCode code,
                     const std::string& words) {
    const auto before = Everything();
    const auto sequence = store_->Apply(commit);
    EXPECT_EQ(sequence.status().code(), code) << sequence.status();
    EXPECT_THAT(std::string(sequence.status().message()), HasSubstr(words));
    EXPECT_EQ(Everything(), before);
  }

 private:
  std::vector<std::string> Everything() {
    std::vector<std::string> all;
    const std::vector<TileVersion> tiles = *store_->ListTiles();
    for (const TileVersion& tile : tiles) {
      all.push_back(fmt::format("{} {} {} {} {}", tile.tile.component, tile.tile.cell, tile.version,
                                tile.is_removed, BytesOf(*store_, tile.tile)));
      const std::vector<StoredPatch> patches = *store_->ReadPatches(tile.tile, 0);
      for (const StoredPatch& patch : patches) {
        all.push_back(fmt::format("{} {} {}", patch.to_version, patch.patch, patch.inverse));
      }
    }
    for (const auto& [tile, words] : WordsOf(*store_)) all.push_back(words);
    const auto components = *store_->ReadComponents();
    for (const auto& [component, text] : components) all.push_back(text);
    for (const char* key : {"a", "b", "c"}) {
      all.push_back(store_->ReadContribution(key)->value_or("none"));
    }
    const std::vector<JournalEntry> journal = *store_->ReadJournal(1, 1000);
    for (const JournalEntry& entry : journal) all.push_back(entry.text);
    return all;
  }

  ScratchFolder scratch_;
  std::unique_ptr<MapStore> store_;
};

INSTANTIATE_TEST_SUITE_P(, StoreTest, testing::Bool(), [](const auto& kind) {
  return std::string(kind.param ? "Rocks" : "Memory");
});

TEST_P(StoreTest, BeginsEmptyWithItsHeader) {
  EXPECT_EQ(*store().Header(), "the header");
  EXPECT_EQ(*store().ReadTile(kTile), std::nullopt);
  EXPECT_EQ(*store().VersionOf(kTile), 0);
  EXPECT_THAT(*store().ListTiles(), IsEmpty());
  EXPECT_THAT(WordsOf(store()), IsEmpty());
  EXPECT_THAT(*store().ReadPatches(kTile, 0), IsEmpty());
  EXPECT_THAT(*store().ReadComponents(), IsEmpty());
  EXPECT_EQ(*store().ReadContribution("a"), std::nullopt);
  EXPECT_THAT(*store().ReadJournal(0, 10), IsEmpty());
}

TEST_P(StoreTest, KeepsWhatIsCommitted) {
  carmap::Commit commit = CommitOf({Change(kTile, 0, "tile"), Change(kOther, 0, std::string())});
  commit.components = {{7, "seven"}, {3, "three"}};
  commit.contributions = {{"a", ""}, {"b", std::string("\0x", 2)}};
  EXPECT_EQ(Commit(commit), 1);
  const auto tile = *store().ReadTile(kTile);
  ASSERT_TRUE(tile);
  EXPECT_EQ(tile->version, 1);
  EXPECT_EQ(tile->bytes, "tile");
  EXPECT_EQ((*store().ReadTile(kOther))->bytes, "");
  EXPECT_THAT(*store().ReadComponents(), ElementsAre(Pair(3, "three"), Pair(7, "seven")));
  EXPECT_EQ(*store().ReadContribution("a"), "");
  EXPECT_EQ(*store().ReadContribution("b"), std::string("\0x", 2));
  EXPECT_EQ(*store().ReadContribution("c"), std::nullopt);
  EXPECT_THAT(WordsOf(store()), ElementsAre(Pair(kTile, "words 0>1"), Pair(kOther, "words 0>1")));
  EXPECT_EQ((*store().ReadJournal(1, 1))[0].text, "2 tiles");
}

TEST_P(StoreTest, PutsAndRemovesComponentsAndContributions) {
  carmap::Commit commit;
  commit.components = {{1, "one"}, {UINT32_MAX, "last"}};
  commit.contributions = {{"a", "1"}, {"b", "2"}};
  Commit(commit);
  commit.components = {{1, ""}, {UINT32_MAX, "changed"}, {9, ""}};
  commit.contributions = {{"c", "3"}};
  commit.withdrawn = {"a", "never there"};
  Commit(commit);
  EXPECT_THAT(*store().ReadComponents(), ElementsAre(Pair(UINT32_MAX, "changed")));
  EXPECT_EQ(*store().ReadContribution("a"), std::nullopt);
  EXPECT_EQ(*store().ReadContribution("b"), "2");
  EXPECT_EQ(*store().ReadContribution("c"), "3");
  // What was withdrawn may come again.
  carmap::Commit again;
  again.contributions = {{"a", "new"}};
  Commit(again);
  EXPECT_EQ(*store().ReadContribution("a"), "new");
}

TEST_P(StoreTest, ForgetsThePatchesOfOneTile) {
  Commit(CommitOf({Change(kTile, 0, "a"), Change(kOther, 0, "b")}));
  Commit(Put(kTile, 1, "c"));
  ASSERT_TRUE(store().DropPatchesOf(kTile).ok());
  EXPECT_EQ(store().ReadPatches(kTile, 0).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(store().ReadPatches(kTile, 1).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(store().ReadPatches(kOther, 0)->size(), 1u);
  EXPECT_EQ(BytesOf(store(), kTile), "c");
  Commit(Put(kTile, 2, "d"));
  EXPECT_EQ(PatchVersions(*store().ReadPatches(kTile, 2)), std::vector<uint64_t>{3});
  EXPECT_TRUE(store().VerifyFiles().ok());
}

TEST_P(StoreTest, VisitsContributionsByTheBeginningOfTheirKeys) {
  carmap::Commit commit;
  commit.contributions = {{"b/2", "2"}, {"b/1", "1"}, {"b", "no"}, {"b0", "no"}, {"c/1", "no"}};
  Commit(commit);
  std::vector<std::pair<std::string, std::string>> visited;
  const auto visit = [&](std::string_view key, std::string_view value) {
    visited.emplace_back(key, value);
    return absl::OkStatus();
  };
  EXPECT_TRUE(store().VisitContributions("b/", visit).ok());
  EXPECT_THAT(visited, ElementsAre(Pair("b/1", "1"), Pair("b/2", "2")));
  EXPECT_TRUE(store().VisitContributions("d", visit).ok());
  EXPECT_EQ(visited.size(), 2u);
  const absl::Status stopped = store().VisitContributions(
      "b/", [](std::string_view, std::string_view) { return absl::CancelledError("enough"); });
  EXPECT_EQ(stopped.message(), "enough");
}

TEST_P(StoreTest, ListsTilesAscendingRemovedOnesToo) {
  const std::vector<TileId> tiles = {{0, 5},          {1, 0},   {1, 255},       {1, 256},
                                     {1, UINT64_MAX}, {256, 1}, {UINT32_MAX, 0}};
  for (size_t i = tiles.size(); i-- > 0;) Commit(Put(tiles[i], 0, "x"));
  Commit(CommitOf({Change(tiles[3], 1, std::nullopt)}));
  const auto listed = *store().ListTiles();
  ASSERT_EQ(listed.size(), tiles.size());
  for (size_t i = 0; i < tiles.size(); ++i) {
    EXPECT_EQ(listed[i].tile, tiles[i]);
    EXPECT_EQ(listed[i].is_removed, i == 3);
    EXPECT_EQ(listed[i].version, i == 3 ? 2 : 1);
  }
  EXPECT_EQ(WordsOf(store()).size(), tiles.size() - 1);
}

TEST_P(StoreTest, VersionsNeverRepeat) {
  Commit(Put(kTile, 0, "first"));
  Commit(CommitOf({Change(kTile, 1, std::nullopt)}));
  EXPECT_EQ(*store().ReadTile(kTile), std::nullopt);
  EXPECT_EQ(*store().VersionOf(kTile), 2);
  ExpectRefused(Put(kTile, 0, "as if new"), absl::StatusCode::kAborted, "version 2, not 0");
  ExpectRefused(Put(kTile, 1, "old"), absl::StatusCode::kAborted, "version 2, not 1");
  Commit(Put(kTile, 2, "again"));
  EXPECT_EQ((*store().ReadTile(kTile))->version, 3);
  EXPECT_EQ(BytesOf(store(), kTile), "again");
  EXPECT_THAT(PatchVersions(*store().ReadPatches(kTile, 0)), ElementsAre(1, 2, 3));
}

TEST_P(StoreTest, RefusedCommitsChangeNothing) {
  carmap::Commit first = Put(kTile, 0, "tile");
  first.contributions = {{"a", "1"}};
  first.components = {{1, "one"}};
  Commit(first);

  carmap::Commit commit = CommitOf({Change(kOther, 0, "good"), Change(kTile, 0, "stale")});
  commit.components = {{1, "changed"}};
  commit.withdrawn = {"a"};
  ExpectRefused(commit, absl::StatusCode::kAborted, "tile 1/89c25a3100000000 has version 1, not 0");
  commit.tiles.pop_back();
  commit.withdrawn.clear();
  commit.contributions = {{"b", "2"}, {"a", "again"}};
  ExpectRefused(commit, absl::StatusCode::kAlreadyExists, "contribution a is there");
  commit.contributions.clear();
  commit.tiles.push_back(commit.tiles[0]);
  ExpectRefused(commit, absl::StatusCode::kInvalidArgument, "tile 1/89c25a3300000000 stands twice");
  ExpectRefused(CommitOf({Change(kOther, 0, std::nullopt)}), absl::StatusCode::kInvalidArgument,
                "not there");
  Commit(CommitOf({Change(kTile, 1, std::nullopt)}));
  ExpectRefused(CommitOf({Change(kTile, 2, std::nullopt)}), absl::StatusCode::kInvalidArgument,
                "not there");
  EXPECT_EQ(Commit(Put(kOther, 0, "good")), 3);
}

TEST_P(StoreTest, RefusesNamesTwiceAndLongKeys) {
  carmap::Commit commit;
  commit.components = {{1, "a"}, {1, "b"}};
  ExpectRefused(commit, absl::StatusCode::kInvalidArgument, "component 1 stands twice");
  commit.components.clear();
  commit.contributions = {{"a", "1"}, {"a", "2"}};
  ExpectRefused(commit, absl::StatusCode::kInvalidArgument, "contribution a stands twice");
  commit.contributions = {{"a", "1"}};
  commit.withdrawn = {"a"};
  ExpectRefused(commit, absl::StatusCode::kInvalidArgument, "contribution a stands twice");
  commit.withdrawn.clear();
  commit.contributions = {{std::string(4097, 'k'), "1"}};
  ExpectRefused(commit, absl::StatusCode::kInvalidArgument, "4097 bytes; use at most 4096");
  commit.contributions = {{std::string(4096, 'k'), "1"}, {"", "empty"}};
  Commit(commit);
  EXPECT_EQ(*store().ReadContribution(std::string(4096, 'k')), "1");
  EXPECT_EQ(*store().ReadContribution(""), "empty");
}

TEST_P(StoreTest, SnapshotsStayAsTheyWere) {
  carmap::Commit commit = Put(kTile, 0, "old");
  commit.components = {{1, "one"}};
  Commit(commit);
  const auto snapshot = store().Snapshot();
  carmap::Commit next = CommitOf({Change(kTile, 1, std::nullopt), Change(kOther, 0, "new")});
  next.components = {{1, ""}};
  next.contributions = {{"a", "1"}};
  Commit(next);
  ASSERT_TRUE(store().DropPatches(0).ok());

  EXPECT_EQ(*snapshot->Header(), "the header");
  EXPECT_EQ(BytesOf(*snapshot, kTile), "old");
  EXPECT_EQ(*snapshot->VersionOf(kTile), 1);
  EXPECT_EQ(*snapshot->ReadTile(kOther), std::nullopt);
  EXPECT_EQ(snapshot->ListTiles()->size(), 1);
  EXPECT_THAT(WordsOf(*snapshot), ElementsAre(Pair(kTile, "words 0>1")));
  EXPECT_THAT(PatchVersions(*snapshot->ReadPatches(kTile, 0)), ElementsAre(1));
  EXPECT_THAT(*snapshot->ReadComponents(), ElementsAre(Pair(1, "one")));
  EXPECT_EQ(*snapshot->ReadContribution("a"), std::nullopt);
  EXPECT_EQ(snapshot->ReadJournal(1, 10)->size(), 1);
  EXPECT_EQ(*store().ReadTile(kTile), std::nullopt);
  EXPECT_EQ(BytesOf(*store().Snapshot(), kOther), "new");
}

TEST_P(StoreTest, ReadsPatchesAboveAVersion) {
  for (uint64_t version = 0; version < 5; ++version) Commit(Put(kTile, version, "x"));
  Commit(Put({kTile.component, kTile.cell + 1}, 0, "neighbour"));
  Commit(Put({kTile.component, kTile.cell - 1}, 0, "neighbour"));
  const auto patches = *store().ReadPatches(kTile, 3);
  ASSERT_THAT(PatchVersions(patches), ElementsAre(4, 5));
  EXPECT_EQ(patches[0].patch, "patch 3>4");
  EXPECT_EQ(patches[0].inverse, "inverse 3>4");
  EXPECT_EQ(store().ReadPatches(kTile, 0)->size(), 5);
  EXPECT_THAT(*store().ReadPatches(kTile, 5), IsEmpty());
  EXPECT_THAT(*store().ReadPatches(kTile, UINT64_MAX), IsEmpty());
  EXPECT_THAT(*store().ReadPatches({9, 9}, 0), IsEmpty());
}

TEST_P(StoreTest, DropsOldPatches) {
  for (uint64_t version = 0; version < 5; ++version) Commit(Put(kTile, version, "x"));
  Commit(Put(kOther, 0, "y"));
  ASSERT_TRUE(store().DropPatches(2).ok());
  EXPECT_THAT(PatchVersions(*store().ReadPatches(kTile, 3)), ElementsAre(4, 5));
  EXPECT_THAT(PatchVersions(*store().ReadPatches(kTile, 4)), ElementsAre(5));
  EXPECT_THAT(PatchVersions(*store().ReadPatches(kOther, 0)), ElementsAre(1));
  const auto dropped = store().ReadPatches(kTile, 2);
  EXPECT_EQ(dropped.status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_THAT(std::string(dropped.status().message()),
              AllOf(HasSubstr("tile 1/89c25a3100000000"), HasSubstr("version 2")));
  Commit(Put(kTile, 5, "z"));
  EXPECT_THAT(PatchVersions(*store().ReadPatches(kTile, 3)), ElementsAre(4, 5, 6));
  ASSERT_TRUE(store().DropPatches(2).ok());
  EXPECT_EQ(store().ReadPatches(kTile, 3).status().code(), absl::StatusCode::kOutOfRange);
  ASSERT_TRUE(store().DropPatches(0).ok());
  EXPECT_THAT(*store().ReadPatches(kTile, 6), IsEmpty());
  EXPECT_EQ(store().ReadPatches(kTile, 5).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(BytesOf(store(), kTile), "z");
  EXPECT_EQ(store().ReadJournal(1, 100)->size(), 7);
}

TEST_P(StoreTest, JournalHasNoGaps) {
  for (uint64_t i = 1; i <= 21; ++i) {
    carmap::Commit commit;
    commit.journal_text = fmt::format("entry {}", i);
    EXPECT_EQ(Commit(commit), i);
    ExpectRefused(Put(kTile, 1, "stale"), absl::StatusCode::kAborted, "version 0");
  }
  const auto entries = *store().ReadJournal(5, 3);
  ASSERT_EQ(entries.size(), 3);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(entries[i].sequence, 5 + i);
    EXPECT_EQ(entries[i].text, fmt::format("entry {}", 5 + i));
  }
  EXPECT_EQ(store().ReadJournal(0, SIZE_MAX)->size(), 21);
  EXPECT_EQ(store().ReadJournal(20, SIZE_MAX)->size(), 2);
  EXPECT_THAT(*store().ReadJournal(22, 10), IsEmpty());
  EXPECT_THAT(*store().ReadJournal(UINT64_MAX, SIZE_MAX), IsEmpty());
  EXPECT_THAT(*store().ReadJournal(1, 0), IsEmpty());
}

TEST_P(StoreTest, KeepsLargeValues) {
  const std::string large = Noise(1, 40 << 20);
  carmap::Commit commit = Put(kTile, 0, large);
  commit.tiles[0].patch = large.substr(0, 1 << 20);
  Commit(commit);
  EXPECT_TRUE(BytesOf(store(), kTile) == large);
  EXPECT_TRUE((*store().ReadPatches(kTile, 0))[0].patch == commit.tiles[0].patch);
}

TEST_P(StoreTest, CommittersFromThreadsLoseNothing) {
  constexpr int kThreads = 4;
  constexpr int kIncrements = 25;
  Commit(CommitOf({Change(kTile, 0, "0"), Change(kOther, 0, "0")}));
  std::atomic<bool> is_done = false;
  // A reader beside them always sees both tiles of one commit.
  std::thread reader([&] {
    while (!is_done) {
      const auto snapshot = store().Snapshot();
      EXPECT_EQ(BytesOf(*snapshot, kTile), BytesOf(*snapshot, kOther));
      EXPECT_TRUE(store().ListTiles().ok());
    }
  });
  std::vector<std::thread> committers;
  for (int i = 0; i < kThreads; ++i) {
    committers.emplace_back([&] {
      for (int done = 0; done < kIncrements;) {
        const auto tile = **store().ReadTile(kTile);
        const std::string next = std::to_string(std::stoi(tile.bytes) + 1);
        const auto sequence = store().Apply(
            CommitOf({Change(kTile, tile.version, next), Change(kOther, tile.version, next)}));
        EXPECT_TRUE(sequence.ok() || absl::IsAborted(sequence.status())) << sequence.status();
        done += sequence.ok();
      }
    });
  }
  for (std::thread& thread : committers) thread.join();
  is_done = true;
  reader.join();
  EXPECT_EQ(BytesOf(store(), kTile), std::to_string(kThreads * kIncrements));
  EXPECT_EQ(*store().VersionOf(kOther), kThreads * kIncrements + 1);
  EXPECT_EQ(store().ReadJournal(1, SIZE_MAX)->size(), kThreads * kIncrements + 1);
}

/// Commit number `sequence` of a made-up history, which depends on the state before it alone.
Commit HistoryCommit(uint64_t sequence, const MapReader& now, size_t tile_size) {
  Commit commit;
  for (const uint64_t step : {0, 3}) {
    const TileId tile{1, (sequence + step) % 7 << 60 | 1};
    const uint64_t version = *now.VersionOf(tile);
    const bool is_removed = version > 0 && sequence % 11 == 0 && *now.ReadTile(tile);
    TileChange change = Change(tile, version, std::nullopt);
    if (!is_removed) change.bytes = Noise(sequence * 10 + step, tile_size + sequence % 17);
    change.patch = Noise(sequence * 10 + step + 1, 300);
    commit.tiles.push_back(std::move(change));
  }
  commit.components = {{sequence % 3, sequence % 5 == 0 ? "" : std::to_string(sequence)}};
  commit.contributions = {{fmt::format("drive {}", sequence), std::to_string(sequence)}};
  if (sequence % 4 == 0) commit.withdrawn = {fmt::format("drive {}", sequence - 2)};
  commit.journal_text = fmt::format("commit {}", sequence);
  return commit;
}

std::vector<std::string> HistoryKeys(uint64_t count) {
  std::vector<std::string> keys;
  for (uint64_t i = 1; i <= count; ++i) keys.push_back(fmt::format("drive {}", i));
  return keys;
}

uint64_t LastSequence(const MapReader& reader, uint64_t from = 1) {
  const auto entries = reader.ReadJournal(from, SIZE_MAX);
  EXPECT_TRUE(entries.ok()) << entries.status();
  return !entries.ok() || entries->empty() ? from - 1 : entries->back().sequence;
}

class RocksStoreTest : public testing::Test {
 protected:
  fs::path folder() const { return scratch_ / "base"; }

  std::unique_ptr<MapStore> Create() { return Must(CreateRocksStore(folder(), "the header")); }
  std::unique_ptr<MapStore> Open(StoreAccess access = StoreAccess::kReadWrite) {
    return Must(OpenRocksStore(folder(), access));
  }
  static std::unique_ptr<MapStore> Must(absl::StatusOr<std::unique_ptr<MapStore>> store) {
    EXPECT_TRUE(store.ok()) << store.status();
    if (!store.ok()) std::abort();
    return *std::move(store);
  }

  void ExpectNotOpened(absl::StatusCode code, const std::string& words,
                       StoreAccess access = StoreAccess::kReadWrite) {
    const auto opened = OpenRocksStore(folder(), access);
    EXPECT_EQ(opened.status().code(), code) << opened.status();
    EXPECT_THAT(std::string(opened.status().message()),
                AllOf(HasSubstr(folder().string()), HasSubstr(words)));
  }

  ScratchFolder scratch_;
};

TEST_F(RocksStoreTest, SurvivesReopening) {
  const auto truth = MakeMemoryStore("the header");
  auto store = Create();
  for (uint64_t sequence = 1; sequence <= 60; ++sequence) {
    const Commit commit = HistoryCommit(sequence, *truth, 2000);
    ASSERT_EQ(*truth->Apply(commit), sequence);
    if (sequence % 8 == 1) {
      store.reset();
      store = Open();
    }
    ASSERT_EQ(*store->Apply(commit), sequence);
  }
  store.reset();
  EXPECT_THAT(Compare(*Open(), *truth, HistoryKeys(60)).messages, IsEmpty());
  EXPECT_THAT(Compare(*Open(StoreAccess::kReadOnly), *truth, HistoryKeys(60)).messages, IsEmpty());
}

TEST_F(RocksStoreTest, IsCreatedOnlyWhereThereIsNothing) {
  const auto expect_refused = [&](const fs::path& path, absl::StatusCode code,
                                  const std::string& words) {
    const auto created = CreateRocksStore(path, "");
    EXPECT_EQ(created.status().code(), code) << created.status();
    EXPECT_THAT(std::string(created.status().message()),
                AllOf(HasSubstr(path.string()), HasSubstr(words)));
  };
  Create()->Apply({}).IgnoreError();
  expect_refused(folder(), absl::StatusCode::kAlreadyExists, "holds a base map already");
  std::ofstream(scratch_ / "file") << "x";
  expect_refused(scratch_ / "file", absl::StatusCode::kAlreadyExists, "a file");
  fs::create_directory(scratch_ / "full");
  std::ofstream(scratch_ / "full" / "file") << "x";
  expect_refused(scratch_ / "full", absl::StatusCode::kAlreadyExists, "not empty");
  expect_refused(scratch_ / "no" / "base", absl::StatusCode::kUnavailable, "No such file");
  EXPECT_EQ(LastSequence(*Open()), 1);
  fs::create_directory(scratch_ / "empty");
  EXPECT_TRUE(CreateRocksStore(scratch_ / "empty", "").ok());
}

TEST_F(RocksStoreTest, NeedsAStoreToOpen) {
  ExpectNotOpened(absl::StatusCode::kNotFound, "no such folder");
  ExpectNotOpened(absl::StatusCode::kNotFound, "carmap base init", StoreAccess::kReadOnly);
  fs::create_directory(folder());
  ExpectNotOpened(absl::StatusCode::kNotFound, "holds no base map");
  EXPECT_TRUE(fs::is_empty(folder()));
}

TEST_F(RocksStoreTest, HalfCreatedStoreIsNoneAndDoesNotBlock) {
  Create();
  // As a process leaves it that is killed before its last step.
  fs::rename(folder() / "rocksdb", folder() / "rocksdb.new");
  ExpectNotOpened(absl::StatusCode::kNotFound, "holds no base map");
  ExpectNotOpened(absl::StatusCode::kNotFound, "holds no base map", StoreAccess::kReadOnly);
  EXPECT_EQ(LastSequence(*Create()), 0);
  EXPECT_FALSE(fs::exists(folder() / "rocksdb.new"));
}

TEST_F(RocksStoreTest, RefusesASecondWriter) {
  auto store = Create();
  ExpectNotOpened(absl::StatusCode::kUnavailable, "another process is writing");
  store.reset();
  Open();
}

TEST_F(RocksStoreTest, ReadsBesideAWriter) {
  auto store = Create();
  ASSERT_TRUE(store->Apply(Put(kTile, 0, "first")).ok());
  const auto reader = Open(StoreAccess::kReadOnly);
  EXPECT_EQ(BytesOf(*reader, kTile), "first");
  ASSERT_TRUE(store->Apply(Put(kTile, 1, "second")).ok());
  const auto later = Open(StoreAccess::kReadOnly);
  EXPECT_EQ(BytesOf(*later, kTile), "second");
  EXPECT_EQ(BytesOf(*reader, kTile), "first");
  const auto refused = later->Apply(Put(kTile, 2, "third"));
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kFailedPrecondition) << refused.status();
  EXPECT_EQ(later->DropPatches(0).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(LastSequence(*store), 2);
}

TEST_F(RocksStoreTest, ReadersKeepTheirFilesWhileAWriterReplacesThem) {
  auto store = Create();
  const std::string first = Noise(0, 1 << 20);
  for (uint64_t cell = 0; cell < 10; ++cell) {
    ASSERT_TRUE(store->Apply(Put({1, cell}, 0, first)).ok());
  }
  const auto reader = Open(StoreAccess::kReadOnly);
  for (uint64_t version = 1; version < 8; ++version) {
    for (uint64_t cell = 0; cell < 10; ++cell) {
      const uint64_t next = version * 10 + cell;
      ASSERT_TRUE(store->Apply(Put({1, cell}, version, Noise(next, 1 << 20))).ok());
    }
    const auto later = OpenRocksStore(folder(), StoreAccess::kReadOnly);
    ASSERT_TRUE(later.ok()) << later.status();
    EXPECT_EQ(*(*later)->VersionOf({1, 9}), version + 1);
  }
  for (uint64_t cell = 0; cell < 10; ++cell) EXPECT_TRUE(BytesOf(*reader, {1, cell}) == first);
}

// ------------------------------------------------------------------------------------- damage

/// Flips a bit of the tile's bytes in whichever table holds them.
void DamageTableOf(const fs::path& folder, const std::string& bytes) {
  const std::string middle = bytes.substr(bytes.size() / 2, 64);
  int found = 0;
  for (const auto& entry : fs::directory_iterator(folder / "rocksdb")) {
    if (entry.path().extension() != ".sst") continue;
    std::string file = *ReadFile(entry.path(), 1 << 30);
    const size_t offset = file.find(middle);
    if (offset == std::string::npos) continue;
    file[offset] = static_cast<char>(file[offset] ^ 1);
    std::ofstream(entry.path(), std::ios::binary) << file;
    ++found;
  }
  ASSERT_EQ(found, 1);
}

/// Files of a store whose history has `kCommits` commits, some of them in the log alone.
class DamagedStoreTest : public RocksStoreTest {
 protected:
  static constexpr uint64_t kCommits = 40;

  DamagedStoreTest() : truth_(MakeMemoryStore("the header")) {
    Create();
    for (uint64_t sequence = 1; sequence <= kCommits; ++sequence) {
      const Commit commit = HistoryCommit(sequence, *truth_, 3000);
      truth_->Apply(commit).IgnoreError();
      if (sequence % 8 == 1) store_.reset();
      if (!store_) store_ = Open();
      store_->Apply(commit).IgnoreError();
    }
    store_.reset();
    fs::rename(folder(), scratch_ / "whole");
  }

  std::vector<std::string> Files() const {
    std::vector<std::string> files;
    for (const auto& entry : fs::directory_iterator(scratch_ / "whole" / "rocksdb")) {
      files.push_back(entry.path().filename().string());
    }
    std::sort(files.begin(), files.end());
    return files;
  }

  std::string FileBytes(const std::string& file) const {
    return *ReadFile(scratch_ / "whole" / "rocksdb" / file, 1 << 30);
  }

  /// Makes the folder anew, with these bytes in one file.
  void Damage(const std::string& file, const std::string& bytes) {
    fs::remove_all(folder());
    fs::copy(scratch_ / "whole", folder(), fs::copy_options::recursive);
    std::ofstream(folder() / "rocksdb" / file, std::ios::binary) << bytes;
  }

  /// That nothing is wrong that is read; what is lost, or nothing if the store is not opened.
  std::optional<Losses> ReadAll(StoreAccess access, const std::string& where) {
    SCOPED_TRACE(where);
    const auto store = OpenRocksStore(folder(), access);
    if (!store.ok()) {
      EXPECT_EQ(store.status().code(), absl::StatusCode::kDataLoss) << store.status();
      EXPECT_THAT(std::string(store.status().message()),
                  AllOf(HasSubstr(folder().string()), HasSubstr("carmap base verify")));
      return std::nullopt;
    }
    return Compare(**store, *truth_, HistoryKeys(kCommits));
  }

  /// That each tile is what it was, is named as damaged, or is older if commits were lost. Whether
  /// all are what they were.
  bool ExpectRightOrLost(const MapReader& reader, uint64_t lost_commits) const {
    bool is_whole = lost_commits == 0;
    const auto listed = reader.ListTiles();
    EXPECT_TRUE(listed.ok()) << listed.status();
    const std::vector<TileVersion> expected = *truth_->ListTiles();
    for (const TileVersion& tile : expected) {
      const auto version = reader.VersionOf(tile.tile);
      EXPECT_TRUE(version.ok());
      EXPECT_LE(*version, tile.version);
      EXPECT_TRUE(*version == tile.version || lost_commits > 0);
      const auto stored = reader.ReadTile(tile.tile);
      is_whole &= stored.ok();
      if (!stored.ok()) {
        EXPECT_EQ(stored.status().code(), absl::StatusCode::kDataLoss) << stored.status();
      } else if (*version == tile.version) {
        EXPECT_EQ(stored->has_value(), !tile.is_removed);
        EXPECT_TRUE(!*stored || (*stored)->bytes == BytesOf(*truth_, tile.tile));
      }
    }
    return is_whole;
  }

  /// One that is there, in a store that has all in tables.
  TileVersion DamageATile() {
    fs::rename(scratch_ / "whole", folder());
    Open();  // to move all that is in the log to tables
    const std::vector<TileVersion> tiles = *truth_->ListTiles();
    const auto damaged = std::find_if(tiles.begin(), tiles.end(),
                                      [](const TileVersion& tile) { return !tile.is_removed; });
    DamageTableOf(folder(), BytesOf(*truth_, damaged->tile));
    return *damaged;
  }

  std::unique_ptr<MapStore> truth_, store_;
};

TEST_F(DamagedStoreTest, IsNeverReadWrongly) {
  const int flips = CountFromEnvironment("CARMAP_FLIPS", 5);
  std::mt19937 random(7);
  std::map<std::string, int> outcomes;
  for (const std::string& file : Files()) {
    const std::string whole = FileBytes(file);
    for (int i = 0; i < flips && !whole.empty(); ++i) {
      std::string bytes = whole;
      const size_t offset = i < 2 ? (i == 0 ? 0 : whole.size() - 1) : random() % whole.size();
      bytes[offset] = static_cast<char>(bytes[offset] ^ (1 << random() % 8));
      Damage(file, bytes);
      const auto access = i % 3 == 0 ? StoreAccess::kReadWrite : StoreAccess::kReadOnly;
      const auto losses =
          ReadAll(access, fmt::format("{} at {} of {}", file, offset, whole.size()));
      ++outcomes[!losses ? "refused" : losses->messages.empty() ? "unharmed" : "partly lost"];
      if (HasFailure()) return;
    }
  }
  for (const auto& [outcome, count] : outcomes) RecordProperty(outcome, count);
}

TEST_F(DamagedStoreTest, IsNeverReadWronglyWhenCutShortOrWithoutAFile) {
  for (const std::string& file : Files()) {
    const std::string whole = FileBytes(file);
    for (const size_t size : {size_t{0}, whole.size() / 2, whole.size() - 1}) {
      if (size >= whole.size()) continue;
      Damage(file, whole.substr(0, size));
      ReadAll(size % 2 == 0 ? StoreAccess::kReadOnly : StoreAccess::kReadWrite,
              fmt::format("{} cut to {}", file, size));
    }
    Damage(file, whole);
    fs::remove(folder() / "rocksdb" / file);
    ReadAll(StoreAccess::kReadOnly, file + " removed");
    ReadAll(StoreAccess::kReadWrite, file + " removed");
    if (HasFailure()) return;
  }
}

TEST_F(DamagedStoreTest, LosesOneTileAloneAndGoesOn) {
  const TileVersion damaged = DamageATile();
  const std::string name = fmt::format("tile 1/{:016x} is damaged", damaged.tile.cell);
  for (const StoreAccess access : {StoreAccess::kReadOnly, StoreAccess::kReadWrite}) {
    const auto store = Open(access);
    const Losses losses = Compare(*store, *truth_, HistoryKeys(kCommits));
    EXPECT_EQ(losses.tiles, 1);
    EXPECT_THAT(losses.messages, ElementsAre(HasSubstr(name)));
    EXPECT_EQ(store->ReadTile(damaged.tile).status().code(), absl::StatusCode::kDataLoss);
  }
  // Tables of which one is damaged cannot be merged; commits go on all the same.
  const auto store = Open();
  const TileId other{1, 5};
  for (uint64_t version = 0; version < 40; ++version) {
    ASSERT_TRUE(store->Apply(Put(other, version, Noise(version, 4 << 20))).ok());
  }
  EXPECT_TRUE(BytesOf(*store, other) == Noise(39, 4 << 20));
  ASSERT_TRUE(store->Apply(Put(damaged.tile, damaged.version, "mended")).ok());
  EXPECT_EQ(BytesOf(*store, damaged.tile), "mended");
}

TEST_F(DamagedStoreTest, TellsOfLostCommits) {
  // The last write of the log, which RocksDB takes for one that a killed process did not end.
  std::string log;
  for (const std::string& file : Files()) {
    if (fs::path(file).extension() == ".log" && !FileBytes(file).empty()) log = file;
  }
  const std::string whole = FileBytes(log);
  Damage(log, whole.substr(0, whole.size() - 100));
  ExpectNotOpened(absl::StatusCode::kDataLoss, "commits 40 to 40 are missing");
  // Refusing it has changed nothing.
  std::ofstream(folder() / "rocksdb" / log, std::ios::binary) << whole;
  EXPECT_THAT(Compare(*Open(), *truth_, HistoryKeys(kCommits)).messages, IsEmpty());
}

TEST_F(DamagedStoreTest, IsRepairedWhateverFileIsDamaged) {
  std::mt19937 random(9);
  int opened_by_repair = 0, unharmed = 0;
  for (const std::string& file : Files()) {
    const std::string whole = FileBytes(file);
    if (whole.empty()) continue;
    for (int i = 0; i < 3; ++i) {
      std::string bytes = whole;
      if (i == 0) {
        bytes.resize(whole.size() / 2);
      } else {
        const size_t offset = random() % whole.size();
        bytes[offset] = static_cast<char>(bytes[offset] ^ (1 << random() % 8));
      }
      Damage(file, bytes);
      SCOPED_TRACE(fmt::format("{}, {}", file, i));
      if (!absl::IsDataLoss(OpenRocksStore(folder(), StoreAccess::kReadWrite).status())) continue;
      const auto made = RepairRocksStore(folder(), "the header", "lost");
      ASSERT_TRUE(made.ok()) << made.status();
      EXPECT_TRUE(fs::exists(made->damaged / file));
      const auto store = Open();
      ++opened_by_repair;
      EXPECT_EQ(*store->Header(), "the header");
      unharmed += ExpectRightOrLost(*store, made->lost_commits + made->lost_journal_entries);
      EXPECT_TRUE(store->ReadJournal(1, SIZE_MAX).ok());
      Commit next;
      next.journal_text = "after";
      EXPECT_TRUE(store->Apply(next).ok());
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(opened_by_repair, 5);
  EXPECT_GT(unharmed, opened_by_repair / 2);
}

TEST_F(RocksStoreTest, IsRepairedWhenAllIsInTheLog) {
  ASSERT_TRUE(Create()->Apply(Put(kTile, 0, "first")).ok());
  std::ofstream(folder() / "rocksdb" / "CURRENT") << "nonsense";
  ExpectNotOpened(absl::StatusCode::kDataLoss, "--repair");
  const auto made = RepairRocksStore(folder(), "", "lost");
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_EQ(made->lost_commits + made->lost_journal_entries, 0u);
  EXPECT_EQ(BytesOf(*Open(), kTile), "first");
}

TEST_F(DamagedStoreTest, RepairLeavesOutNoMoreThanWhatIsDamaged) {
  DamageATile();
  EXPECT_EQ(Open()->VerifyFiles().code(), absl::StatusCode::kDataLoss);
  ASSERT_TRUE(RepairRocksStore(folder(), "", "lost").ok());
  const auto store = Open();
  EXPECT_TRUE(store->VerifyFiles().ok());
  EXPECT_EQ(Compare(*store, *truth_, HistoryKeys(kCommits)).tiles, 1);
}

TEST_F(DamagedStoreTest, LosesNothingWithItsListOfTables) {
  for (const std::string& file : Files()) {
    if (!file.starts_with("MANIFEST") && file != "CURRENT") continue;
    Damage(file, "nothing");
    ExpectNotOpened(absl::StatusCode::kDataLoss, "--repair");
    ASSERT_TRUE(RepairRocksStore(folder(), "", "lost").ok());
    EXPECT_THAT(Compare(*Open(), *truth_, HistoryKeys(kCommits)).messages, IsEmpty()) << file;
  }
}

// ------------------------------------------------------------------------- other processes

/// This test program again, running the test ChildProcess.Runs alone. (Its threads would not live
/// on in a fork.)
class Child {
 public:
  Child(const std::string& task, const fs::path& folder) {
    int ends[2];
    EXPECT_EQ(::pipe2(ends, O_CLOEXEC), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], kReports);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    std::vector<std::string> environment = {"CARMAP_STORE_TASK=" + task,
                                            "CARMAP_STORE_FOLDER=" + folder.string()};
    std::vector<char*> variables;
    for (std::string& variable : environment) variables.push_back(variable.data());
    for (char** variable = environ; *variable != nullptr; ++variable) {
      variables.push_back(*variable);
    }
    variables.push_back(nullptr);
    std::string program = "/proc/self/exe";
    std::string filter = "--gtest_filter=ChildProcess.Runs";
    char* arguments[] = {program.data(), filter.data(), nullptr};
    EXPECT_EQ(::posix_spawn(&pid_, program.c_str(), &actions, nullptr, arguments, variables.data()),
              0);
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    reports_ = ends[0];
  }
  ~Child() {
    Kill();
    ::close(reports_);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  /// Nothing once the child has ended.
  std::optional<uint64_t> Report() {
    uint64_t value = 0;
    return ::read(reports_, &value, sizeof(value)) == sizeof(value) ? std::optional(value)
                                                                    : std::nullopt;
  }

  void Kill() {
    if (pid_ > 0) ::kill(pid_, SIGKILL);
    Wait();
  }

  void Wait() {
    if (pid_ > 0) ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

  static void SendReport(uint64_t value) {
    if (::write(kReports, &value, sizeof(value)) != sizeof(value)) std::abort();
  }

 private:
  static constexpr int kReports = 33;

  pid_t pid_ = -1;
  int reports_ = -1;
};

/// Of sizes that need one write or many.
Commit ChildCommit(uint64_t sequence, const MapReader& now) {
  constexpr size_t kSizes[] = {50, 20000, 300, 900000};
  return HistoryCommit(sequence, now, kSizes[sequence % 4]);
}

/// Commits for ever, and reports each commit that is acknowledged.
void CommitForEver(MapStore& store, std::chrono::milliseconds pause) {
  for (uint64_t sequence = LastSequence(store) + 1;; ++sequence) {
    const auto applied = store.Apply(ChildCommit(sequence, store));
    if (!applied.ok() || *applied != sequence) std::abort();
    Child::SendReport(sequence);
    std::this_thread::sleep_for(pause);
  }
}

TEST(ChildProcess, Runs) {
  const char* task = std::getenv("CARMAP_STORE_TASK");
  const char* folder = std::getenv("CARMAP_STORE_FOLDER");
  if (task == nullptr || folder == nullptr) GTEST_SKIP() << "other tests start it";
  const bool is_new = !fs::exists(fs::path(folder) / "rocksdb");
  auto store = is_new ? CreateRocksStore(folder, "the header")
                      : OpenRocksStore(folder, StoreAccess::kReadWrite);
  if (!store.ok()) std::abort();
  Child::SendReport(0);
  const bool is_calm = task == std::string("commit calmly");
  CommitForEver(**store, std::chrono::milliseconds(is_calm ? 2 : 0));
}

/// The history's commits once more in memory, up to a sequence.
void AdvanceTo(uint64_t sequence, MapStore& truth) {
  for (uint64_t next = LastSequence(truth) + 1; next <= sequence; ++next) {
    ASSERT_EQ(*truth.Apply(ChildCommit(next, truth)), next);
  }
}

TEST_F(RocksStoreTest, RefusesWhatAnotherProcessWritesAndReadsIt) {
  Create();
  Child child("commit calmly", folder());
  uint64_t acknowledged = 0;
  const auto wait_for = [&](uint64_t sequence) {
    while (acknowledged < sequence) {
      const auto report = child.Report();
      ASSERT_TRUE(report);
      acknowledged = *report;
    }
  };
  wait_for(3);
  ExpectNotOpened(absl::StatusCode::kUnavailable, "another process is writing");
  const auto truth = MakeMemoryStore("the header");
  for (int i = 0; i < 10; ++i) {
    const auto store = Open(StoreAccess::kReadOnly);
    const uint64_t seen = LastSequence(*store);
    EXPECT_GE(seen, acknowledged);
    AdvanceTo(seen, *truth);
    EXPECT_THAT(Compare(*store, *truth, HistoryKeys(seen)).messages, IsEmpty());
    wait_for(seen + 5);
  }
}

TEST_F(RocksStoreTest, KilledAtAnyMomentKeepsWhatWasAcknowledged) {
  const int kills = CountFromEnvironment("CARMAP_KILLS", 20);
  std::mt19937 random(3);
  const auto truth = MakeMemoryStore("the header");
  uint64_t acknowledged = 0;
  for (int kill = 0; kill < kills; ++kill) {
    {
      Child child("commit", folder());
      // At times while it is being created or opened.
      const int patience = kill % 5 == 0 ? 0 : 1 + static_cast<int>(random() % 150);
      for (int i = 0; i < patience; ++i) {
        const auto report = child.Report();
        ASSERT_TRUE(report);
        acknowledged = std::max(acknowledged, *report);
      }
      std::this_thread::sleep_for(std::chrono::microseconds(random() % 30000));
      child.Kill();
      while (const auto report = child.Report()) acknowledged = std::max(acknowledged, *report);
    }
    const auto store =
        OpenRocksStore(folder(), kill % 2 == 0 ? StoreAccess::kReadOnly : StoreAccess::kReadWrite);
    if (absl::IsNotFound(store.status()) && acknowledged == 0) continue;
    ASSERT_TRUE(store.ok()) << store.status();
    const uint64_t kept = LastSequence(**store);
    EXPECT_GE(kept, acknowledged);
    EXPECT_LE(kept, acknowledged + 1);
    AdvanceTo(kept, *truth);
    ASSERT_THAT(Compare(**store, *truth, HistoryKeys(kept)).messages, IsEmpty());
    acknowledged = kept;
  }
  RecordProperty("commits", std::to_string(acknowledged));
}

// ------------------------------------------------------------------------------- full disk

/// Commits until the disk is full; returns how many commits there are then.
uint64_t Fill(MapStore& store, MapStore& truth) {
  for (uint64_t sequence = LastSequence(store) + 1;; ++sequence) {
    const Commit commit = HistoryCommit(sequence, truth, 200000);
    const auto applied = store.Apply(commit);
    if (!applied.ok()) {
      EXPECT_EQ(applied.status().code(), absl::StatusCode::kResourceExhausted) << applied.status();
      return sequence - 1;
    }
    truth.Apply(commit).IgnoreError();
  }
}

/// Whether a commit succeeds within some seconds, in which RocksDB may still be recovering.
void ExpectCommitsAgain(MapStore& store, MapStore& truth) {
  const uint64_t sequence = LastSequence(store) + 1;
  const Commit commit = HistoryCommit(sequence, truth, 1000);
  auto applied = store.Apply(commit);
  for (int i = 0; i < 100 && !applied.ok(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    applied = store.Apply(commit);
  }
  ASSERT_TRUE(applied.ok()) << applied.status();
  EXPECT_EQ(*applied, sequence);
  truth.Apply(commit).IgnoreError();
}

TEST_F(RocksStoreTest, FullDiskRefusesCommitsUntilThereIsRoom) {
  const fs::path disk = scratch_ / "disk";
  fs::create_directory(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=100m") != 0) {
    GTEST_SKIP() << "needs the right to mount a small disk";
  }
  const std::unique_ptr<const fs::path, void (*)(const fs::path*)> unmount(
      &disk, [](const fs::path* mounted) { ::umount2(mounted->c_str(), MNT_DETACH); });
  const auto truth = MakeMemoryStore("the header");
  auto store = Must(CreateRocksStore(disk / "base", "the header"));
  for (int round = 0; round < 4; ++round) {
    std::ofstream(disk / "ballast", std::ios::binary) << std::string((56 + round) << 20, 'x');
    const uint64_t count = Fill(*store, *truth);
    EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count)).messages, IsEmpty());
    fs::remove(disk / "ballast");
    ExpectCommitsAgain(*store, *truth);
    EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count + 1)).messages, IsEmpty());
    if (round % 2 == 0) continue;
    store.reset();
    store = Must(OpenRocksStore(disk / "base", StoreAccess::kReadWrite));
    EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count + 1)).messages, IsEmpty());
  }
  EXPECT_FALSE(CreateRocksStore(disk / "no" / "base", "").ok());
}

/// No file of this process grows beyond a size, as with a quota.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t size) : handler_(::signal(SIGXFSZ, SIG_IGN)) {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = size;
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    ::signal(SIGXFSZ, handler_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_;
  void (*handler_)(int);
};

TEST_F(RocksStoreTest, LimitOfFilesRefusesCommitsUntilItIsGone) {
  const auto truth = MakeMemoryStore("the header");
  auto store = Create();
  {
    const auto snapshot = store->Snapshot();
    const uint64_t before = LastSequence(*truth);
    {
      const FileSizeLimit limit(1000000);
      const uint64_t count = Fill(*store, *truth);
      EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count)).messages, IsEmpty());
    }
    const auto refused = store->Apply({});
    EXPECT_EQ(refused.status().code(), absl::StatusCode::kUnavailable) << refused.status();
    EXPECT_THAT(std::string(refused.status().message()), HasSubstr("1 snapshots are read"));
    EXPECT_EQ(LastSequence(*snapshot), before);
  }
  for (int round = 0; round < 3; ++round) {
    {
      const FileSizeLimit limit(1000000);
      Fill(*store, *truth);
      const uint64_t count = Fill(*store, *truth);
      EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count)).messages, IsEmpty());
    }
    ExpectCommitsAgain(*store, *truth);
  }
  const uint64_t count = LastSequence(*truth);
  EXPECT_THAT(Compare(*store, *truth, HistoryKeys(count)).messages, IsEmpty());
  EXPECT_THAT(Compare(*Open(StoreAccess::kReadOnly), *truth, HistoryKeys(count)).messages,
              IsEmpty());
  store.reset();
  EXPECT_THAT(Compare(*Open(), *truth, HistoryKeys(count)).messages, IsEmpty());
}

}  // namespace
}  // namespace carmap
