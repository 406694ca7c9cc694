#include "carmap/base/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
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

/// Where a symbolic link leads, to a file that need not be there; any other path as it is.
absl::StatusOr<fs::path> FollowLinks(fs::path path) {
  constexpr int kMaxLinks = 40;
  std::error_code error;
  for (int links = 0; fs::is_symlink(fs::symlink_status(path, error)); ++links) {
    if (links == kMaxLinks) return WriteError(path, ELOOP);
    path = ParentOf(path) / fs::read_symlink(path, error);
  }
  return path;
}

/// Opens a new file in the folder, with the permissions that the umask leaves; -1 as open(2).
int CreateTemporary(const fs::path& folder, fs::path& path) {
  static std::atomic<unsigned> count = 0;
  int descriptor = -1;
  do {
    path = folder / fmt::format(".carmap.{}.{}", ::getpid(), count++);
    descriptor = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (descriptor < 0 && errno == EEXIST);
  return descriptor;
}

void CopyPermissions(const fs::path& from, int descriptor) {
  struct stat status {};
  if (::stat(from.c_str(), &status) == 0) ::fchmod(descriptor, status.st_mode & 07777);
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
  constexpr size_t kPiece = 1 << 20;
  std::ifstream stream(path, std::ios::binary);
  if (!stream) {
    return absl::PermissionDeniedError(
        fmt::format("{}: cannot be opened ({})", path.string(), std::strerror(errno)));
  }
  // Read in pieces rather than trust the reported size: pipes have none.
  std::string bytes;
  const uintmax_t reported_size = fs::file_size(path, error);
  if (!error && reported_size <= max_bytes) bytes.reserve(reported_size + kPiece);
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
  CARMAP_RETURN_IF_ERROR(CheckWritable(path));
  CARMAP_ASSIGN_OR_RETURN(const fs::path target, FollowLinks(path));
  fs::path temporary;
  const int descriptor = CreateTemporary(ParentOf(target), temporary);
  if (descriptor < 0) return WriteError(path, errno);
  CopyPermissions(target, descriptor);
  absl::Status status = WriteAll(descriptor, bytes, path);
  if (::close(descriptor) != 0 && status.ok()) status = WriteError(path, errno);
  if (status.ok() && ::rename(temporary.c_str(), target.c_str()) != 0) {
    status = WriteError(path, errno);
  }
  if (!status.ok()) {
    ::unlink(temporary.c_str());
    return status;
  }
  SyncFolder(ParentOf(target));
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
  CARMAP_ASSIGN_OR_RETURN(const fs::path target, FollowLinks(path));
  if (::access(ParentOf(target).c_str(), W_OK | X_OK) != 0) return WriteError(path, errno);
  return absl::OkStatus();
}

bool IsSameFile(const fs::path& a, const fs::path& b) {
  std::error_code error;
  if (fs::exists(a, error) || fs::exists(b, error)) return fs::equivalent(a, b, error);
  const auto target = FollowLinks(b);
  return target.ok() && FollowLinks(a).value_or(a).filename() == target->filename() &&
         IsInFolder(a, ParentOf(*target));
}

bool IsInFolder(const fs::path& path, const fs::path& folder) {
  std::error_code error;
  const auto target = FollowLinks(path);
  return target.ok() && fs::equivalent(ParentOf(*target), folder, error);
}

}  // namespace carmap
