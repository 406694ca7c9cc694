// Little-endian numbers in byte strings, whatever the machine's own order.
//
// ByteReader is for bytes from outside: it never reads past the end. A read that would is
// remembered as a failure and gives zero; callers check ok() before they use what they read. Not
// thread-safe.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace carmap {

template <std::unsigned_integral T>
void AppendUint(T value, std::string& out) {
  for (size_t i = 0; i < sizeof(T); ++i) {
    out.push_back(static_cast<char>(static_cast<uint8_t>(static_cast<uint64_t>(value) >> (8 * i))));
  }
}

inline void AppendDouble(double value, std::string& out) {
  AppendUint(std::bit_cast<uint64_t>(value), out);
}

inline void AppendFloat(float value, std::string& out) {
  AppendUint(std::bit_cast<uint32_t>(value), out);
}

/// LEB128: seven bits a byte, low ones first, the top bit set on all but the last.
inline void AppendVarint(uint64_t value, std::string& out) {
  for (; value >= 0x80; value >>= 7) out.push_back(static_cast<char>(value | 0x80));
  out.push_back(static_cast<char>(value));
}

class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : rest_(bytes) {}

  /// False once a read went past the end or met a varint of more than 64 bits.
  bool ok() const { return ok_; }
  size_t remaining() const { return rest_.size(); }

  /// The next `count` bytes; empty on failure.
  std::string_view Bytes(uint64_t count) {
    if (count > rest_.size()) {
      Fail();
      return {};
    }
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }

  template <std::unsigned_integral T>
  T Uint() {
    uint64_t value = 0;
    const std::string_view bytes = Bytes(sizeof(T));
    for (size_t i = 0; i < bytes.size(); ++i) {
      value |= static_cast<uint64_t>(static_cast<uint8_t>(bytes[i])) << (8 * i);
    }
    return static_cast<T>(value);
  }

  double Double() { return std::bit_cast<double>(Uint<uint64_t>()); }

  uint64_t Varint() {
    uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const uint64_t byte = Uint<uint8_t>();
      value |= (byte & 0x7f) << shift;
      if (byte < 0x80) {
        if (shift == 63 && byte > 1) Fail();
        return ok_ ? value : 0;
      }
    }
    Fail();
    return 0;
  }

 private:
  void Fail() {
    ok_ = false;
    rest_ = {};
  }

  std::string_view rest_;
  bool ok_ = true;
};

}  // namespace carmap
