// The folder into which a vehicle publishes, when nothing takes its parts away yet.
#pragma once

#include <absl/status/status.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <string>

#include "carmap/base/ids.h"
#include "carmap/map/map_diff.h"

namespace carmap {

/// What a diff's file is named: by its drive and part.
inline constexpr const char* kDiffExtension = ".cmdiff";

class PartFiles {
 public:
  /// The folder is made when the first part is written. Its parts take `max_bytes` at most: then
  /// those without landmarks go, the oldest first, and then the others.
  PartFiles(std::filesystem::path folder, uint64_t max_bytes)
      : folder_(std::move(folder)), max_bytes_(max_bytes) {}

  /// Errors: as WriteFileAtomically.
  absl::Status Write(const MapDiff& diff, const std::string& bytes);

  size_t dropped() const { return dropped_; }
  uint64_t bytes() const { return bytes_; }

 private:
  struct Part {
    std::filesystem::path path;
    uint64_t bytes = 0;
    bool has_landmarks = false;
  };
  void MakeRoom(uint64_t bytes);

  const std::filesystem::path folder_;
  const uint64_t max_bytes_;
  std::deque<Part> parts_;  ///< that are there, the oldest first
  uint64_t bytes_ = 0;
  size_t dropped_ = 0;
};

}  // namespace carmap
