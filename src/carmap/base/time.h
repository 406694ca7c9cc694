// Time stamps of sensor data.
#pragma once

#include <cmath>
#include <compare>
#include <cstdint>

namespace carmap {

/// An instant in nanoseconds. The origin is the drive's own (KITTI's times.txt starts at 0).
struct Timestamp {
  int64_t ns = 0;
  auto operator<=>(const Timestamp&) const = default;

  double seconds() const { return static_cast<double>(ns) * 1e-9; }
  static Timestamp FromSeconds(double seconds) { return {std::llround(seconds * 1e9)}; }
};

}  // namespace carmap
