// Fuzzes the decoder of vocabularies: whatever the bytes, no crash, no exhausted memory, and a
// vocabulary that is accepted gives every descriptor a word and comes back from its own bytes.
//
//   cmake --preset fuzz && cmake --build --preset fuzz --target decode_vocabulary_fuzz
//   mkdir -p build/fuzz/corpus
//   build/fuzz/bin/decode_vocabulary_fuzz -rss_limit_mb=1024 build/fuzz/corpus
#include <xxhash.h>

#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "carmap/base/byte_io.h"
#include "carmap/feature/vocabulary_file.h"

namespace {

constexpr std::string_view kMagicAndVersion(
    "\x89"
    "CMV\r\n\x1a\n\1\0\0\0",
    12);
constexpr size_t kMaxInnerNodes = 30;

void Check(bool condition) {
  if (!condition) std::abort();
}

/// A file whose numbers of children are these bytes and whose sizes and checksum fit them
/// (docs/vocabulary_format.md), for else these would keep every mutation from the code behind.
std::string FileOf(std::string_view child_counts) {
  uint32_t children = 0, leaves = 1;
  for (const char count : child_counts) {
    const auto of_node = static_cast<uint8_t>(count);
    children += of_node;
    leaves += of_node - (of_node > 0 ? 1 : 0);
  }
  std::string out(kMagicAndVersion);
  carmap::AppendUint(uint32_t{9}, out);
  carmap::AppendUint(static_cast<uint32_t>(child_counts.size()), out);
  carmap::AppendUint(children, out);
  carmap::AppendUint(leaves, out);
  out += child_counts;
  for (size_t i = 0; i < 32 * size_t{children} + 2 * size_t{leaves}; ++i) {
    out.push_back(static_cast<char>(i * i % 251));
  }
  carmap::AppendUint(uint64_t{XXH3_64bits(out.data(), out.size())}, out);
  return out;
}

void Decode(const std::string& bytes) {
  const auto vocabulary = carmap::DecodeVocabulary(bytes, "input");
  if (!vocabulary.ok()) return;
  Check(carmap::EncodeVocabulary(*vocabulary) == bytes);
  for (const carmap::Descriptor& center : vocabulary->tables().centers) {
    Check(vocabulary->WordOf(center) < vocabulary->word_count());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  Decode(bytes);
  Decode(FileOf(bytes.substr(0, kMaxInnerNodes)));
  return 0;
}
