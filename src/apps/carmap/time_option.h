// Moments, as people write them.
#pragma once

#include <absl/status/statusor.h>

#include <string>

#include "carmap/base/time.h"

namespace carmap {

/// "2026-11-28T04:17:55Z", or seconds since 1970, given as this option. Errors: InvalidArgument.
absl::StatusOr<Timestamp> ParseTime(const std::string& option, const std::string& text);

}  // namespace carmap
