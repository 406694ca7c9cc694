// The line that vehicles of one lane follow: as far to the left of the route everywhere.
//
// It has arc length of its own, longer than the route's in bends to the right of a line on the
// left. Immutable, thread-safe.
#pragma once

#include <vector>

#include "carmap/sim/road/route.h"

namespace carmap {

class LaneLine {
 public:
  LaneLine(const Route& route, double left_m);

  /// Runs in the route's direction. In bends sharper than the offset it cuts the corner.
  const Route& path() const { return path_; }
  /// Along `path()` beside a place of the route; beyond ends and laps too. Never falls.
  double Beside(double along_route_m) const;

 private:
  double route_length_m_, route_step_m_;
  std::vector<double> along_of_route_point_;
  Route path_;
};

/// How fast a path may be driven at each of its places, either way: curves with no more than
/// `sideways` m/s² to the side, slowing down before and speeding up after them by `lengthways`.
class SpeedLimit {
 public:
  SpeedLimit(const Route& path, double sideways, double lengthways);
  double At(double along_m) const;

 private:
  double length_m_, step_m_;
  bool closed_;
  std::vector<double> limits_;
};

}  // namespace carmap
