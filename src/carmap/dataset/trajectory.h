// Camera paths over time, in KITTI's and TUM's text forms.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <optional>
#include <vector>

#include "carmap/base/time.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

struct TimedPose {
  std::optional<Timestamp> timestamp;       ///< absent in KITTI files
  std::optional<Rigid3> world_from_camera;  ///< absent where the frame was lost
};

using Trajectory = std::vector<TimedPose>;

/// Reads either form; the number of columns tells which (KITTI: 12, row-major 3×4, one line a
/// frame; TUM: `time x y z qx qy qz qw`, # comments). A KITTI line of 12 `nan` is a lost frame.
/// Errors: as ReadFile; InvalidArgument naming file and line for anything else in it (wrong column
/// count, not a number, not a rotation, TUM times that go back, no pose at all).
absl::StatusOr<Trajectory> ReadTrajectory(const std::filesystem::path& path);

/// Writes TUM form if the extension is .tum, otherwise KITTI form (lost frames as nan lines, so
/// that line n stays frame n). TUM form leaves lost frames out and needs time stamps.
absl::Status WriteTrajectory(const std::filesystem::path& path, const Trajectory& trajectory);

/// Metres along the poses that are there.
double PathLengthM(const Trajectory& trajectory);

}  // namespace carmap
