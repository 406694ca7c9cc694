// Camera images from files: grey, whole or not at all. Stateless, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <opencv2/core/mat.hpp>

namespace carmap {

/// True for the extensions of what ReadGreyLevels reads, in upper and lower case: .png .jpg .jpeg
/// .pgm .bmp .tif .tiff
bool HasImageExtension(const std::filesystem::path& path);

/// Reads PNG, JPEG, BMP, TIFF or binary PGM, whatever the extension says; colour becomes grey. The
/// levels have 8 or 16 bits (CV_8UC1, CV_16UC1).
/// Errors: as ReadFile; DataLoss (truncated or damaged); InvalidArgument (another format, or a size
/// outside 64×32 to 16384×16384 px).
absl::StatusOr<cv::Mat> ReadGreyLevels(const std::filesystem::path& path);

/// The bits that the levels take, an even number from 8 to 16: cameras write 10 or 12 into 16.
int UsedBits(const cv::Mat& levels);

/// CV_8UC1: levels of 16 bits, of which so many are used, scaled to 8.
cv::Mat ToEightBits(const cv::Mat& levels, int used_bits);

/// The levels of a single image in 8 bits, scaled by those that it uses. Errors: as ReadGreyLevels.
absl::StatusOr<cv::Mat> ReadGreyImage(const std::filesystem::path& path);

/// As ReadGreyImage, for images whose values are not brightness: they are never converted, so
/// InvalidArgument too where pixels are not single 8-bit numbers.
absl::StatusOr<cv::Mat> ReadIndexImage(const std::filesystem::path& path);

/// Two grey images of the same size, equal in each pixel: what a frozen camera gives, and no other.
bool HaveSamePixels(const cv::Mat& a, const cv::Mat& b);

}  // namespace carmap
