#include "carmap/sim/traffic/car_following.h"

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

double FreeAcceleration(const DriverModel& driver, double speed_mps, double desired_mps) {
  if (speed_mps <= desired_mps) {
    return driver.acceleration * (1 - std::pow(speed_mps / std::max(desired_mps, 1e-3), 4));
  }
  const double exponent = 4 * driver.acceleration / driver.deceleration;
  return -driver.deceleration * (1 - std::pow(desired_mps / speed_mps, exponent));
}

}  // namespace

double FollowingAcceleration(const DriverModel& driver, double speed_mps, double desired_mps,
                             const Ahead& ahead) {
  const double approach_mps = speed_mps - ahead.speed_mps;
  const double comfort = 2 * std::sqrt(driver.acceleration * driver.deceleration);
  const double moving_gap_m = speed_mps * driver.headway_s + speed_mps * approach_mps / comfort;
  const double desired_gap_m = driver.standing_gap_m + std::max(0.0, moving_gap_m);
  const double crowding = desired_gap_m / std::max(ahead.gap_m, 0.1);
  const double acceleration =
      FreeAcceleration(driver, speed_mps, desired_mps) - driver.acceleration * crowding * crowding;
  return std::max(acceleration, -driver.hardest_braking);
}

}  // namespace carmap
