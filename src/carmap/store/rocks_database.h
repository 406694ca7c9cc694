// RocksDB with the column families of a base map, opened so that nothing acknowledged is lost
// without a word. Thread-safe, as RocksDB is.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <rocksdb/db.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace carmap {

/// Damage in one does not touch the others.
enum class Family : size_t {
  kMeta,  ///< header, versions, components, sequence: small, and checked whole when it is opened
  kContributions,
  kJournal,
  kTiles,
  kWords,
  kPatches
};
inline constexpr size_t kFamilyCount = 6;

enum class DatabaseAccess {
  kCreate,
  kWrite,
  kWriteDamaged,  ///< whatever has damaged tables; the log of writes must have been found whole
  kRead,
  kReadDamaged,
  kReadMeta  ///< kMeta alone
};

class RocksDatabase {
 public:
  static absl::StatusOr<std::unique_ptr<RocksDatabase>> Open(const std::filesystem::path& path,
                                                             DatabaseAccess access);
  /// Finds out anew which tables and writes belong to a database whose list of them is damaged, and
  /// leaves tables with damage out, in a folder `lost` in it. Changes the files.
  static absl::Status Repair(const std::filesystem::path& path);

  ~RocksDatabase();
  RocksDatabase(const RocksDatabase&) = delete;
  RocksDatabase& operator=(const RocksDatabase&) = delete;

  rocksdb::DB& db() const { return *db_; }
  rocksdb::ColumnFamilyHandle* family(Family family) const {
    return handles_[static_cast<size_t>(family)];
  }

  /// Reads all tables of kMeta against their checksums.
  rocksdb::Status VerifyMeta() const;

  /// Returns when all is on disk. Once it fails, as on a full disk, has_failed is to be heeded.
  rocksdb::Status Write(rocksdb::WriteBatch& batch);

  /// Moves what is in the log to tables.
  rocksdb::Status Flush();

  /// Whether nothing may be written until the database is opened again. (RocksDB's own Resume would
  /// at times wait for ever, and at times write on to a log that ends in half a commit.)
  bool has_failed() const;

 private:
  class ErrorListener;

  explicit RocksDatabase(DatabaseAccess access) : access_(access) {}

  DatabaseAccess access_;
  std::shared_ptr<ErrorListener> listener_;
  std::unique_ptr<rocksdb::DB> db_;
  std::array<rocksdb::ColumnFamilyHandle*, kFamilyCount> handles_ = {};
};

/// One line: the store, what of it is concerned ("tile 1/..."), the cause, the remedy.
absl::Status Translate(const rocksdb::Status& status, const std::filesystem::path& folder,
                       std::string_view what);

/// DataLoss.
absl::Status Damaged(const std::filesystem::path& folder, std::string_view what,
                     std::string_view cause);

}  // namespace carmap
