// Whole files, read with a limit and written so that a reader never sees half of one; which names
// are of one file. Stateless, thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace carmap {

/// Reads a whole file.
/// Errors: NotFound, InvalidArgument (a folder, or longer than max_bytes), DataLoss (read failed).
absl::StatusOr<std::string> ReadFile(const std::filesystem::path& path, uint64_t max_bytes);

/// Writes a temporary file, syncs it and renames it over `path`, or over the file that `path` is a
/// symbolic link to. A file that is replaced keeps its permissions; a new one has what the umask
/// leaves. On an error nothing is left behind and an older file at `path` stays as it was.
/// Errors: as CheckWritable; Unavailable.
absl::Status WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes);

/// Checks, before long work, that a file could be written at `path`.
absl::Status CheckWritable(const std::filesystem::path& path);

/// Whether two names are of one file, by symbolic or hard links too: one device and inode or, of
/// files that are not there yet, one place.
bool IsSameFile(const std::filesystem::path& a, const std::filesystem::path& b);

/// Whether a file that is written at `path` lies directly in `folder`.
bool IsInFolder(const std::filesystem::path& path, const std::filesystem::path& folder);

}  // namespace carmap
