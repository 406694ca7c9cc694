// Time stamps of sensor data.
#pragma once

#include <cmath>
#include <compare>
#include <cstdint>

namespace carmap {

/// An instant in nanoseconds. The origin is the drive's own (KITTI's times.txt starts at 0).
struct Timestamp {
  /// Of what is read from files: sums and differences of three stay within 64 bits. 95 years.
  static constexpr int64_t kMaxNs = 3'000'000'000'000'000'000;

  int64_t ns = 0;
  auto operator<=>(const Timestamp&) const = default;

  bool is_in_range() const { return -kMaxNs <= ns && ns <= kMaxNs; }

  double seconds() const { return static_cast<double>(ns) * 1e-9; }
  static Timestamp FromSeconds(double seconds) { return {std::llround(seconds * 1e9)}; }
};

}  // namespace carmap
