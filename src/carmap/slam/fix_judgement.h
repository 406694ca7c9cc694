// Which of a receiver's fixes the vehicle's own motion bears out, and why none, if none.
//
// A fix is judged by where all of them together put the vehicle (Georeference): the receiver's
// errors are not known, the way is. Deterministic.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>

#include "carmap/dataset/gps_log.h"
#include "carmap/dataset/gps_use.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/slam/georeference_map.h"

namespace carmap {

/// Tells a receiver that repeats its last fix while the vehicle goes on from one on a vehicle that
/// stands. Owned by one thread.
class FreezeDetector {
 public:
  /// Fixes in the order of time, each with the place of the vehicle in its map. True if the fix is
  /// the one before to the last digit and the vehicle has moved since that was first given.
  bool IsFrozen(const GpsFix& fix, const Eigen::Vector3d& p_in_map);

 private:
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();  // equals nothing

  GpsFix fix_{kNone, kNone, kNone};
  Eigen::Vector3d first_given_at_ = Eigen::Vector3d::Zero();
};

/// What became of the rows along a trajectory in the map's frame, one entry a frame, with times.
/// Without a georeference the rows are tested for what they might be instead: radians, latitude and
/// longitude swapped, a hemisphere's sign forgotten.
GpsUse JudgeFixes(const GpsLog& log, const Trajectory& map_from_camera,
                  const std::optional<Georeference>& georeference, const GpsOptions& options);

}  // namespace carmap
