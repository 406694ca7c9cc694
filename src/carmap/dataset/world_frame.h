// Where on the Earth the frame of a drive's poses.txt lies, if the drive says so.
//
// KITTI's poses are in a frame of their own; `carmap simulate` writes world.json, by which they are
// east-north-up coordinates about a place. Pure function, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <optional>

#include "carmap/geometry/geodesy.h"

namespace carmap {

/// Origin of the east-north-up frame that poses.txt is in, by `frame` in the drive's world.json.
/// Nothing where there is no such file, or its frame is another. Errors: InvalidArgument, naming
/// the file, for one that is not JSON or has an origin that is not on the globe.
absl::StatusOr<std::optional<GpsFix>> ReadWorldOrigin(const std::filesystem::path& drive);

}  // namespace carmap
