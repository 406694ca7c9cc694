#include "carmap/dataset/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <string_view>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/image_header.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxFileBytes = uint64_t{1} << 28;
constexpr uint32_t kMinWidth = 64, kMinHeight = 32, kMaxSide = 16384;

absl::Status CheckSize(const fs::path& path, ImageSize size) {
  if (size.width < kMinWidth || size.height < kMinHeight || size.width > kMaxSide ||
      size.height > kMaxSide) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: the image is {}x{} px; sizes from {}x{} to {}x{} can be read", path.string(),
        size.width, size.height, kMinWidth, kMinHeight, kMaxSide, kMaxSide));
  }
  return absl::OkStatus();
}

/// Empty when the decoder gives up.
cv::Mat Decode(std::string& bytes, int flags) {
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
    return cv::imdecode(encoded, flags);
  } catch (const cv::Exception&) {
    return {};
  }
}

/// In the form that `flags` ask the decoder for.
absl::StatusOr<cv::Mat> ReadImage(const fs::path& path, int flags) {
  absl::StatusOr<std::string> bytes = ReadFile(path, kMaxFileBytes);
  if (!bytes.ok()) return bytes.status();
  CARMAP_ASSIGN_OR_RETURN(const ImageSize size, ExamineImage(path, *bytes));
  CARMAP_RETURN_IF_ERROR(CheckSize(path, size));
  cv::Mat image = Decode(*bytes, flags);
  if (image.cols != static_cast<int>(size.width) || image.rows != static_cast<int>(size.height)) {
    return absl::DataLossError(fmt::format(
        "{}: the image is damaged and cannot be decoded; copy it again", path.string()));
  }
  return image;
}

}  // namespace

bool HasImageExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  constexpr std::array<std::string_view, 7> kExtensions = {".png", ".jpg", ".jpeg", ".pgm",
                                                           ".bmp", ".tif", ".tiff"};
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

absl::StatusOr<cv::Mat> ReadGreyLevels(const fs::path& path) {
  CARMAP_ASSIGN_OR_RETURN(
      cv::Mat levels,
      ReadImage(path, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION));
  if (levels.type() == CV_8UC1 || levels.type() == CV_16UC1) return levels;
  return absl::InvalidArgumentError(fmt::format(
      "{}: has grey levels of neither 8 nor 16 bits; convert it to PNG", path.string()));
}

int UsedBits(const cv::Mat& levels) {
  double brightest = 0;
  cv::minMaxLoc(levels, nullptr, &brightest);
  int bits = 8;
  while (brightest >= 1 << bits) bits += 2;
  return bits;
}

cv::Mat ToEightBits(const cv::Mat& levels, int used_bits) {
  if (levels.depth() == CV_8U) return levels;
  cv::Mat image;
  levels.convertTo(image, CV_8U, 255.0 / ((1 << used_bits) - 1));
  return image;
}

absl::StatusOr<cv::Mat> ReadGreyImage(const fs::path& path) {
  CARMAP_ASSIGN_OR_RETURN(const cv::Mat levels, ReadGreyLevels(path));
  return ToEightBits(levels, UsedBits(levels));
}

absl::StatusOr<cv::Mat> ReadIndexImage(const fs::path& path) {
  CARMAP_ASSIGN_OR_RETURN(cv::Mat image, ReadImage(path, cv::IMREAD_UNCHANGED));
  if (image.type() == CV_8UC1) return image;
  return absl::InvalidArgumentError(
      fmt::format("{}: is not 8-bit grey; write one number of 8 bits a pixel", path.string()));
}

bool HaveSamePixels(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a.ptr(row), b.ptr(row), static_cast<size_t>(a.cols)) != 0) return false;
  }
  return true;
}

}  // namespace carmap
