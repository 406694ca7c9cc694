// What became of the rows of a drive's gps.txt: which are fixes, which of them the vehicle's own
// motion bears out, and how their clock was matched with the camera's. A plain value.
#pragma once

#include <cstddef>
#include <string>

namespace carmap {

enum class GpsClock {
  kCamera,         ///< times are the camera's
  kStartTogether,  ///< of an origin of its own: the first row was taken at the first frame
  kTimeZone,       ///< off by whole quarters of an hour, as time zones are
  kOfAnotherDay,   ///< both are dates and have nothing in common: no frame takes a fix
};

/// Rows from the first frame to the last. Those that are in none of the counts below `rows` were
/// not judged: the vehicle was lost, or nothing tells where on the Earth the drive was.
struct GpsUse {
  size_t rows = 0;
  size_t without_fix = 0;  ///< zero, not a number, or not on the globe
  size_t frozen = 0;       ///< repeat the place of the row before though the vehicle went on
  size_t outliers = 0;     ///< further from where all fixes together put the vehicle than fixes err
  size_t used = 0;         ///< agree with the vehicle's motion
  GpsClock clock = GpsClock::kCamera;
  double clock_offset_s = 0;  ///< that was added to the rows' times to get the camera's
  /// In one line what the rows as a whole contradict, the likely cause and what to do; empty if
  /// nothing. Such rows do not hold the map, but for those that agree once a time zone is allowed
  /// for.
  std::string contradiction;
};

}  // namespace carmap
