#include "apps/carmap/part_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {

absl::Status PartFiles::Write(const MapDiff& diff, const std::string& bytes) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) {
    return absl::UnavailableError(
        fmt::format("{}: cannot be made ({})", folder_.string(), error.message()));
  }
  MakeRoom(bytes.size());
  const std::filesystem::path path =
      folder_ / fmt::format("{}-{:05}{}", ToHex(diff.drive.drives.front().id).substr(16), diff.part,
                            kDiffExtension);
  CARMAP_RETURN_IF_ERROR(WriteFileAtomically(path, bytes));
  parts_.push_back({path, bytes.size(), !diff.drive.landmarks.empty()});
  bytes_ += bytes.size();
  return absl::OkStatus();
}

void PartFiles::MakeRoom(uint64_t bytes) {
  while (!parts_.empty() && bytes_ + bytes > max_bytes_) {
    auto oldest = std::find_if(parts_.begin(), parts_.end(),
                               [](const Part& part) { return !part.has_landmarks; });
    if (oldest == parts_.end()) oldest = parts_.begin();
    std::error_code error;  // it may have been taken away
    const bool was_there = std::filesystem::remove(oldest->path, error);
    dropped_ += was_there;
    bytes_ -= oldest->bytes;
    parts_.erase(oldest);
  }
}

}  // namespace carmap
