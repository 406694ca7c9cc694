#include "carmap/store/rocks_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "carmap/base/byte_io.h"
#include "carmap/base/file.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr size_t kRecordSize = 16;

fs::path RecordIn(const fs::path& database) { return database / "ACKNOWLEDGED"; }

absl::Status NoStore(const fs::path& folder, std::string_view what) {
  return absl::NotFoundError(
      fmt::format("{}: {}; check the path, or make a base map with `carmap base init {}`",
                  folder.string(), what, folder.string()));
}

}  // namespace

fs::path DatabaseIn(const fs::path& folder) { return folder / "rocksdb"; }

absl::Status CannotWrite(const fs::path& folder, int error) {
  const std::string message = fmt::format(
      "{}: cannot be written ({}); choose a folder that exists, is writable and has room",
      folder.string(), std::strerror(error));
  const bool is_full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return is_full ? absl::ResourceExhaustedError(message) : absl::UnavailableError(message);
}

void SyncFolder(const fs::path& folder) {
  const Descriptor descriptor(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor.value() >= 0) ::fsync(descriptor.value());
}

FilesSeen LookAt(const fs::path& database) {
  constexpr uint64_t kMaxNameSize = 100;
  std::string name = ReadFile(database / "CURRENT", kMaxNameSize).value_or("");
  if (name.ends_with('\n')) name.pop_back();
  std::error_code error;
  FilesSeen seen;
  seen.manifest = fmt::format("{} {}", name, fs::file_size(database / name, error));
  for (const fs::directory_entry& entry : fs::directory_iterator(database, error)) {
    if (entry.path().extension() == ".log") seen.logs.insert(entry.path().filename().string());
  }
  return seen;
}

absl::Status CheckRoom(const fs::path& database) {
  constexpr uintmax_t kMore = 4 << 20;
  std::error_code error;
  uintmax_t needed = kMore;
  for (const std::string& log : LookAt(database).logs) {
    const uintmax_t size = fs::file_size(database / log, error);
    if (!error) needed += size;
  }
  const fs::space_info space = fs::space(database, error);
  if (error || space.available >= needed) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      fmt::format("{}: the disk is full ({} bytes are free of {} needed); make room and try again",
                  database.parent_path().string(), space.available, needed));
}

Descriptor::Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(value_, other.value_);
  return *this;
}

Descriptor::~Descriptor() {
  if (value_ >= 0) ::close(value_);
}

absl::StatusOr<Descriptor> LockFolder(const fs::path& folder) {
  Descriptor descriptor(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (descriptor.value() < 0) return CannotWrite(folder, errno);
  // Where a file system cannot lock a folder, RocksDB's own lock is left.
  if (::flock(descriptor.value(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    return absl::UnavailableError(fmt::format(
        "{}: another process is writing this base map; wait for it to end, or open it to read only",
        folder.string()));
  }
  return descriptor;
}

absl::StatusOr<AcknowledgedRecord> AcknowledgedRecord::Open(const fs::path& database) {
  Descriptor file(::open(RecordIn(database).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666));
  if (file.value() < 0) return CannotWrite(database, errno);
  return AcknowledgedRecord(std::move(file));
}

std::optional<uint64_t> AcknowledgedRecord::Read(const fs::path& database) {
  const auto bytes = ReadFile(RecordIn(database), kRecordSize);
  if (!bytes.ok() || bytes->size() != kRecordSize) return std::nullopt;
  ByteReader reader(*bytes);
  const uint64_t sequence = reader.Uint<uint64_t>();
  if (reader.Uint<uint64_t>() != ~sequence) return std::nullopt;
  return sequence;
}

void AcknowledgedRecord::Write(uint64_t sequence) {
  std::string bytes;
  AppendUint(sequence, bytes);
  AppendUint(~sequence, bytes);
  // A record that cannot be written stays behind, and a commit that is on disk is not to fail.
  [[maybe_unused]] const ssize_t written = ::pwrite(file_.value(), bytes.data(), bytes.size(), 0);
}

absl::Status CheckHoldsStore(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::status(folder, error);
  if (!fs::exists(status)) return NoStore(folder, "no such folder");
  if (!fs::is_directory(status)) return NoStore(folder, "a file, not a base map's folder");
  if (!fs::exists(DatabaseIn(folder), error)) return NoStore(folder, "holds no base map");
  return absl::OkStatus();
}

}  // namespace carmap
