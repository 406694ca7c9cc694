#include "carmap/base/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>

#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

fs::path ParentOf(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

absl::Status WriteError(const fs::path& path, int error) {
  return absl::UnavailableError(
      fmt::format("{}: cannot be written ({}); choose a folder that exists, "
                  "is writable and has room",
                  path.string(), std::strerror(error)));
}

absl::Status WriteAll(int descriptor, std::string_view bytes, const fs::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor, bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      return WriteError(path, errno);
    }
    bytes.remove_prefix(static_cast<size_t>(written));
  }
  if (::fsync(descriptor) != 0) return WriteError(path, errno);
  return absl::OkStatus();
}

/// Makes a rename in `folder` durable; a file system that cannot sync folders is not an error.
void SyncFolder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace

absl::StatusOr<std::string> ReadFile(const fs::path& path, uint64_t max_bytes) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) {
    return absl::NotFoundError(fmt::format("{}: no such file; check the path", path.string()));
  }
  if (fs::is_directory(status)) {
    return absl::InvalidArgumentError(
        fmt::format("{}: is a folder; name a file in it", path.string()));
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) {
    return absl::PermissionDeniedError(
        fmt::format("{}: cannot be opened ({})", path.string(), std::strerror(errno)));
  }
  // Read in pieces rather than trust the reported size: pipes have none.
  std::string bytes;
  constexpr size_t kPiece = 1 << 20;
  while (stream) {
    const size_t size = bytes.size();
    bytes.resize(size + kPiece);
    stream.read(bytes.data() + size, kPiece);
    bytes.resize(size + static_cast<size_t>(stream.gcount()));
    if (bytes.size() > max_bytes) {
      return absl::InvalidArgumentError(
          fmt::format("{}: larger than the limit of {} bytes; not a file of this kind",
                      path.string(), max_bytes));
    }
  }
  if (stream.bad()) return absl::DataLossError(fmt::format("{}: reading failed", path.string()));
  return bytes;
}

absl::Status WriteFileAtomically(const fs::path& path, std::string_view bytes) {
  std::string temporary = (ParentOf(path) / (path.filename().string() + ".XXXXXX")).string();
  const int descriptor = ::mkostemp(temporary.data(), O_CLOEXEC);
  if (descriptor < 0) return WriteError(path, errno);
  absl::Status status = WriteAll(descriptor, bytes, path);
  if (::fchmod(descriptor, 0644) != 0 && status.ok()) status = WriteError(path, errno);
  if (::close(descriptor) != 0 && status.ok()) status = WriteError(path, errno);
  if (status.ok() && ::rename(temporary.c_str(), path.c_str()) != 0)
    status = WriteError(path, errno);
  if (!status.ok()) {
    ::unlink(temporary.c_str());
    return status;
  }
  SyncFolder(ParentOf(path));
  return absl::OkStatus();
}

absl::Status CheckWritable(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) {
    return absl::InvalidArgumentError(
        fmt::format("{}: is a folder; name a file to write", path.string()));
  }
  if (fs::exists(path, error) && !fs::is_regular_file(path, error)) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: is a device, not a file, and would be replaced; name a file to write", path.string()));
  }
  if (::access(ParentOf(path).c_str(), W_OK | X_OK) != 0) return WriteError(path, errno);
  return absl::OkStatus();
}

}  // namespace carmap
