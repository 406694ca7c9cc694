#include "carmap/store/rocks_database.h"

#include <fmt/format.h>
#include <rocksdb/cache.h>
#include <rocksdb/filter_policy.h>
#include <rocksdb/listener.h>
#include <rocksdb/sst_file_reader.h>
#include <rocksdb/table.h>

#include <cerrno>
#include <cstring>
#include <vector>

namespace carmap {
namespace {

constexpr size_t kMegabyte = 1 << 20;

struct FamilyShape {
  const char* name;
  size_t write_buffer_size;
  bool has_large_values;  ///< which are packed already
};

/// In the order of Family. RocksDB asks for a default family in any case.
constexpr FamilyShape kFamilies[kFamilyCount] = {
    {"default", 4 * kMegabyte, false}, {"contributions", 2 * kMegabyte, false},
    {"journal", 2 * kMegabyte, false}, {"tiles", 16 * kMegabyte, true},
    {"words", 4 * kMegabyte, true},    {"patches", 8 * kMegabyte, true},
};

bool IsDamage(const rocksdb::Status& status) {
  return status.IsCorruption() || status.IsPathNotFound() || status.IsNotFound();
}

bool IsReadOnly(DatabaseAccess access) {
  return access == DatabaseAccess::kRead || access == DatabaseAccess::kReadDamaged ||
         access == DatabaseAccess::kReadMeta;
}

/// RocksDB's log of what it does would be a file to which readers write too, and once that has met
/// a full disk RocksDB aborts. All that is to be said is in statuses.
class NoLog : public rocksdb::Logger {
 public:
  using rocksdb::Logger::Logv;
  void Logv(const char*, va_list) override {}
};

rocksdb::DBOptions MakeOptions(DatabaseAccess access) {
  rocksdb::DBOptions options;
  options.create_if_missing = access == DatabaseAccess::kCreate;
  options.create_missing_column_families = options.create_if_missing;
  options.error_if_exists = options.create_if_missing;
  options.paranoid_checks =
      access != DatabaseAccess::kWriteDamaged && access != DatabaseAccess::kReadDamaged;
  // Ends before the first damage. Whether that is the write that a killed process did not end, or
  // one that was acknowledged, the store finds out by the sequence that is reached.
  options.wal_recovery_mode = rocksdb::WALRecoveryMode::kPointInTimeRecovery;
  options.track_and_verify_wals_in_manifest = true;
  options.max_total_wal_size = 32 * kMegabyte;  // which is read whenever a store is opened
  // A writer removes tables under a reader, which therefore holds all of them open.
  options.max_open_files = IsReadOnly(access) ? -1 : 256;
  options.max_background_jobs = 2;
  options.bytes_per_sync = kMegabyte;
  options.max_manifest_file_size = 4 * kMegabyte;
  options.skip_stats_update_on_db_open = true;
  options.stats_dump_period_sec = 0;
  options.stats_persist_period_sec = 0;
  options.info_log = std::make_shared<NoLog>();
  options.db_host_id.clear();
  return options;
}

std::vector<rocksdb::ColumnFamilyDescriptor> DescribeFamilies(size_t count) {
  rocksdb::BlockBasedTableOptions table;
  table.block_cache = rocksdb::NewLRUCache(16 * kMegabyte);
  // A value is a block of its own, so that damage costs no other.
  table.block_size = 1;
  const std::shared_ptr<rocksdb::TableFactory> large_values(
      rocksdb::NewBlockBasedTableFactory(table));
  table.block_size = 4096;
  table.filter_policy.reset(rocksdb::NewBloomFilterPolicy(10));
  const std::shared_ptr<rocksdb::TableFactory> small_values(
      rocksdb::NewBlockBasedTableFactory(table));
  std::vector<rocksdb::ColumnFamilyDescriptor> descriptors;
  for (size_t i = 0; i < count; ++i) {
    rocksdb::ColumnFamilyOptions options;
    options.write_buffer_size = kFamilies[i].write_buffer_size;
    options.compression =
        kFamilies[i].has_large_values ? rocksdb::kNoCompression : rocksdb::kLZ4Compression;
    options.target_file_size_base = 32 * kMegabyte;
    options.level_compaction_dynamic_level_bytes = true;
    options.table_factory = kFamilies[i].has_large_values ? large_values : small_values;
    descriptors.emplace_back(kFamilies[i].name, options);
  }
  return descriptors;
}

}  // namespace

/// What went wrong in RocksDB's own threads, and in writes.
class RocksDatabase::ErrorListener : public rocksdb::EventListener {
 public:
  void OnBackgroundError(rocksdb::BackgroundErrorReason reason, rocksdb::Status* status) override {
    if (reason != rocksdb::BackgroundErrorReason::kCompaction) {
      has_failed = true;
      return;
    }
    // Commits go on although old tables cannot be merged now.
    if (IsDamage(*status)) has_damage = true;
    *status = rocksdb::Status::OK();
  }

  void OnErrorRecoveryBegin(rocksdb::BackgroundErrorReason, rocksdb::Status,
                            bool* auto_recovery) override {
    *auto_recovery = false;
  }

  std::atomic<bool> has_damage = false;
  std::atomic<bool> has_failed = false;
};

absl::StatusOr<std::unique_ptr<RocksDatabase>> RocksDatabase::Open(
    const std::filesystem::path& path, DatabaseAccess access) {
  auto database = std::unique_ptr<RocksDatabase>(new RocksDatabase(access));
  database->listener_ = std::make_shared<ErrorListener>();
  rocksdb::DBOptions options = MakeOptions(access);
  options.listeners.push_back(database->listener_);
  const auto families = DescribeFamilies(access == DatabaseAccess::kReadMeta ? 1 : kFamilyCount);
  std::vector<rocksdb::ColumnFamilyHandle*> handles;
  rocksdb::DB* db = nullptr;
  const rocksdb::Status status =
      IsReadOnly(access)
          ? rocksdb::DB::OpenForReadOnly(options, path.string(), families, &handles, &db)
          : rocksdb::DB::Open(options, path.string(), families, &handles, &db);
  const std::filesystem::path folder = path.parent_path();
  if (!status.ok()) return Translate(status, folder, "the store");
  database->db_.reset(db);
  std::copy(handles.begin(), handles.end(), database->handles_.begin());
  return database;
}

absl::Status RocksDatabase::Repair(const std::filesystem::path& path) {
  return Translate(rocksdb::RepairDB(path.string(), MakeOptions(DatabaseAccess::kWriteDamaged),
                                     DescribeFamilies(kFamilyCount)),
                   path.parent_path(), "the store");
}

RocksDatabase::~RocksDatabase() {
  for (rocksdb::ColumnFamilyHandle* handle : handles_) {
    if (handle != nullptr) db_->DestroyColumnFamilyHandle(handle);
  }
}

rocksdb::Status RocksDatabase::VerifyMeta() const {
  std::vector<rocksdb::LiveFileMetaData> files;
  db_->GetLiveFilesMetaData(&files);
  for (const rocksdb::LiveFileMetaData& file : files) {
    if (file.column_family_name != kFamilies[0].name) continue;
    rocksdb::SstFileReader reader((rocksdb::Options()));
    rocksdb::Status status = reader.Open(file.db_path + file.name);
    if (status.ok()) status = reader.VerifyChecksum();
    if (!status.ok()) return status;
  }
  return rocksdb::Status::OK();
}

bool RocksDatabase::has_failed() const { return IsReadOnly(access_) || listener_->has_failed; }

rocksdb::Status RocksDatabase::Write(rocksdb::WriteBatch& batch) {
  if (listener_->has_damage.exchange(false)) {
    // Compaction that met a damaged table would try again for ever: none until the next opening.
    for (rocksdb::ColumnFamilyHandle* handle : handles_) {
      db_->SetOptions(handle, {{"disable_auto_compactions", "true"}}).PermitUncheckedError();
    }
  }
  rocksdb::WriteOptions options;
  options.sync = true;
  rocksdb::Status status = db_->Write(options, &batch);
  if (!status.ok()) listener_->has_failed = true;
  return status;
}

rocksdb::Status RocksDatabase::Flush() {
  return db_->Flush({}, {handles_.begin(), handles_.end()});
}

absl::Status Damaged(const std::filesystem::path& folder, std::string_view what,
                     std::string_view cause) {
  return absl::DataLossError(
      fmt::format("{}: {} is damaged ({}); `carmap base verify {} --repair` restores what can be",
                  folder.string(), what, cause, folder.string()));
}

absl::Status Translate(const rocksdb::Status& status, const std::filesystem::path& folder,
                       std::string_view what) {
  if (status.ok()) return absl::OkStatus();
  const std::string cause = status.ToString();
  if (IsDamage(status)) return Damaged(folder, what, cause);
  // RocksDB names only one of the ways in which there can be no room.
  if (status.IsNoSpace() || cause.find(std::strerror(EDQUOT)) != std::string::npos ||
      cause.find(std::strerror(EFBIG)) != std::string::npos) {
    return absl::ResourceExhaustedError(
        fmt::format("{}: the disk is full ({}); make room and try again", folder.string(), cause));
  }
  if (status.IsNotSupported()) {
    return absl::UnimplementedError(
        fmt::format("{}: made by a newer version ({}); upgrade carmap", folder.string(), cause));
  }
  if (status.IsInvalidArgument()) {
    return absl::InvalidArgumentError(
        fmt::format("{}: {} is not accepted ({})", folder.string(), what, cause));
  }
  return absl::UnavailableError(
      fmt::format("{}: {} is not available ({}); check the disk and who may use the folder",
                  folder.string(), what, cause));
}

}  // namespace carmap
