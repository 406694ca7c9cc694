// The motion of the vehicle with the cameras at fixed steps of time, as traffic looks at it.
//
// "Progress" grows in its own direction of travel: it is the distance along the route, or minus
// that on a route driven in reverse, and goes on growing lap by lap on a closed one. Immutable,
// thread-safe.
#pragma once

#include <vector>

#include "carmap/sim/road/route.h"
#include "carmap/sim/traffic/traffic.h"

namespace carmap {

class EgoTrack {
 public:
  static constexpr double kStepS = 0.1;
  static constexpr double kLengthM = 4.8, kWidthM = 1.9;

  struct Instant {
    double progress_m = 0, left_m = 0;  ///< never goes back; to the left of the route
    double speed_mps = 0;
  };

  /// `ego` has at least one state; times ascend.
  EgoTrack(const Route& route, const std::vector<EgoState>& ego);

  /// From the first state to at least one step after the last.
  const std::vector<Instant>& instants() const { return instants_; }
  int direction() const { return direction_; }  ///< +1 along the route, -1 against it
  /// Usual speed while it moves, at least 3 m/s.
  double cruise_mps() const { return cruise_mps_; }
  /// In steps and fractions of steps.
  double StepAt(double time_s) const { return (time_s - start_s_) / kStepS; }
  /// How far to the left of the route it drives there.
  double LeftAt(double progress_m) const;
  /// When it is there, or nearest to it.
  size_t StepNear(double progress_m) const;

 private:
  std::vector<Instant> instants_;
  double start_s_ = 0, cruise_mps_ = 3;
  int direction_ = 1;
};

}  // namespace carmap
