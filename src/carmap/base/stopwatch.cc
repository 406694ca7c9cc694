#include "carmap/base/stopwatch.h"

#include <sys/resource.h>

namespace carmap {

double PeakMemoryMb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024 / 1e6;
}

}  // namespace carmap
