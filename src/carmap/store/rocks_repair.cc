// Metadata of a store made anew from what else it holds. The files as they were are kept.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/store/map_store.h"
#include "carmap/store/rocks_database.h"
#include "carmap/store/rocks_folder.h"
#include "carmap/store/rocks_keys.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

rocksdb::Slice SliceOf(std::string_view text) { return {text.data(), text.size()}; }
std::string_view View(const rocksdb::Slice& slice) { return {slice.data(), slice.size()}; }

/// Calls visit(key, value) for all that can be read of a family.
template <typename Visitor>
void VisitReadable(const RocksDatabase& database, Family family, Visitor&& visit) {
  rocksdb::ReadOptions options;
  options.verify_checksums = true;
  const std::unique_ptr<rocksdb::Iterator> iterator(
      database.db().NewIterator(options, database.family(family)));
  for (iterator->SeekToFirst(); iterator->Valid(); iterator->Next()) {
    visit(View(iterator->key()), View(iterator->value()));
  }
  iterator->status().PermitUncheckedError();
}

/// The newest of each tile by the metadata.
std::map<TileId, TileVersion> VersionsIn(const RocksDatabase& database) {
  std::map<TileId, TileVersion> versions;
  VisitReadable(database, Family::kMeta, [&](std::string_view key, std::string_view value) {
    if (key.size() != kVersionKeySize || key.front() != kVersionPrefix) return;
    const TileId tile = TileOfVersionKey(key);
    if (const auto version = DecodeVersion(tile, value)) versions[tile] = *version;
  });
  return versions;
}

/// A table with damage goes as a whole; what of it can still be read one by one is brought over
/// from the damaged store, if that can be opened.
class Salvage {
 public:
  Salvage(const RocksDatabase& damaged, RocksDatabase& repaired)
      : damaged_(damaged), repaired_(repaired) {}

  absl::Status Run(const fs::path& folder) {
    const std::string sequence = Get(damaged_, Family::kMeta, kSequenceKey).value_or("");
    for (uint64_t i = 1; i <= ReadBigEndian<uint64_t>(sequence); ++i) {
      Bring(Family::kJournal, SequenceKey(i));
    }
    for (const auto& [tile, version] : VersionsIn(damaged_)) {
      Bring(Family::kMeta, VersionKey(tile));
      Bring(Family::kTiles, TileKey(tile));
      Bring(Family::kWords, TileKey(tile));
      for (uint64_t i = 1; i <= version.version; ++i) Bring(Family::kPatches, PatchKey(tile, i));
      if (batch_.GetDataSize() > kChunk) CARMAP_RETURN_IF_ERROR(Write(folder));
    }
    return Write(folder);
  }

 private:
  static constexpr size_t kChunk = 8 << 20;

  static std::optional<std::string> Get(const RocksDatabase& database, Family family,
                                        std::string_view key) {
    rocksdb::ReadOptions options;
    options.verify_checksums = true;
    std::string value;
    if (!database.db().Get(options, database.family(family), SliceOf(key), &value).ok()) return {};
    return value;
  }

  void Bring(Family family, std::string_view key) {
    const auto value = Get(damaged_, family, key);
    const auto present = Get(repaired_, family, key);
    if (!value || (present && !IsNewer(family, *value, *present))) return;
    batch_.Put(repaired_.family(family), SliceOf(key), *value);
  }

  /// Where the table with the newest value is gone, an older one shows. Patches and the journal
  /// never change.
  static bool IsNewer(Family family, std::string_view value, std::string_view than) {
    if (family == Family::kJournal || family == Family::kPatches) return false;
    return ByteReader(value).Uint<uint64_t>() > ByteReader(than).Uint<uint64_t>();
  }

  absl::Status Write(const fs::path& folder) {
    CARMAP_RETURN_IF_ERROR(Translate(repaired_.Write(batch_), folder, "what was saved"));
    batch_.Clear();
    return absl::OkStatus();
  }

  const RocksDatabase& damaged_;
  RocksDatabase& repaired_;
  rocksdb::WriteBatch batch_;
};

/// What the families tell of each other.
class MetaRebuilder {
 public:
  explicit MetaRebuilder(RocksDatabase& database) : database_(database) {}

  absl::StatusOr<StoreRepair> Run(const fs::path& folder, std::string_view header,
                                  std::string_view lost_journal_text) {
    bool has_header = false;
    VisitReadable(database_, Family::kMeta,
                  [&](std::string_view key, std::string_view) { has_header |= key == kHeaderKey; });
    if (!has_header) Put(kHeaderKey, header);
    Put(kFormatKey, FormatBytes());
    RebuildVersions();
    StoreRepair made;
    const uint64_t sequence = RebuildJournal(lost_journal_text, made);
    Put(kSequenceKey, SequenceKey(sequence));
    CARMAP_RETURN_IF_ERROR(Translate(database_.Write(batch_), folder, "the repaired metadata"));
    return made;
  }

  uint64_t sequence() const { return sequence_; }

 private:
  static std::string FormatBytes() {
    std::string format;
    AppendBigEndian(kStoreFormat, format);
    return format;
  }

  void Put(std::string_view key, std::string_view value) {
    batch_.Put(database_.family(Family::kMeta), SliceOf(key), SliceOf(value));
  }

  /// The newest of each tile that anything tells of. Whether one that has no bytes was removed is
  /// for its patches to say: until then it is damaged.
  void RebuildVersions() {
    std::map<TileId, TileVersion> versions = VersionsIn(database_);
    const auto raise = [&](TileId tile, uint64_t version) {
      const auto [known, is_new] = versions.try_emplace(tile, TileVersion{tile});
      if (version <= known->second.version) return;
      known->second = {tile, version, false};
      Put(VersionKey(tile), EncodeVersion(version, false));
    };
    VisitReadable(database_, Family::kTiles, [&](std::string_view key, std::string_view value) {
      ByteReader reader(value);
      const auto version = reader.Uint<uint64_t>();
      if (key.size() == TileKey({}).size() && reader.ok()) raise(TileOfKey(key), version);
    });
    VisitReadable(database_, Family::kPatches, [&](std::string_view key, std::string_view) {
      if (key.size() != PatchKey({}, 0).size()) return;
      raise(TileOfKey(key), ReadBigEndian<uint64_t>(key.substr(TileKey({}).size())));
    });
  }

  /// Fills the gaps, up to the newest entry. Returns its sequence.
  uint64_t RebuildJournal(std::string_view lost_journal_text, StoreRepair& made) {
    uint64_t next = 1;
    VisitReadable(database_, Family::kJournal, [&](std::string_view key, std::string_view) {
      const auto sequence = ReadBigEndian<uint64_t>(key);
      // Entries come one after the other: a far one is no entry of this journal.
      constexpr uint64_t kMaxGap = 1 << 20;
      if (key.size() != SequenceKey(0).size() || sequence > next + kMaxGap) return;
      for (; next < sequence; ++next) {
        batch_.Put(database_.family(Family::kJournal), SequenceKey(next),
                   SliceOf(lost_journal_text));
        ++made.lost_journal_entries;
      }
      next = sequence + 1;
    });
    sequence_ = next - 1;
    return sequence_;
  }

  RocksDatabase& database_;
  rocksdb::WriteBatch batch_;
  uint64_t sequence_ = 0;
};

/// Tables are shared, since nobody changes one; all else is copied.
absl::Status CopyDatabase(const fs::path& from, const fs::path& to, const fs::path& folder) {
  std::error_code error;
  fs::remove_all(to, error);
  fs::create_directory(to, error);
  if (error) return CannotWrite(folder, error.value());
  for (const fs::directory_entry& entry : fs::directory_iterator(from, error)) {
    if (!entry.is_regular_file()) continue;
    const fs::path copy = to / entry.path().filename();
    std::error_code no_link;
    if (entry.path().extension() == ".sst") fs::create_hard_link(entry.path(), copy, no_link);
    if (entry.path().extension() != ".sst" || no_link) fs::copy_file(entry.path(), copy, error);
    if (error) return CannotWrite(folder, error.value());
  }
  return error ? CannotWrite(folder, error.value()) : absl::OkStatus();
}

fs::path UnusedName(const fs::path& folder) {
  std::error_code error;
  for (int i = 1;; ++i) {
    const fs::path path = folder / fmt::format("rocksdb.damaged.{}", i);
    if (!fs::exists(path, error)) return path;
  }
}

}  // namespace

absl::StatusOr<StoreRepair> RepairRocksStore(const fs::path& folder, std::string_view header,
                                             std::string_view lost_journal_text) {
  CARMAP_RETURN_IF_ERROR(CheckHoldsStore(folder));
  CARMAP_ASSIGN_OR_RETURN(const Descriptor lock, LockFolder(folder));
  const std::optional<uint64_t> acknowledged = AcknowledgedRecord::Read(DatabaseIn(folder));
  const fs::path repaired = folder / "rocksdb.repaired";
  CARMAP_RETURN_IF_ERROR(CopyDatabase(DatabaseIn(folder), repaired, folder));
  StoreRepair made;
  {
    CARMAP_RETURN_IF_ERROR(RocksDatabase::Repair(repaired));
    const auto opened = RocksDatabase::Open(repaired, DatabaseAccess::kWriteDamaged);
    if (!opened.ok()) {
      std::error_code error;
      fs::remove_all(repaired, error);
      return absl::DataLossError(fmt::format(
          "{}: nothing is left that could be restored; take a copy of the base, or make a new one "
          "with `carmap base init`",
          folder.string()));
    }
    RocksDatabase* const database = opened->get();
    if (const auto damaged = RocksDatabase::Open(DatabaseIn(folder), DatabaseAccess::kReadDamaged);
        damaged.ok()) {
      CARMAP_RETURN_IF_ERROR(Salvage(**damaged, *database).Run(folder));
    }
    MetaRebuilder rebuilder(*database);
    CARMAP_ASSIGN_OR_RETURN(made, rebuilder.Run(folder, header, lost_journal_text));
    const uint64_t sequence = rebuilder.sequence();
    made.lost_commits = std::max(acknowledged.value_or(0), sequence) - sequence;
    CARMAP_ASSIGN_OR_RETURN(auto record, AcknowledgedRecord::Open(repaired));
    record.Write(sequence);
  }
  SyncFolder(repaired);
  made.damaged = UnusedName(folder);
  std::error_code error;
  fs::rename(DatabaseIn(folder), made.damaged, error);
  if (!error) fs::rename(repaired, DatabaseIn(folder), error);
  if (error) return CannotWrite(folder, error.value());
  SyncFolder(folder);
  return made;
}

}  // namespace carmap
