// Frames that repeat the image before, as recorders write where a camera was late: they show
// nothing of their own, and lie where the vehicle's motion puts them. Pure function.
#pragma once

#include <cstddef>
#include <vector>

#include "carmap/dataset/trajectory.h"

namespace carmap {

/// Gives each of the `repeated` frames, ascending, a pose: the vehicle kept its speed from the
/// frame whose image it repeats to the next frame with a pose or, at the end of the drive, from
/// then on. Without a pose of the former there is none. Each entry of the trajectory has a time.
void PlaceRepeatedFrames(const std::vector<size_t>& repeated, Trajectory& trajectory);

}  // namespace carmap
