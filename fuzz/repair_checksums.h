// Makes the checksums of a carmap file fit its bytes again (docs/format.md, "Container"), for else
// they would keep every mutation from the code behind them.
//
// Thread-safe.
#pragma once

#include <xxhash.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "carmap/base/byte_io.h"

namespace carmap {

inline void StoreUint64(uint64_t value, size_t offset, std::string& bytes) {
  for (size_t i = 0; i < 8; ++i) bytes[offset + i] = static_cast<char>(value >> (8 * i));
}

/// Size, lengths and checksums; the last section takes all bytes that are left.
inline void RepairChecksums(std::string& bytes) {
  constexpr size_t kFixedSize = 24, kEntrySize = 20;
  if (bytes.size() < kFixedSize) return;
  ByteReader header(std::string_view(bytes).substr(12));
  const size_t sections = header.Uint<uint32_t>();
  if (sections > 64 || bytes.size() < kFixedSize + kEntrySize * sections + 8) return;
  const size_t table_end = kFixedSize + kEntrySize * sections;
  StoreUint64(bytes.size(), 16, bytes);
  size_t content = table_end + 8;
  for (size_t i = 0; i < sections; ++i) {
    const size_t entry = kFixedSize + kEntrySize * i;
    const size_t rest = bytes.size() - content;
    size_t length = ByteReader(std::string_view(bytes).substr(entry + 4)).Uint<uint64_t>();
    if (length > rest || i + 1 == sections) {
      length = rest;
      StoreUint64(length, entry + 4, bytes);
    }
    StoreUint64(XXH3_64bits(bytes.data() + content, length), entry + 12, bytes);
    content += length;
  }
  StoreUint64(XXH3_64bits(bytes.data(), table_end), table_end, bytes);
}

}  // namespace carmap
