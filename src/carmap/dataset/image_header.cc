#include "carmap/dataset/image_header.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <vector>

#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

uint32_t BigEndian(std::string_view bytes, size_t offset, size_t length) {
  uint32_t value = 0;
  for (size_t i = 0; i < length; ++i) {
    value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
  }
  return value;
}

uint32_t LittleEndian(std::string_view bytes, size_t offset, size_t length) {
  uint32_t value = 0;
  for (size_t i = length; i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes[offset + i]);
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

/// Where the entropy-coded data after a scan's header ends: at the next marker that is neither a
/// stuffed zero nor a restart (ITU T.81 §B.1.1.2).
size_t EndOfScan(std::string_view bytes, size_t offset) {
  while ((offset = bytes.find('\xff', offset)) != std::string_view::npos &&
         offset + 1 < bytes.size()) {
    const uint32_t marker = BigEndian(bytes, offset + 1, 1);
    if (marker != 0x00 && marker != 0xFF && (marker < 0xD0 || marker > 0xD7)) return offset;
    ++offset;
  }
  return bytes.size();
}

/// Size of a JPEG file up to its end marker; what comes after is not the picture's. From the frame
/// header: markers C0-CF but for the tables C4, C8 and CC (ITU T.81 §B.1.1.3).
std::optional<ImageSize> ExamineJpeg(std::string_view bytes) {
  constexpr uint32_t kScan = 0xDA, kEnd = 0xD9, kFill = 0xFF;
  std::optional<ImageSize> size;
  bool has_scan = false;
  for (size_t offset = 2; offset + 2 <= bytes.size();) {
    if (bytes[offset] != '\xff') return std::nullopt;
    const uint32_t marker = BigEndian(bytes, offset + 1, 1);
    if (marker == kEnd) return has_scan ? size : std::nullopt;
    if (marker == kFill) {
      ++offset;
      continue;
    }
    if (bytes.size() - offset < 9) return std::nullopt;
    const uint32_t length = BigEndian(bytes, offset + 2, 2);
    if (length > bytes.size() - offset - 2) return std::nullopt;
    if (marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC) {
      size = ImageSize{BigEndian(bytes, offset + 7, 2), BigEndian(bytes, offset + 5, 2)};
    }
    offset += 2 + length;
    if (marker != kScan) continue;
    has_scan = true;
    offset = EndOfScan(bytes, offset);
  }
  return std::nullopt;
}

/// The next number of a PGM header, from `offset` on, which is moved behind it. Comments run from #
/// to the end of their line.
std::optional<double> NextPgmNumber(std::string_view bytes, size_t& offset) {
  constexpr std::string_view kSpaces = " \t\r\n";
  while ((offset = bytes.find_first_not_of(kSpaces, offset)) != std::string_view::npos &&
         bytes[offset] == '#') {
    offset = bytes.find('\n', offset);
  }
  if (offset == std::string_view::npos) return std::nullopt;
  const size_t end = std::min(bytes.find_first_of(kSpaces, offset), bytes.size());
  const std::optional<double> number = ParseNumber(bytes.substr(offset, end - offset));
  offset = end;
  if (!number || !(*number >= 1 && *number <= 1e6)) return std::nullopt;
  return number;
}

/// Size of a binary grey PGM file of 8 or 16 bits that has all its pixels.
std::optional<ImageSize> ExaminePgm(std::string_view bytes) {
  size_t offset = 2;
  const auto width = NextPgmNumber(bytes, offset), height = NextPgmNumber(bytes, offset),
             brightest = NextPgmNumber(bytes, offset);
  if (!width || !height || !brightest || *brightest > 65535) return std::nullopt;
  const double bytes_per_pixel = *brightest > 255 ? 2 : 1;
  const auto left = static_cast<double>(bytes.size() - std::min(offset + 1, bytes.size()));
  if (*width * *height * bytes_per_pixel > left) return std::nullopt;
  return ImageSize{static_cast<uint32_t>(*width), static_cast<uint32_t>(*height)};
}

/// Size of an uncompressed BMP file that has all its pixels.
std::optional<ImageSize> ExamineBmp(std::string_view bytes) {
  constexpr size_t kHeaderBytes = 54;
  if (bytes.size() < kHeaderBytes) return std::nullopt;
  const uint64_t data = LittleEndian(bytes, 10, 4), bits = LittleEndian(bytes, 28, 2);
  const auto width = static_cast<int32_t>(LittleEndian(bytes, 18, 4));
  const int64_t height = std::abs(int64_t{static_cast<int32_t>(LittleEndian(bytes, 22, 4))});
  const uint32_t compression = LittleEndian(bytes, 30, 4);
  constexpr uint32_t kNone = 0, kBitFields = 3;
  if (width <= 0 || bits > 32 || (compression != kNone && compression != kBitFields)) {
    return std::nullopt;
  }
  const uint64_t row_bytes = (static_cast<uint64_t>(width) * bits + 31) / 32 * 4;
  if (data + row_bytes * static_cast<uint64_t>(height) > bytes.size()) return std::nullopt;
  return ImageSize{static_cast<uint32_t>(width), static_cast<uint32_t>(height)};
}

/// Numbers of a TIFF file in its own byte order.
class TiffFile {
 public:
  explicit TiffFile(std::string_view bytes) : bytes_(bytes) {}

  static bool HasSignature(std::string_view bytes) {
    return bytes.starts_with(std::string_view("II*\0", 4)) ||
           bytes.starts_with(std::string_view("MM\0*", 4));
  }

  /// Zero beyond the end.
  uint32_t At(uint64_t offset, size_t length) const {
    if (!Holds(offset, length)) return 0;
    return bytes_.front() == 'I' ? LittleEndian(bytes_, offset, length)
                                 : BigEndian(bytes_, offset, length);
  }
  bool Holds(uint64_t offset, uint64_t length) const { return offset + length <= bytes_.size(); }

  /// The whole numbers of a field of the first directory (TIFF 6.0 §2); none if it is not there.
  std::vector<uint32_t> Field(uint32_t tag) const {
    constexpr uint32_t kShort = 3;
    const uint64_t directory = At(4, 4);
    const uint32_t entries = At(directory, 2);
    std::vector<uint32_t> numbers;
    for (uint32_t i = 0; i < entries; ++i) {
      const uint64_t entry = directory + 2 + 12 * uint64_t{i};
      if (At(entry, 2) != tag) continue;
      const uint64_t bytes = At(entry + 2, 2) == kShort ? 2 : 4, count = At(entry + 4, 4);
      const uint64_t values = count * bytes <= 4 ? entry + 8 : At(entry + 8, 4);
      if (!Holds(values, count * bytes)) return {};
      for (uint64_t n = 0; n < count; ++n) numbers.push_back(At(values + n * bytes, bytes));
      return numbers;
    }
    return numbers;
  }

 private:
  const std::string_view bytes_;
};

/// Size of a TIFF file that has all its strips or tiles.
std::optional<ImageSize> ExamineTiff(std::string_view bytes) {
  constexpr uint32_t kWidth = 256, kHeight = 257, kStrips = 273, kStripBytes = 279, kTiles = 324,
                     kTileBytes = 325;
  const TiffFile file(bytes);
  const auto width = file.Field(kWidth), height = file.Field(kHeight);
  auto parts = file.Field(kStrips), part_bytes = file.Field(kStripBytes);
  if (parts.empty()) parts = file.Field(kTiles), part_bytes = file.Field(kTileBytes);
  if (width.size() != 1 || height.size() != 1 || parts.empty() ||
      parts.size() != part_bytes.size()) {
    return std::nullopt;
  }
  for (size_t i = 0; i < parts.size(); ++i) {
    if (!file.Holds(parts[i], part_bytes[i])) return std::nullopt;
  }
  return ImageSize{width.front(), height.front()};
}

}  // namespace

absl::StatusOr<ImageSize> ExamineImage(const std::filesystem::path& path, std::string_view bytes) {
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
  } else if (bytes.starts_with("BM")) {
    size = ExamineBmp(bytes);
  } else if (TiffFile::HasSignature(bytes)) {
    size = ExamineTiff(bytes);
  } else if (!kPngSignature.starts_with(bytes)) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: is not a PNG, JPEG, BMP, TIFF or binary PGM image; convert it to PNG", path.string()));
  }
  if (!size) {
    return absl::DataLossError(
        fmt::format("{}: the image is truncated or damaged; copy it again", path.string()));
  }
  return *size;
}

}  // namespace carmap
