#include "carmap/format/lean_grid.h"

#include <cmath>

namespace carmap {
namespace {

constexpr int kRotationBits = 22;
constexpr int64_t kRotationUnit = int64_t{1} << kRotationBits;
/// Squared length, in squared steps, of parameters on the unit sphere.
constexpr int64_t kUnitSphere = kRotationUnit * kRotationUnit;

constexpr double kStepsPerDegree = 1e8;
constexpr double kStepsPerMetreAltitude = 1e3;

}  // namespace

GridVector ToGrid(const Eigen::Vector3d& vector, int exponent) {
  return {std::llround(std::ldexp(vector.x(), -exponent)),
          std::llround(std::ldexp(vector.y(), -exponent)),
          std::llround(std::ldexp(vector.z(), -exponent))};
}

Eigen::Vector3d FromGrid(const GridVector& grid, int exponent) {
  return grid.cast<double>() * std::ldexp(1.0, exponent);
}

bool IsInRange(const GridVector& grid, int exponent, double limit_m) {
  const int64_t limit = std::llround(std::ldexp(limit_m, -exponent));
  for (const int64_t steps : grid) {
    if (steps < -limit || steps > limit) return false;
  }
  return true;
}

GridVector RotationToGrid(const Eigen::Quaterniond& rotation) {
  Eigen::Quaterniond q = rotation.normalized();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d scaled = q.vec() / (1 + q.w()) * static_cast<double>(kRotationUnit);
  const GridVector nearest{std::llround(scaled.x()), std::llround(scaled.y()),
                           std::llround(scaled.z())};
  if (IsRotation(nearest)) return nearest;
  // Half a turn, rounded outwards: the parameters would leave the ball and name another half of it.
  return {static_cast<int64_t>(scaled.x()), static_cast<int64_t>(scaled.y()),
          static_cast<int64_t>(scaled.z())};
}

Eigen::Quaterniond RotationFromGrid(const GridVector& grid) {
  const int64_t squared_length = grid.squaredNorm();
  const double denominator = static_cast<double>(kUnitSphere + squared_length);
  const auto component = [&](int64_t steps) {
    return static_cast<double>(2 * kRotationUnit * steps) / denominator;
  };
  return {static_cast<double>(kUnitSphere - squared_length) / denominator, component(grid.x()),
          component(grid.y()), component(grid.z())};
}

bool IsRotation(const GridVector& grid) {
  for (const int64_t steps : grid) {
    if (steps < -kRotationUnit || steps > kRotationUnit) return false;
  }
  return grid.squaredNorm() <= kUnitSphere;
}

GridVector GpsToGrid(const GpsFix& fix) {
  return {std::llround(fix.latitude_deg * kStepsPerDegree),
          std::llround(fix.longitude_deg * kStepsPerDegree),
          std::llround(fix.altitude_m * kStepsPerMetreAltitude)};
}

GpsFix GpsFromGrid(const GridVector& grid) {
  return {static_cast<double>(grid.x()) / kStepsPerDegree,
          static_cast<double>(grid.y()) / kStepsPerDegree,
          static_cast<double>(grid.z()) / kStepsPerMetreAltitude};
}

}  // namespace carmap
