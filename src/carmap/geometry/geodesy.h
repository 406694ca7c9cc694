// Positions on the Earth and their local east-north-up plane.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "carmap/geometry/rigid3.h"

namespace carmap {

/// A GPS fix in WGS84.
struct GpsFix {
  double latitude_deg = 0, longitude_deg = 0, altitude_m = 0;
  bool operator==(const GpsFix&) const = default;
};

/// True when the numbers are finite and on the globe.
bool IsValid(const GpsFix& fix);

/// The east-north-up frame at a place, in the Earth's own frame (ECEF: origin at its centre, z to
/// the north pole).
Rigid3 EcefFromEnu(const GpsFix& origin);
GpsFix GpsOfEcef(const Eigen::Vector3d& p_in_ecef);

/// East-north-up coordinates in metres about an origin. Immutable, thread-safe.
class LocalEnu {
 public:
  explicit LocalEnu(const GpsFix& origin);
  ~LocalEnu();
  LocalEnu(LocalEnu&&) noexcept;
  LocalEnu& operator=(LocalEnu&&) noexcept;

  Eigen::Vector3d FromGps(const GpsFix& fix) const;
  GpsFix ToGps(const Eigen::Vector3d& p_in_enu) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace carmap
