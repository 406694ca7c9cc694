// Exceptions as statuses: they mark bugs and machines out of memory, and must not cost what was
// done before. Stateless, thread-safe.
#pragma once

#include <absl/status/status.h>

#include <utility>

namespace carmap {

/// Of the exception that is being handled, one line: ResourceExhausted without memory, else
/// Internal.
absl::Status StatusOfException();

/// Does the work; not ok if it threw.
template <typename Work>
absl::Status CatchExceptions(Work&& work) {
  try {
    std::forward<Work>(work)();
    return absl::OkStatus();
  } catch (...) {
    return StatusOfException();
  }
}

}  // namespace carmap
