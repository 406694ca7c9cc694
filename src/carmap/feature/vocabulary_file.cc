#include "carmap/feature/vocabulary_file.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <utility>

#include "carmap/base/byte_io.h"
#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

/// Like a map file's, so that transfers that alter bytes betray themselves.
constexpr std::string_view kMagic(
    "\x89"
    "CMV\r\n\x1a\n",
    8);
constexpr uint16_t kMajor = 2, kMinor = 0;
constexpr size_t kHeaderSize = 28, kChecksumSize = 8;
constexpr size_t kCenterSize = sizeof(Descriptor), kWeightSize = sizeof(uint16_t);

uint64_t Checksum(std::string_view bytes) { return XXH3_64bits(bytes.data(), bytes.size()); }

absl::Status CutShort(const std::string& name, uint64_t found, uint64_t expected) {
  return absl::DataLossError(fmt::format(
      "{}: cut short ({} bytes of {}); copy or download the file again", name, found, expected));
}

absl::Status Damaged(const std::string& name, std::string_view where) {
  return absl::DataLossError(
      fmt::format("{}: damaged ({}); copy or download the file again", name, where));
}

absl::Status CheckHeader(std::string_view bytes, const std::string& name) {
  if (bytes.substr(0, kMagic.size()) != kMagic.substr(0, bytes.size())) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: not a carmap vocabulary; name a .cmvoc file that `carmap vocabulary train` wrote",
        name));
  }
  if (bytes.size() < kHeaderSize) return CutShort(name, bytes.size(), kHeaderSize);
  ByteReader reader(bytes.substr(kMagic.size()));
  const auto major = reader.Uint<uint16_t>(), minor = reader.Uint<uint16_t>();
  if (major < kMajor) {
    return absl::UnimplementedError(
        fmt::format("{}: format version {}.{}, before the signatures of {}.x; train it again", name,
                    major, minor, kMajor));
  }
  if (major > kMajor) {
    return absl::UnimplementedError(
        fmt::format("{}: format version {}.{} is newer than the supported {}.x; upgrade carmap",
                    name, major, minor, kMajor));
  }
  return absl::OkStatus();
}

struct Sizes {
  uint64_t child_counts = 0, centers = 0, weights = 0;

  uint64_t file() const {
    return kHeaderSize + child_counts + kCenterSize * centers + kWeightSize * weights +
           kChecksumSize;
  }
};

VocabularyTables ReadTables(uint32_t training_images, const Sizes& sizes, ByteReader& reader) {
  VocabularyTables tables{training_images, {}, {}, {}};
  tables.child_counts.reserve(sizes.child_counts);
  for (uint64_t i = 0; i < sizes.child_counts; ++i) {
    tables.child_counts.push_back(reader.Uint<uint8_t>());
  }
  tables.centers.resize(sizes.centers);
  for (Descriptor& center : tables.centers) {
    for (uint64_t& word : center.words) word = reader.Uint<uint64_t>();
  }
  tables.weights.reserve(sizes.weights);
  for (uint64_t i = 0; i < sizes.weights; ++i) tables.weights.push_back(reader.Uint<uint16_t>());
  return tables;
}

}  // namespace

std::string EncodeVocabulary(const Vocabulary& vocabulary) {
  const VocabularyTables& tables = vocabulary.tables();
  const Sizes sizes{tables.child_counts.size(), tables.centers.size(), tables.weights.size()};
  std::string out(kMagic);
  out.reserve(sizes.file());
  AppendUint(kMajor, out);
  AppendUint(kMinor, out);
  AppendUint(tables.training_images, out);
  AppendUint(static_cast<uint32_t>(sizes.child_counts), out);
  AppendUint(static_cast<uint32_t>(sizes.centers), out);
  AppendUint(static_cast<uint32_t>(sizes.weights), out);
  for (const uint8_t count : tables.child_counts) AppendUint(count, out);
  for (const Descriptor& center : tables.centers) {
    for (const uint64_t word : center.words) AppendUint(word, out);
  }
  for (const uint16_t weight : tables.weights) AppendUint(weight, out);
  AppendUint(Checksum(out), out);
  return out;
}

absl::StatusOr<Vocabulary> DecodeVocabulary(std::string_view bytes, const std::string& name) {
  CARMAP_RETURN_IF_ERROR(CheckHeader(bytes, name));
  ByteReader reader(bytes);
  reader.Bytes(kMagic.size() + 2 * sizeof(uint16_t));
  const auto training_images = reader.Uint<uint32_t>();
  const auto child_counts = reader.Uint<uint32_t>(), centers = reader.Uint<uint32_t>(),
             weights = reader.Uint<uint32_t>();
  const Sizes sizes{child_counts, centers, weights};
  if (bytes.size() < sizes.file()) return CutShort(name, bytes.size(), sizes.file());
  if (bytes.size() > sizes.file()) {
    return Damaged(name, fmt::format("{} bytes follow its end", bytes.size() - sizes.file()));
  }
  const std::string_view checked = bytes.substr(0, bytes.size() - kChecksumSize);
  if (ByteReader(bytes.substr(checked.size())).Uint<uint64_t>() != Checksum(checked)) {
    return Damaged(name, "its checksum differs");
  }
  auto vocabulary = Vocabulary::Create(ReadTables(training_images, sizes, reader));
  if (!vocabulary.ok()) return Damaged(name, std::string(vocabulary.status().message()));
  return vocabulary;
}

absl::StatusOr<Vocabulary> ReadVocabulary(const std::filesystem::path& path) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxVocabularyFileBytes));
  return DecodeVocabulary(bytes, path.string());
}

}  // namespace carmap
