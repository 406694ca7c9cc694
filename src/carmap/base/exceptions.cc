#include "carmap/base/exceptions.h"

#include <fmt/format.h>

#include <exception>
#include <new>

namespace carmap {

absl::Status StatusOfException() {
  try {
    throw;
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        "out of memory; free some, or work on a shorter drive or a smaller map");
  } catch (const std::exception& error) {
    return absl::InternalError(fmt::format("internal error: {}; please report it", error.what()));
  } catch (...) {
    return absl::InternalError("internal error; please report it");
  }
}

}  // namespace carmap
