#include "carmap/geometry/median_place.h"

#include <GeographicLib/Geocentric.hpp>
#include <algorithm>
#include <array>
#include <cstddef>

namespace carmap {
namespace {

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

GpsFix MedianPlace(const std::vector<GpsFix>& fixes) {
  const GeographicLib::Geocentric& earth = GeographicLib::Geocentric::WGS84();
  std::array<std::vector<double>, 3> coordinates;
  for (const GpsFix& fix : fixes) {
    std::array<double, 3> p;
    earth.Forward(fix.latitude_deg, fix.longitude_deg, fix.altitude_m, p[0], p[1], p[2]);
    for (size_t axis = 0; axis < p.size(); ++axis) coordinates[axis].push_back(p[axis]);
  }
  GpsFix place;
  earth.Reverse(MedianOf(coordinates[0]), MedianOf(coordinates[1]), MedianOf(coordinates[2]),
                place.latitude_deg, place.longitude_deg, place.altitude_m);
  return place;
}

}  // namespace carmap
