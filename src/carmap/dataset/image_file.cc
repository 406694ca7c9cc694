#include "carmap/dataset/image_file.h"

#include <fmt/format.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxFileBytes = uint64_t{1} << 28;
constexpr uint32_t kMinWidth = 64, kMinHeight = 32, kMaxSide = 16384;

struct ImageSize {
  uint32_t width = 0, height = 0;
};

uint32_t BigEndian(std::string_view bytes, size_t offset, size_t length) {
  uint32_t value = 0;
  for (size_t i = 0; i < length; ++i) {
    value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
  }
  return value;
}

using CrcTables = std::array<std::array<uint32_t, 256>, 4>;

constexpr CrcTables MakeCrcTables() {
  constexpr uint32_t kReversedPolynomial = 0xEDB88320;
  CrcTables tables{};
  for (uint32_t byte = 0; byte < 256; ++byte) {
    uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? kReversedPolynomial : 0);
    tables[0][byte] = crc;
  }
  for (size_t i = 1; i < tables.size(); ++i) {
    for (uint32_t byte = 0; byte < 256; ++byte) {
      const uint32_t crc = tables[i - 1][byte];
      tables[i][byte] = crc >> 8 ^ tables[0][crc & 255];
    }
  }
  return tables;
}

/// CRC-32 of PNG chunks, four bytes a step.
uint32_t Crc32(std::string_view bytes) {
  static constexpr CrcTables kTables = MakeCrcTables();
  const auto byte_at = [&](size_t i) { return static_cast<uint8_t>(bytes[i]); };
  uint32_t crc = 0xFFFFFFFF;
  size_t i = 0;
  for (; i + 4 <= bytes.size(); i += 4) {
    crc = kTables[3][(crc ^ byte_at(i)) & 255] ^ kTables[2][(crc >> 8 ^ byte_at(i + 1)) & 255] ^
          kTables[1][(crc >> 16 ^ byte_at(i + 2)) & 255] ^ kTables[0][crc >> 24 ^ byte_at(i + 3)];
  }
  for (; i < bytes.size(); ++i) crc = crc >> 8 ^ kTables[0][(crc ^ byte_at(i)) & 255];
  return ~crc;
}

constexpr std::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);

/// Size of a PNG file that is whole: chunks with right check sums up to IEND (PNG §5).
std::optional<ImageSize> ExaminePng(std::string_view bytes) {
  constexpr size_t kLengthBytes = 4, kTypeBytes = 4, kFrameBytes = 12, kHeaderBytes = 13;
  std::optional<ImageSize> size;
  for (size_t offset = kPngSignature.size(); bytes.size() - offset >= kFrameBytes;) {
    const uint32_t length = BigEndian(bytes, offset, kLengthBytes);
    if (length > bytes.size() - offset - kFrameBytes) return std::nullopt;
    const std::string_view checked = bytes.substr(offset + kLengthBytes, kTypeBytes + length);
    offset += kFrameBytes + length;
    if (Crc32(checked) != BigEndian(bytes, offset - 4, 4)) return std::nullopt;
    const std::string_view type = checked.substr(0, kTypeBytes);
    if (!size) {
      if (type != "IHDR" || length != kHeaderBytes) return std::nullopt;
      size = ImageSize{BigEndian(checked, 4, 4), BigEndian(checked, 8, 4)};
    }
    if (type == "IEND") return size;
  }
  return std::nullopt;
}

constexpr std::string_view kJpegSignature("\xff\xd8\xff", 3);

/// Size of a JPEG file that has its end marker: from the frame header, markers C0-CF but for the
/// tables C4, C8 and CC (ITU T.81 §B.1.1.3).
std::optional<ImageSize> ExamineJpeg(std::string_view bytes) {
  if (!bytes.ends_with("\xff\xd9")) return std::nullopt;
  for (size_t offset = 2; bytes.size() - offset >= 9;) {
    if (bytes[offset] != '\xff') return std::nullopt;
    const uint32_t marker = BigEndian(bytes, offset + 1, 1);
    if (marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC) {
      return ImageSize{BigEndian(bytes, offset + 7, 2), BigEndian(bytes, offset + 5, 2)};
    }
    const uint32_t length = BigEndian(bytes, offset + 2, 2);
    if (length > bytes.size() - offset - 2) return std::nullopt;
    offset += 2 + length;
  }
  return std::nullopt;
}

/// Size of a binary grey PGM file of 8 bits that has all its pixels.
std::optional<ImageSize> ExaminePgm(std::string_view bytes) {
  std::array<double, 3> header{};  // width, height, brightest value
  size_t offset = 2;
  for (double& value : header) {
    const size_t begin = bytes.find_first_not_of(" \t\r\n", offset);
    if (begin == std::string_view::npos) return std::nullopt;
    offset = bytes.find_first_of(" \t\r\n", begin);
    if (offset == std::string_view::npos) return std::nullopt;
    const std::optional<double> number = ParseNumber(bytes.substr(begin, offset - begin));
    if (!number || !(*number >= 1 && *number <= 1e6)) return std::nullopt;
    value = *number;
  }
  const auto [width, height, brightest] = header;
  if (brightest > 255 || width * height > static_cast<double>(bytes.size() - offset - 1)) {
    return std::nullopt;
  }
  return ImageSize{static_cast<uint32_t>(width), static_cast<uint32_t>(height)};
}

absl::StatusOr<ImageSize> Examine(const fs::path& path, std::string_view bytes) {
  std::optional<ImageSize> size;
  if (bytes.empty()) {
    return absl::DataLossError(
        fmt::format("{}: is empty (0 bytes); copy the image again", path.string()));
  }
  if (bytes.starts_with(kPngSignature)) {
    size = ExaminePng(bytes);
  } else if (bytes.starts_with(kJpegSignature)) {
    size = ExamineJpeg(bytes);
  } else if (bytes.starts_with("P5")) {
    size = ExaminePgm(bytes);
  } else if (!kPngSignature.starts_with(bytes)) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: is not a PNG, JPEG or binary PGM image; convert it to PNG", path.string()));
  }
  if (!size) {
    return absl::DataLossError(
        fmt::format("{}: the image is truncated or damaged; copy it again", path.string()));
  }
  return *size;
}

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
  CARMAP_ASSIGN_OR_RETURN(const ImageSize size, Examine(path, *bytes));
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
  const fs::path extension = path.extension();
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg" || extension == ".pgm";
}

absl::StatusOr<cv::Mat> ReadGreyImage(const fs::path& path) {
  return ReadImage(path, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
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
