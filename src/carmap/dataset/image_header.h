// What an image file is, told from its bytes before a decoder sees them, since decoders return half
// a picture for a truncated file and allocate what a header claims. Stateless, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace carmap {

struct ImageSize {
  uint32_t width = 0, height = 0;
};

/// Size of a PNG, JPEG, BMP, TIFF or binary PGM file that is whole.
/// Errors: DataLoss (truncated or damaged), InvalidArgument (another format).
absl::StatusOr<ImageSize> ExamineImage(const std::filesystem::path& path, std::string_view bytes);

}  // namespace carmap
