// A GPS receiver on the simulated vehicle.
//
// Each fix is the camera's true place plus white noise plus a bias that wanders slowly (first-order
// Gauss-Markov); in urban streets there are excursions to 30-50 m for some seconds where signals
// come by way of the façades (multipath), and outages, in which there are no fixes. Bias,
// excursions and outages are the same whatever the rate. Excursions and outages belong to places:
// each stretch of 1 km / (number per km) that is driven has one, begun at a random place of it, so
// a vehicle that stands collects no more of them. Pure functions.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "carmap/base/time.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/geodesy.h"

namespace carmap {

enum class GpsQuality : uint8_t { kOpen, kUrban };

struct GpsModel {
  double rate_hz = 10;
  double noise_m = 0.5;          ///< white, standard deviation of each horizontal axis
  double bias_m = 1;             ///< standard deviation of the wandering bias
  double bias_time_s = 60;       ///< in which it forgets
  double vertical_factor = 2;    ///< the vertical errors are larger by this factor
  double excursions_per_km = 0;  ///< multipath; one that begins during another is left out
  double excursion_min_m = 30, excursion_max_m = 50;  ///< horizontal error at the peak
  double excursion_s = 6;                             ///< mean; each lasts half to one and a half
  double outages_per_km = 0;
  double outage_s = 3;  ///< as `excursion_s`
};
GpsModel ModelOf(GpsQuality quality);

struct SimulatedFix {
  Timestamp time;
  GpsFix fix;
};

/// From the first frame to the last. `enu_from_camera` has time stamps, ascending, and poses of all
/// frames; between them the camera moves evenly.
std::vector<SimulatedFix> SimulateGps(const Trajectory& enu_from_camera, const GpsFix& origin,
                                      const GpsModel& model, uint64_t seed);

/// In the form of a drive's gps.txt, to the millimetre, with a comment that states the model.
std::string GpsText(const std::vector<SimulatedFix>& fixes, const GpsModel& model);

}  // namespace carmap
