#include "apps/carmap/time_option.h"

#include <absl/strings/numbers.h>
#include <absl/time/time.h>
#include <fmt/format.h>

namespace carmap {

absl::StatusOr<Timestamp> ParseTime(const std::string& option, const std::string& text) {
  double seconds = 0;
  if (absl::SimpleAtod(text, &seconds) && seconds >= 0 && seconds < 3e9) {
    return Timestamp::FromSeconds(seconds);
  }
  absl::Time time;
  if (std::string error; absl::ParseTime(absl::RFC3339_full, text, &time, &error)) {
    const Timestamp parsed{absl::ToUnixNanos(time)};
    if (parsed.is_in_range()) return parsed;
  }
  return absl::InvalidArgumentError(fmt::format(
      "{} {}: is no time; write 2026-11-28T04:17:55Z or seconds since 1970", option, text));
}

}  // namespace carmap
