// Where a vehicle will be: it keeps its speed and its turn for a moment.
//
// Pure functions, shared by the tracker and the localizer.
#pragma once

#include <Eigen/Geometry>

#include "carmap/geometry/rigid3.h"

namespace carmap {

/// The motion continued at the same speed for `factor` times as long.
inline Rigid3 Extrapolate(const Rigid3& motion, double factor) {
  const Eigen::AngleAxisd turn(motion.rotation);
  return {Eigen::Quaterniond(Eigen::AngleAxisd(turn.angle() * factor, turn.axis())),
          motion.translation * factor};
}

}  // namespace carmap
