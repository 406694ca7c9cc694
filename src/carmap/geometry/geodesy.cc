#include "carmap/geometry/geodesy.h"

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>
#include <cmath>
#include <vector>

namespace carmap {

bool IsValid(const GpsFix& fix) {
  return std::abs(fix.latitude_deg) <= 90 && std::abs(fix.longitude_deg) <= 180 &&
         std::abs(fix.altitude_m) <= 1e5;
}

Rigid3 EcefFromEnu(const GpsFix& origin) {
  Eigen::Vector3d p;
  std::vector<double> rows(9);
  GeographicLib::Geocentric::WGS84().Forward(origin.latitude_deg, origin.longitude_deg,
                                             origin.altitude_m, p.x(), p.y(), p.z(), rows);
  const Eigen::Matrix3d rotation =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
  return {Eigen::Quaterniond(rotation).normalized(), p};
}

GpsFix GpsOfEcef(const Eigen::Vector3d& p_in_ecef) {
  GpsFix fix;
  GeographicLib::Geocentric::WGS84().Reverse(p_in_ecef.x(), p_in_ecef.y(), p_in_ecef.z(),
                                             fix.latitude_deg, fix.longitude_deg, fix.altitude_m);
  return fix;
}

struct LocalEnu::Impl {
  GeographicLib::LocalCartesian plane;
};

LocalEnu::LocalEnu(const GpsFix& origin)
    : impl_(std::make_unique<const Impl>(Impl{GeographicLib::LocalCartesian(
          origin.latitude_deg, origin.longitude_deg, origin.altitude_m)})) {}
LocalEnu::~LocalEnu() = default;
LocalEnu::LocalEnu(LocalEnu&&) noexcept = default;
LocalEnu& LocalEnu::operator=(LocalEnu&&) noexcept = default;

Eigen::Vector3d LocalEnu::FromGps(const GpsFix& fix) const {
  Eigen::Vector3d p;
  impl_->plane.Forward(fix.latitude_deg, fix.longitude_deg, fix.altitude_m, p.x(), p.y(), p.z());
  return p;
}

GpsFix LocalEnu::ToGps(const Eigen::Vector3d& p_in_enu) const {
  GpsFix fix;
  impl_->plane.Reverse(p_in_enu.x(), p_in_enu.y(), p_in_enu.z(), fix.latitude_deg,
                       fix.longitude_deg, fix.altitude_m);
  return fix;
}

}  // namespace carmap
