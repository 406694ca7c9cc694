// The folder of a base map on disk: where RocksDB has its files, who may write them, and what was
// acknowledged.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>

namespace carmap {

/// Where the files are. A folder holds a store if and only if this is there.
std::filesystem::path DatabaseIn(const std::filesystem::path& folder);

/// What may stand wherever something cannot be written.
absl::Status CannotWrite(const std::filesystem::path& folder, int error);

/// Makes what was created or renamed in a folder durable.
void SyncFolder(const std::filesystem::path& folder);

/// What a writer changes while another process may be opening the files.
struct FilesSeen {
  std::string manifest;        ///< which tables there are
  std::set<std::string> logs;  ///< of writes that are in no table yet
  bool operator==(const FilesSeen&) const = default;
};
FilesSeen LookAt(const std::filesystem::path& database);

/// Whether there is room to move what is in logs to tables. Errors: ResourceExhausted.
absl::Status CheckRoom(const std::filesystem::path& database);

/// An open file descriptor.
class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor();

  int value() const { return value_; }

 private:
  int value_;
};

/// Errors: NotFound, with what to do, if the folder holds no store.
absl::Status CheckHoldsStore(const std::filesystem::path& folder);

/// The right to write a folder, until it is closed or the process ends. Errors: Unavailable.
absl::StatusOr<Descriptor> LockFolder(const std::filesystem::path& folder);

/// The sequence of the newest commit that was acknowledged, in a file of its own. RocksDB cannot
/// tell a write that was cut off when its process was killed from an acknowledged one that was
/// damaged later; this can. It is written after each commit without being synced: what a failing
/// machine leaves of it may be old, which only makes the comparison less sharp.
class AcknowledgedRecord {
 public:
  static absl::StatusOr<AcknowledgedRecord> Open(const std::filesystem::path& database);

  /// Nothing if there is no record, or it is damaged.
  static std::optional<uint64_t> Read(const std::filesystem::path& database);

  void Write(uint64_t sequence);

 private:
  explicit AcknowledgedRecord(Descriptor file) : file_(std::move(file)) {}

  Descriptor file_;
};

}  // namespace carmap
