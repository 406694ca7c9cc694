// Whether a trajectory is one that a vehicle can have driven.
//
// Pure functions.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/slam/pair_check.h"

namespace carmap {

struct MotionHealth {
  double max_speed_mps = 0;
  double max_acceleration_mps2 = 0;  ///< between half seconds
  uint32_t acceleration_index = 0;   ///< frame number, where it is largest
  double max_jump_m = 0;             ///< from frame to frame, beyond going on as before
  uint32_t jump_index = 0;
};

/// `frame_indices`: number of each of the trajectory's frames. Where frames have no pose nothing is
/// said.
MotionHealth MeasureMotion(const Trajectory& trajectory,
                           const std::vector<uint32_t>& frame_indices);

/// Nothing of a motion that a road vehicle can have.
std::optional<Suspicion> JudgeMotion(const MotionHealth& motion);

}  // namespace carmap
