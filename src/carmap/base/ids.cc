#include "carmap/base/ids.h"

#include <fmt/format.h>

namespace carmap {

std::string ToHex(DriveId id) { return fmt::format("{:016x}{:016x}", id.input, id.options); }

}  // namespace carmap
