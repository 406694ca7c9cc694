// Wall-clock durations and the memory of this process, for reports.
#pragma once

#include <chrono>

namespace carmap {

class Stopwatch {
 public:
  double ElapsedMs() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

/// Largest resident memory of this process so far, in MB (10^6 bytes).
double PeakMemoryMb();

}  // namespace carmap
