// Whole files, read with a limit and written so that a reader never sees half of one.
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

/// Writes through a temporary file beside `path`, syncs it and renames it over `path`.
/// On an error nothing is left behind and an older file at `path` stays as it was.
absl::Status WriteFileAtomically(const std::filesystem::path& path, std::string_view bytes);

/// Checks, before long work, that a file could be written at `path`.
absl::Status CheckWritable(const std::filesystem::path& path);

}  // namespace carmap
