#include "carmap/format/columns.h"

#include <absl/status/status.h>
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <string_view>

#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

/// Values below this are their own token.
constexpr uint64_t kFirstSplitValue = 4;

struct Token {
  uint8_t token;
  int extra_bits;
};

/// Token 4 (e - 1) + m stands for the values whose leading bit is 2^e and whose next two bits are
/// m.
Token TokenOf(uint64_t value) {
  if (value < kFirstSplitValue) return {static_cast<uint8_t>(value), 0};
  const int exponent = std::bit_width(value) - 1;
  const int extra_bits = exponent - 2;
  const uint64_t mantissa = (value >> extra_bits) & 3;
  return {static_cast<uint8_t>(4 * (exponent - 1) + static_cast<int>(mantissa)), extra_bits};
}

constexpr int kLargestToken = 4 * 62 + 3;

int ExtraBitsOf(uint8_t token) { return token < kFirstSplitValue ? 0 : token / 4 - 1; }

uint64_t SmallestValueOf(uint8_t token) {
  if (token < kFirstSplitValue) return token;
  return (4 + static_cast<uint64_t>(token % 4)) << ExtraBitsOf(token);
}

/// Packs numbers of few bits, the low bit of each first, into bytes, the low bit of each first.
class BitWriter {
 public:
  explicit BitWriter(std::string& out) : out_(out) {}

  void Append(uint64_t value, int bits) {
    for (int done = 0; done < bits;) {
      const int taken = std::min(bits - done, 8 - used_);
      const uint64_t piece = (value >> done) & ((1u << taken) - 1);
      current_ = static_cast<uint8_t>(current_ | (piece << used_));
      done += taken;
      used_ += taken;
      if (used_ == 8) Flush();
    }
  }

  void Flush() {
    if (used_ == 0) return;
    out_.push_back(static_cast<char>(current_));
    current_ = 0;
    used_ = 0;
  }

 private:
  std::string& out_;
  uint8_t current_ = 0;
  int used_ = 0;
};

/// Takes out what BitWriter packed; the caller has checked that the bytes suffice.
class BitReader {
 public:
  explicit BitReader(std::string_view bytes) : bytes_(bytes) {}

  uint64_t Take(int bits) {
    uint64_t value = 0;
    for (int done = 0; done < bits;) {
      const int offset = static_cast<int>(position_ % 8);
      const int taken = std::min(bits - done, 8 - offset);
      const uint64_t byte = static_cast<uint8_t>(bytes_[position_ / 8]);
      value |= ((byte >> offset) & ((1u << taken) - 1)) << done;
      done += taken;
      position_ += static_cast<size_t>(taken);
    }
    return value;
  }

 private:
  std::string_view bytes_;
  size_t position_ = 0;  ///< in bits
};

std::string Compress(const std::string& raw, int zstd_level) {
  std::string compressed(ZSTD_compressBound(raw.size()), '\0');
  const size_t size =
      ZSTD_compress(compressed.data(), compressed.size(), raw.data(), raw.size(), zstd_level);
  // It cannot fail with room for the bound; should it, the column is stored as it is.
  if (ZSTD_isError(size)) return raw;
  compressed.resize(size);
  return compressed;
}

}  // namespace

void AppendByteColumn(const std::string& bytes, int zstd_level, std::string& out) {
  if (zstd_level != 0) {
    const std::string compressed = Compress(bytes, zstd_level);
    if (compressed.size() < bytes.size()) {
      AppendVarint(compressed.size(), out);
      out += compressed;
      return;
    }
  }
  AppendVarint(0, out);
  out += bytes;
}

absl::StatusOr<std::string> ReadByteColumn(ByteReader& reader, size_t count) {
  const uint64_t compressed_size = reader.Varint();
  const std::string_view stored = reader.Bytes(compressed_size == 0 ? count : compressed_size);
  if (!reader.ok()) return absl::DataLossError("a column ends too early");
  if (compressed_size == 0) return std::string(stored);
  std::string bytes(count, '\0');
  const size_t size = ZSTD_decompress(bytes.data(), bytes.size(), stored.data(), stored.size());
  if (ZSTD_isError(size) || size != count) {
    return absl::DataLossError("a column does not decompress to the values that the map needs");
  }
  return bytes;
}

void AppendIntColumn(const std::vector<uint64_t>& values, int zstd_level, std::string& out) {
  std::string tokens, extra;
  tokens.reserve(values.size());
  BitWriter writer(extra);
  for (const uint64_t value : values) {
    const Token token = TokenOf(value);
    tokens.push_back(static_cast<char>(token.token));
    writer.Append(value, token.extra_bits);
  }
  writer.Flush();
  AppendByteColumn(tokens, zstd_level, out);
  out += extra;
}

absl::StatusOr<std::vector<uint64_t>> ReadIntColumn(ByteReader& reader, size_t count) {
  CARMAP_ASSIGN_OR_RETURN(const std::string tokens, ReadByteColumn(reader, count));
  uint64_t extra_bits = 0;
  for (const char c : tokens) {
    const uint8_t token = static_cast<uint8_t>(c);
    if (token > kLargestToken) return absl::DataLossError("a column holds an unknown token");
    extra_bits += static_cast<uint64_t>(ExtraBitsOf(token));
  }
  const std::string_view extra = reader.Bytes((extra_bits + 7) / 8);
  if (!reader.ok()) return absl::DataLossError("a column ends too early");

  BitReader bits(extra);
  std::vector<uint64_t> values(count);
  for (size_t i = 0; i < count; ++i) {
    const uint8_t token = static_cast<uint8_t>(tokens[i]);
    values[i] = SmallestValueOf(token) | bits.Take(ExtraBitsOf(token));
  }
  return values;
}

}  // namespace carmap
