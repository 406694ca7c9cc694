// Camera images from files: 8-bit grey, whole or not at all.
//
// Thread-safe. A file is examined before a decoder sees it, since decoders return half a picture
// for a truncated file and allocate what a header claims.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <opencv2/core/mat.hpp>

namespace carmap {

/// True for the extensions that ReadGreyImage reads: .png .jpg .jpeg .pgm
bool HasImageExtension(const std::filesystem::path& path);

/// Reads PNG, JPEG or binary PGM, whatever the extension says; colour becomes grey.
/// Errors: as ReadFile; DataLoss (truncated or damaged); InvalidArgument (another format, or a size
/// outside 64×32 to 16384×16384 px).
absl::StatusOr<cv::Mat> ReadGreyImage(const std::filesystem::path& path);

/// As ReadGreyImage, for images whose values are not brightness: they are never converted, so
/// InvalidArgument too where pixels are not single 8-bit numbers.
absl::StatusOr<cv::Mat> ReadIndexImage(const std::filesystem::path& path);

/// Two grey images of the same size, equal in each pixel: what a frozen camera gives, and no other.
bool HaveSamePixels(const cv::Mat& a, const cv::Mat& b);

}  // namespace carmap
