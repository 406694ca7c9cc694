// Fuzzes the decoder of lean maps: whatever the bytes, no crash, no exhausted memory, and a map
// that is accepted is consistent and comes back from its own bytes.
//
//   cmake --preset fuzz && cmake --build --preset fuzz --target decode_lean_map_fuzz
//   mkdir -p build/fuzz/corpus
//   build/fuzz/bin/decode_lean_map_fuzz -rss_limit_mb=1024 build/fuzz/corpus \
//       src/carmap/format/testdata
#include <xxhash.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>

#include "carmap/base/byte_io.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"

namespace {

void StoreUint64(uint64_t value, size_t offset, std::string& bytes) {
  for (size_t i = 0; i < 8; ++i) bytes[offset + i] = static_cast<char>(value >> (8 * i));
}

/// Seals the container anew (docs/format.md, "Container"), for else its checksums would keep every
/// mutation from the code behind them.
void RepairChecksums(std::string& bytes) {
  constexpr size_t kFixedSize = 24, kEntrySize = 20;
  if (bytes.size() < kFixedSize) return;
  carmap::ByteReader header(std::string_view(bytes).substr(12));
  const size_t sections = header.Uint<uint32_t>();
  if (sections > 64 || bytes.size() < kFixedSize + kEntrySize * sections + 8) return;
  const size_t table_end = kFixedSize + kEntrySize * sections;
  StoreUint64(bytes.size(), 16, bytes);
  size_t content = table_end + 8;
  for (size_t i = 0; i < sections; ++i) {
    const size_t entry = kFixedSize + kEntrySize * i;
    const size_t rest = bytes.size() - content;
    size_t length = carmap::ByteReader(std::string_view(bytes).substr(entry + 4)).Uint<uint64_t>();
    if (length > rest || i + 1 == sections) {
      length = rest;
      StoreUint64(length, entry + 4, bytes);
    }
    StoreUint64(XXH3_64bits(bytes.data() + content, length), entry + 12, bytes);
    content += length;
  }
  StoreUint64(XXH3_64bits(bytes.data(), table_end), table_end, bytes);
}

void Check(bool condition) {
  if (!condition) std::abort();
}

void Decode(const std::string& bytes) {
  const absl::StatusOr<carmap::LeanMap> map = carmap::DecodeLeanMap(bytes, "input");
  if (!map.ok()) return;
  Check(carmap::CheckConsistency(*map).ok());
  const absl::StatusOr<std::string> again = carmap::EncodeLeanMap(*map, {.zstd_level = 1});
  if (!again.ok()) return;  // its own file is smaller, and so is what that may expand to
  const absl::StatusOr<carmap::LeanMap> back = carmap::DecodeLeanMap(*again, "encoded again");
  Check(back.ok());
  Check(carmap::AreIdentical(*back, carmap::Quantize(*map)));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  Decode(bytes);
  RepairChecksums(bytes);
  Decode(bytes);
  return 0;
}
