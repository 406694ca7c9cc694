// Columns: the same field of all records, one after the other, the form in which a lean map stores
// them.
//
// Bytes are compressed (zstd) where that makes them smaller. An integer is split into a token,
// which says how large it is and holds its three leading bits, and extra bits, its remainder.
// Tokens of one column repeat and are compressed (zstd); extra bits hardly do and are packed as
// they are. So small values cost a fraction of a byte and wide ones little more than their entropy.
// docs/format.md specifies both byte by byte.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "carmap/base/byte_io.h"

namespace carmap {

/// Signed values to unsigned ones of the same magnitude: 0, -1, 1, -2 … to 0, 1, 2, 3 …
inline uint64_t ZigZag(int64_t value) {
  return (static_cast<uint64_t>(value) << 1) ^ (value < 0 ? ~uint64_t{0} : 0);
}
inline int64_t UnZigZag(uint64_t value) {
  return static_cast<int64_t>((value >> 1) ^ (~(value & 1) + 1));
}

/// Appends a column, compressed at `zstd_level` (0: never) where that makes it smaller.
void AppendByteColumn(const std::string& bytes, int zstd_level, std::string& out);
void AppendIntColumn(const std::vector<uint64_t>& values, int zstd_level, std::string& out);

/// Read a column that must have `count` values. The caller bounds `count`: memory stays below 10
/// bytes a value. Errors: DataLoss, saying what is wrong but not in which file.
absl::StatusOr<std::string> ReadByteColumn(ByteReader& reader, size_t count);
absl::StatusOr<std::vector<uint64_t>> ReadIntColumn(ByteReader& reader, size_t count);

}  // namespace carmap
