// Layout of a base map's folder: decision 0023.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <mutex>
#include <system_error>
#include <thread>

#include "carmap/base/status_macros.h"
#include "carmap/store/commit_check.h"
#include "carmap/store/map_store.h"
#include "carmap/store/rocks_database.h"
#include "carmap/store/rocks_folder.h"
#include "carmap/store/rocks_keys.h"
#include "carmap/store/rocks_reader.h"
#include "carmap/store/snapshot_reads.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMetadata = "the store's metadata";

/// That the format is known, and that nothing is missing which was acknowledged.
absl::Status CheckContents(const std::shared_ptr<RocksDatabase>& database, const fs::path& folder,
                           std::optional<uint64_t> acknowledged) {
  CARMAP_RETURN_IF_ERROR(Translate(database->VerifyMeta(), folder, kMetadata));
  const RocksReader reader(database, folder);
  CARMAP_ASSIGN_OR_RETURN(const uint32_t format, reader.Format());
  if (format > kStoreFormat) {
    return absl::UnimplementedError(
        fmt::format("{}: made by a newer version (format {}, this one reads {}); upgrade carmap",
                    folder.string(), format, kStoreFormat));
  }
  CARMAP_RETURN_IF_ERROR(reader.Header().status());
  CARMAP_ASSIGN_OR_RETURN(const uint64_t sequence, reader.Sequence());
  if (sequence < acknowledged.value_or(0)) {
    return Damaged(folder, kMetadata,
                   fmt::format("commits {} to {} are missing", sequence + 1, *acknowledged));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<RocksDatabase>> OpenChecked(const fs::path& folder,
                                                           DatabaseAccess access) {
  // Before the database, to which a writer beside this process may add.
  const auto acknowledged = AcknowledgedRecord::Read(DatabaseIn(folder));
  CARMAP_ASSIGN_OR_RETURN(std::shared_ptr<RocksDatabase> database,
                          RocksDatabase::Open(DatabaseIn(folder), access));
  CARMAP_RETURN_IF_ERROR(CheckContents(database, folder, acknowledged));
  return database;
}

/// Opens a store to read in which some table is damaged, if metadata and log are whole.
absl::StatusOr<std::shared_ptr<RocksDatabase>> OpenDamaged(const fs::path& folder,
                                                           DatabaseAccess access) {
  if (!AcknowledgedRecord::Read(DatabaseIn(folder))) {
    return Damaged(folder, kMetadata, "a table and the record of what was acknowledged");
  }
  CARMAP_RETURN_IF_ERROR(OpenChecked(folder, DatabaseAccess::kReadMeta).status());
  return RocksDatabase::Open(DatabaseIn(folder), access);
}

absl::StatusOr<std::shared_ptr<RocksDatabase>> OpenReadable(const fs::path& folder) {
  auto database = OpenChecked(folder, DatabaseAccess::kRead);
  if (!absl::IsDataLoss(database.status())) return database;
  return OpenDamaged(folder, DatabaseAccess::kReadDamaged);
}

/// Of which metadata and log are known to be whole.
absl::StatusOr<std::shared_ptr<RocksDatabase>> OpenWritable(const fs::path& folder) {
  auto database = RocksDatabase::Open(DatabaseIn(folder), DatabaseAccess::kWrite);
  if (!absl::IsDataLoss(database.status())) return database;
  return OpenDamaged(folder, DatabaseAccess::kWriteDamaged);
}

/// What only a store that may be written has.
struct Writer {
  Descriptor lock;
  AcknowledgedRecord acknowledged;
  uint64_t sequence = 0;
};

class RocksStore final : public SnapshotReads {
 public:
  RocksStore(fs::path folder, std::shared_ptr<RocksDatabase> database, std::optional<Writer> writer)
      : folder_(std::move(folder)), writer_(std::move(writer)), database_(std::move(database)) {}

  absl::StatusOr<uint64_t> Apply(const Commit& commit) override {
    const std::lock_guard lock(mutex_);
    CARMAP_RETURN_IF_ERROR(PrepareToWrite());
    CARMAP_RETURN_IF_ERROR(Check(commit));
    const uint64_t sequence = writer_->sequence + 1;
    rocksdb::WriteBatch batch = BatchOf(commit, sequence);
    CARMAP_RETURN_IF_ERROR(Translate(database_->Write(batch), folder_, "the commit"));
    writer_->sequence = sequence;
    writer_->acknowledged.Write(sequence);
    return sequence;
  }

  std::unique_ptr<const MapReader> Snapshot() const override {
    const std::lock_guard lock(database_mutex_);
    return std::make_unique<RocksReader>(database_, folder_);
  }

  absl::Status DropPatches(size_t kept) override {
    const std::lock_guard lock(mutex_);
    CARMAP_RETURN_IF_ERROR(PrepareToWrite());
    const RocksReader reader(database_, folder_);
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, reader.ListTiles());
    rocksdb::WriteBatch batch;
    for (const TileVersion& tile : tiles) {
      if (tile.version > kept) CARMAP_RETURN_IF_ERROR(DropPatches(reader, tile, kept, batch));
    }
    CARMAP_RETURN_IF_ERROR(Translate(database_->Write(batch), folder_, "the patches"));
    return Translate(database_->db().CompactRange({}, family(Family::kPatches), nullptr, nullptr),
                     folder_, "the patches");
  }

  absl::Status DropPatchesOf(TileId tile) override {
    const std::lock_guard lock(mutex_);
    CARMAP_RETURN_IF_ERROR(PrepareToWrite());
    rocksdb::WriteBatch batch;
    batch.DeleteRange(family(Family::kPatches), PatchKey(tile, 0), PatchKey(tile, UINT64_MAX));
    return Translate(database_->Write(batch), folder_, "the patches");
  }

  absl::Status VerifyFiles() const override {
    std::shared_ptr<RocksDatabase> database;
    {
      const std::lock_guard lock(database_mutex_);
      database = database_;
    }
    return Translate(database->db().VerifyChecksum(), folder_, "a table");
  }

 private:
  rocksdb::ColumnFamilyHandle* family(Family family) const { return database_->family(family); }

  absl::Status PrepareToWrite() {
    if (!writer_) {
      return absl::FailedPreconditionError(
          fmt::format("{}: opened to read only; open it to write", folder_.string()));
    }
    return database_->has_failed() ? Reopen() : absl::OkStatus();
  }

  /// Replaces a database that takes no more; if that fails, by one to read.
  absl::Status Reopen() {
    CARMAP_RETURN_IF_ERROR(CheckRoom(DatabaseIn(folder_)));
    const std::lock_guard lock(database_mutex_);
    CARMAP_RETURN_IF_ERROR(WaitForReaders());
    CARMAP_ASSIGN_OR_RETURN(std::shared_ptr<RocksDatabase> readable, OpenReadable(folder_));
    database_.reset();
    auto writable = OpenWritable(folder_);
    if (!writable.ok()) {
      database_ = std::move(readable);
      return writable.status();
    }
    database_ = *std::move(writable);
    CARMAP_ASSIGN_OR_RETURN(writer_->sequence, RocksReader(database_, folder_).Sequence());
    return absl::OkStatus();
  }

  /// Those that read in this moment; snapshots may last.
  absl::Status WaitForReaders() const {
    constexpr int kAttempts = 100;
    constexpr std::chrono::milliseconds kPause(2);
    for (int i = 0; i < kAttempts && database_.use_count() > 1; ++i) {
      std::this_thread::sleep_for(kPause);
    }
    if (database_.use_count() == 1) return absl::OkStatus();
    return absl::UnavailableError(
        fmt::format("{}: a write has failed, and none follows while {} snapshots are read; "
                    "release them and try again",
                    folder_.string(), database_.use_count() - 1));
  }

  absl::Status Check(const Commit& commit) const {
    const RocksReader reader(database_, folder_);
    return CheckCommit(commit,
                       {folder_.string(), [&](TileId tile) { return reader.FindTile(tile); },
                        [&](std::string_view key) { return reader.HasContribution(key); }});
  }

  rocksdb::WriteBatch BatchOf(const Commit& commit, uint64_t sequence) const {
    rocksdb::WriteBatch batch;
    for (const TileChange& change : commit.tiles) Add(change, batch);
    for (const auto& [component, bytes] : commit.components) {
      if (bytes.empty()) {
        batch.Delete(family(Family::kMeta), ComponentKey(component));
      } else {
        batch.Put(family(Family::kMeta), ComponentKey(component), bytes);
      }
    }
    for (const auto& [key, value] : commit.contributions) {
      batch.Put(family(Family::kContributions), key, value);
    }
    for (const std::string& key : commit.withdrawn) {
      batch.Delete(family(Family::kContributions), key);
    }
    batch.Put(family(Family::kJournal), SequenceKey(sequence), commit.journal_text);
    batch.Put(family(Family::kMeta), rocksdb::Slice(kSequenceKey.data(), kSequenceKey.size()),
              SequenceKey(sequence));
    return batch;
  }

  void Add(const TileChange& change, rocksdb::WriteBatch& batch) const {
    const std::string key = TileKey(change.tile);
    const uint64_t version = change.from_version + 1;
    batch.Put(family(Family::kMeta), VersionKey(change.tile),
              EncodeVersion(version, !change.bytes));
    batch.Put(family(Family::kPatches), PatchKey(change.tile, version),
              EncodePatch(change.patch, change.inverse));
    if (change.bytes) {
      batch.Put(family(Family::kTiles), key, EncodeVersioned(version, *change.bytes));
      batch.Put(family(Family::kWords), key, EncodeVersioned(version, change.words));
    } else {
      batch.Delete(family(Family::kTiles), key);
      batch.Delete(family(Family::kWords), key);
    }
  }

  absl::Status DropPatches(const RocksReader& reader, const TileVersion& tile, size_t kept,
                           rocksdb::WriteBatch& batch) const {
    return reader.Scan(
        Family::kPatches, PatchKey(tile.tile, 1), PatchKey(tile.tile, tile.version - kept + 1),
        fmt::format("a patch of {}", NameOf(tile.tile)),
        [&](std::string_view key, std::string_view) {
          batch.Delete(family(Family::kPatches), rocksdb::Slice(key.data(), key.size()));
          return absl::OkStatus();
        });
  }

  const fs::path folder_;
  std::mutex mutex_;  ///< of those who write; before database_mutex_
  std::optional<Writer> writer_;
  mutable std::mutex database_mutex_;  ///< of which database it is
  std::shared_ptr<RocksDatabase> database_;
};

fs::path UnfinishedIn(const fs::path& folder) { return folder / "rocksdb.new"; }

/// Unavailable if a writer beside this process removed a log meanwhile: the commits that it held
/// could be missing here, being in a table that is newer than the list of tables that was read.
absl::StatusOr<std::shared_ptr<RocksDatabase>> OpenUndisturbed(const fs::path& folder) {
  const FilesSeen before = LookAt(DatabaseIn(folder));
  auto database = OpenChecked(folder, DatabaseAccess::kRead);
  FilesSeen after = LookAt(DatabaseIn(folder));
  if (database.ok() &&
      std::includes(after.logs.begin(), after.logs.end(), before.logs.begin(), before.logs.end())) {
    return database;
  }
  // What looks like damage is none if tables were replaced.
  if (after == before && absl::IsDataLoss(database.status())) {
    database = OpenDamaged(folder, DatabaseAccess::kReadDamaged);
    after = LookAt(DatabaseIn(folder));
  }
  if (after == before) return database;
  return absl::UnavailableError(
      fmt::format("{}: another process writes too much; try again", folder.string()));
}

absl::StatusOr<std::unique_ptr<MapStore>> OpenToRead(const fs::path& folder) {
  constexpr int kAttempts = 100;
  constexpr std::chrono::milliseconds kPause(10);
  auto database = OpenUndisturbed(folder);
  for (int i = 1; i < kAttempts && absl::IsUnavailable(database.status()); ++i) {
    std::this_thread::sleep_for(kPause);
    database = OpenUndisturbed(folder);
  }
  CARMAP_RETURN_IF_ERROR(database.status());
  return std::make_unique<RocksStore>(folder, *std::move(database), std::nullopt);
}

/// Nothing is changed before it is known that metadata and log are whole: to open a database that
/// lost its last commits would remove what they could be restored from.
absl::StatusOr<std::unique_ptr<MapStore>> OpenToWrite(const fs::path& folder, Descriptor lock) {
  CARMAP_RETURN_IF_ERROR(OpenChecked(folder, DatabaseAccess::kReadMeta).status());
  CARMAP_ASSIGN_OR_RETURN(auto database, OpenWritable(folder));
  CARMAP_ASSIGN_OR_RETURN(const uint64_t sequence, RocksReader(database, folder).Sequence());
  CARMAP_ASSIGN_OR_RETURN(auto acknowledged, AcknowledgedRecord::Open(DatabaseIn(folder)));
  acknowledged.Write(sequence);
  return std::make_unique<RocksStore>(folder, std::move(database),
                                      Writer{std::move(lock), std::move(acknowledged), sequence});
}

/// What a process that was killed here left unfinished does not count.
absl::Status CheckEmpty(const fs::path& folder) {
  std::error_code error;
  if (fs::exists(DatabaseIn(folder), error)) {
    return absl::AlreadyExistsError(
        fmt::format("{}: holds a base map already; choose another folder", folder.string()));
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    if (entry.path() == UnfinishedIn(folder)) continue;
    return absl::AlreadyExistsError(
        fmt::format("{}: is not empty; choose a folder that is, or a new one", folder.string()));
  }
  return error ? CannotWrite(folder, error.value()) : absl::OkStatus();
}

absl::Status WriteEmptyStore(const fs::path& path, std::string_view header) {
  CARMAP_ASSIGN_OR_RETURN(const auto database, RocksDatabase::Open(path, DatabaseAccess::kCreate));
  std::string format;
  AppendBigEndian(kStoreFormat, format);
  rocksdb::WriteBatch batch;
  const auto put = [&](std::string_view key, std::string_view value) {
    batch.Put(database->family(Family::kMeta), rocksdb::Slice(key.data(), key.size()),
              rocksdb::Slice(value.data(), value.size()));
  };
  put(kFormatKey, format);
  put(kHeaderKey, header);
  put(kSequenceKey, SequenceKey(0));
  // Each family has a table from the beginning: a repair knows families by their tables alone.
  const std::string marker = FamilyMarker();
  for (size_t i = 0; i < kFamilyCount; ++i) {
    batch.Put(database->family(static_cast<Family>(i)), marker, "");
  }
  CARMAP_RETURN_IF_ERROR(Translate(database->Write(batch), path.parent_path(), "the header"));
  CARMAP_RETURN_IF_ERROR(Translate(database->Flush(), path.parent_path(), "the header"));
  CARMAP_ASSIGN_OR_RETURN(auto acknowledged, AcknowledgedRecord::Open(path));
  acknowledged.Write(0);
  return absl::OkStatus();
}

/// In a folder that is locked and empty.
absl::Status BuildStore(const fs::path& folder, std::string_view header) {
  const fs::path unfinished = UnfinishedIn(folder);
  std::error_code error;
  fs::remove_all(unfinished, error);
  absl::Status status = error ? CannotWrite(folder, error.value()) : absl::OkStatus();
  if (status.ok()) status = WriteEmptyStore(unfinished, header);
  if (status.ok()) {
    SyncFolder(unfinished);
    fs::rename(unfinished, DatabaseIn(folder), error);
    if (error) status = CannotWrite(folder, error.value());
  }
  if (!status.ok()) fs::remove_all(unfinished, error);
  SyncFolder(folder);
  return status;
}

}  // namespace

absl::StatusOr<std::unique_ptr<MapStore>> CreateRocksStore(const fs::path& folder,
                                                           std::string header) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
    return absl::AlreadyExistsError(
        fmt::format("{}: a file; choose an empty folder, or a new one", folder.string()));
  }
  const bool is_new = fs::create_directory(folder, error);
  if (error) return CannotWrite(folder, error.value());
  CARMAP_ASSIGN_OR_RETURN(Descriptor lock, LockFolder(folder));
  CARMAP_RETURN_IF_ERROR(CheckEmpty(folder));
  if (const absl::Status status = BuildStore(folder, header); !status.ok()) {
    if (is_new) fs::remove(folder, error);
    return status;
  }
  if (is_new) SyncFolder(fs::absolute(folder, error).lexically_normal().parent_path());
  return OpenToWrite(folder, std::move(lock));
}

absl::StatusOr<std::unique_ptr<MapStore>> OpenRocksStore(const fs::path& folder,
                                                         StoreAccess access) {
  CARMAP_RETURN_IF_ERROR(CheckHoldsStore(folder));
  if (access == StoreAccess::kReadOnly) return OpenToRead(folder);
  CARMAP_ASSIGN_OR_RETURN(Descriptor lock, LockFolder(folder));
  return OpenToWrite(folder, std::move(lock));
}

}  // namespace carmap
