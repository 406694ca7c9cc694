#include "carmap/format/container.h"

#include <absl/status/status.h>
#include <fmt/format.h>
#include <xxhash.h>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

/// As PNG's: a byte above 127, line ends and a control-Z betray transfers that alter bytes.
constexpr std::string_view kMagic(
    "\x89"
    "CMAP\r\n\x1a",
    8);
constexpr size_t kFixedSize = 24;
constexpr size_t kEntrySize = 20;
constexpr size_t kChecksumSize = 8;
constexpr uint32_t kMaxSections = 64;
constexpr uint16_t kMandatoryFlag = 1;

uint64_t Checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

absl::Status CutShort(const std::string& name, uint64_t found, uint64_t expected) {
  return absl::DataLossError(fmt::format(
      "{}: cut short ({} bytes of {}); copy or download the file again", name, found, expected));
}

absl::Status Damaged(const std::string& name, const std::string& where) {
  return absl::DataLossError(
      fmt::format("{}: damaged ({}); copy or download the file again", name, where));
}

absl::Status CheckMagic(std::string_view bytes, const std::string& name) {
  if (bytes.substr(0, kMagic.size()) != kMagic.substr(0, bytes.size())) {
    return absl::InvalidArgumentError(
        fmt::format("{}: not a carmap map file; name a .cmap file that carmap wrote", name));
  }
  if (bytes.size() < kFixedSize) return CutShort(name, bytes.size(), kFixedSize);
  return absl::OkStatus();
}

absl::Status CheckVersion(uint16_t major, uint16_t minor, const std::string& name) {
  if (major == kFormatMajor) return absl::OkStatus();
  if (major < kFormatMajor) {
    return absl::UnimplementedError(fmt::format(
        "{}: format version {}.{} is older than the supported {}.x; map its drive again", name,
        major, minor, kFormatMajor));
  }
  return absl::UnimplementedError(
      fmt::format("{}: format version {}.{} is newer than the supported {}.x; upgrade carmap", name,
                  major, minor, kFormatMajor));
}

}  // namespace

std::string WriteContainer(const std::vector<Section>& sections) {
  uint64_t file_size = kFixedSize + kEntrySize * sections.size() + kChecksumSize;
  for (const Section& section : sections) file_size += section.content.size();

  std::string out(kMagic);
  out.reserve(file_size);
  AppendUint(kFormatMajor, out);
  AppendUint(kFormatMinor, out);
  AppendUint(static_cast<uint32_t>(sections.size()), out);
  AppendUint(file_size, out);
  for (const Section& section : sections) {
    AppendUint(section.id, out);
    AppendUint(section.is_mandatory ? kMandatoryFlag : uint16_t{0}, out);
    AppendUint(static_cast<uint64_t>(section.content.size()), out);
    AppendUint(Checksum(section.content), out);
  }
  AppendUint(Checksum(out), out);
  for (const Section& section : sections) out += section.content;
  return out;
}

absl::StatusOr<std::vector<SectionView>> ReadContainer(std::string_view bytes,
                                                       const std::string& name) {
  CARMAP_RETURN_IF_ERROR(CheckMagic(bytes, name));
  ByteReader reader(bytes);
  reader.Bytes(kMagic.size());
  const uint16_t major = reader.Uint<uint16_t>();
  const uint16_t minor = reader.Uint<uint16_t>();
  CARMAP_RETURN_IF_ERROR(CheckVersion(major, minor, name));
  const uint32_t section_count = reader.Uint<uint32_t>();
  const uint64_t file_size = reader.Uint<uint64_t>();
  if (section_count > kMaxSections) return Damaged(name, "impossible number of sections");
  const size_t table_end = kFixedSize + kEntrySize * section_count;
  if (bytes.size() < table_end + kChecksumSize) return CutShort(name, bytes.size(), file_size);
  if (ByteReader(bytes.substr(table_end)).Uint<uint64_t>() !=
      Checksum(bytes.substr(0, table_end))) {
    return Damaged(name, "checksum of the section table differs");
  }
  if (bytes.size() < file_size) return CutShort(name, bytes.size(), file_size);
  if (bytes.size() > file_size) {
    return Damaged(name, fmt::format("{} bytes follow its end", bytes.size() - file_size));
  }

  std::vector<SectionView> sections(section_count);
  ByteReader contents(bytes.substr(table_end + kChecksumSize));
  for (size_t i = 0; i < sections.size(); ++i) {
    SectionView& section = sections[i];
    section.id = reader.Uint<uint16_t>();
    section.is_mandatory = (reader.Uint<uint16_t>() & kMandatoryFlag) != 0;
    section.content = contents.Bytes(reader.Uint<uint64_t>());
    const uint64_t checksum = reader.Uint<uint64_t>();
    if (!contents.ok()) return Damaged(name, "sections are longer than the file");
    if (checksum != Checksum(section.content)) {
      return Damaged(name, fmt::format("checksum of section {} differs", section.id));
    }
    if (i > 0 && sections[i - 1].id >= section.id) return Damaged(name, "order of sections");
  }
  if (contents.remaining() != 0) return Damaged(name, "bytes that belong to no section");
  return sections;
}

}  // namespace carmap
