// Order statistics of a series of measurements, as reports give them.
#pragma once

#include <vector>

namespace carmap {

struct Summary {
  double median = 0, mean = 0, p95 = 0, p99 = 0, max = 0;
};

/// All zero for no values. The percentiles are nearest-rank: each is one of the values.
Summary Summarize(std::vector<double> values);

}  // namespace carmap
