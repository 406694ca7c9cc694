// The file of a vocabulary (.cmvoc), which docs/vocabulary_format.md specifies byte by byte.
//
// Reading trusts nothing: no bytes crash it or make it take more memory than twice their own size.
// Thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "carmap/feature/vocabulary.h"

namespace carmap {

/// What the largest vocabulary takes, and a little more.
inline constexpr uint64_t kMaxVocabularyFileBytes = uint64_t{10} << 20;

std::string EncodeVocabulary(const Vocabulary& vocabulary);

/// Errors, each one line with `name`, cause and remedy: InvalidArgument (not such a file),
/// Unimplemented (a newer version), DataLoss (cut short, damaged, followed by other bytes).
absl::StatusOr<Vocabulary> DecodeVocabulary(std::string_view bytes, const std::string& name);

/// Errors: those of ReadFile and DecodeVocabulary.
absl::StatusOr<Vocabulary> ReadVocabulary(const std::filesystem::path& path);

}  // namespace carmap
