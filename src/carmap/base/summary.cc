#include "carmap/base/summary.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace carmap {

Summary Summarize(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto count = static_cast<double>(values.size());
  const auto nearest_rank = [&](double fraction) {
    return values[static_cast<size_t>(std::ceil(fraction * count)) - 1];
  };
  return {.median = nearest_rank(0.5),
          .mean = std::accumulate(values.begin(), values.end(), 0.0) / count,
          .p95 = nearest_rank(0.95),
          .p99 = nearest_rank(0.99),
          .max = values.back()};
}

}  // namespace carmap
