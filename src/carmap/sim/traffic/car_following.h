// How drivers keep their distance and their speed: the Intelligent Driver Model.
//
// Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and microscopic
// simulations, 2000; with the improved free-road term of Treiber, Kesting: Traffic Flow Dynamics,
// 2013, §11.3. Pure functions.
#pragma once

namespace carmap {

struct DriverModel {
  double acceleration = 1.5, deceleration = 2;  ///< comfortable ones, m/s²
  double hardest_braking = 7;                   ///< m/s²
  double standing_gap_m = 2.5, headway_s = 1.2;
};

/// The one ahead: from its rear to the own front, and its speed.
struct Ahead {
  double gap_m = 1e9, speed_mps = 0;
};

/// In m/s², for one that drives `speed_mps` and would like to drive `desired_mps`.
double FollowingAcceleration(const DriverModel& driver, double speed_mps, double desired_mps,
                             const Ahead& ahead);

}  // namespace carmap
