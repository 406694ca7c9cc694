// The kinds of surroundings that a world can have, and what their roads look like to drivers.
//
// Plain values and pure functions.
#pragma once

#include <cstdint>

namespace carmap {

enum class Scene : uint8_t { kSuburb, kDowntown, kFreeway };

/// What the road looks like, for traffic and for the vehicle itself. Lanes are counted from the
/// route's own (0) to the left; negative ones lie to the right.
struct RoadProfile {
  double lane_width_m = 3.5;
  int first_lane = 0, last_lane = 1;  ///< all that may be driven in the route's direction ...
  int first_oncoming = 1, last_oncoming = 1;  ///< ... and against it
  double speed_mps = 10;                      ///< usual on it
};
RoadProfile ProfileOf(Scene scene);

}  // namespace carmap
