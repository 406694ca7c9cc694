// Daylight over the simulated world. Plain values.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace carmap {

enum class Weather : uint8_t { kSunny, kOvercast, kLowSun };

struct Light {
  Weather weather = Weather::kSunny;
  Eigen::Vector3d to_sun_in_enu = {0.5, -0.5, 0.7};  ///< unit length
  double sun = 1;     ///< irradiance on a surface facing it; 0 when overcast
  double sky = 0.35;  ///< irradiance of the whole sky on level ground
  uint64_t cloud_seed = 1;
};

/// The sun's place, strength and the clouds, drawn from the seed.
Light MakeLight(Weather weather, uint64_t seed);

}  // namespace carmap
