#include "carmap/sim/render/light.h"

#include <cmath>

#include "carmap/base/random.h"

namespace carmap {

Light MakeLight(Weather weather, uint64_t seed) {
  HashSequence random(seed, 0x5eed11u);
  Light light;
  light.weather = weather;
  light.cloud_seed = random.Next();
  const double azimuth = random.Between(0, 2 * M_PI);
  double elevation_deg = random.Between(35, 58);
  if (weather == Weather::kLowSun) {
    elevation_deg = random.Between(9, 16);
    light.sun = 0.8;
    light.sky = 0.22;
  } else if (weather == Weather::kOvercast) {
    light.sun = 0;
    light.sky = 0.5;
  }
  const double elevation = elevation_deg * M_PI / 180;
  light.to_sun_in_enu = {std::cos(elevation) * std::cos(azimuth),
                         std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
  return light;
}

}  // namespace carmap
