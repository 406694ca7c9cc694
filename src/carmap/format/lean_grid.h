// The whole numbers that a lean map file stores for poses, positions and GPS fixes.
//
// Each value is rounded to a grid once; what comes back lies on the grid and is rounded to the same
// numbers again. Coming back takes only exact operations and single divisions, so every machine
// gives the same bits. Pure functions.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

using GridVector = Eigen::Matrix<int64_t, 3, 1>;

/// No coordinate of a map may exceed this, metres: more than the radius of the Earth.
inline constexpr double kMaxCoordinateM = 1 << 24;

/// No landmark may be farther from its anchor, metres: there the rotation, rounded, moves it by as
/// much as a metre.
inline constexpr double kMaxAnchorDistanceM = 1e6;

/// Camera centres lie on a grid of 2^-13 m (0.12 mm), landmarks on one of 2^-8 m (3.9 mm).
inline constexpr int kTranslationExponent = -13;
inline constexpr int kPositionExponent = -8;
/// Exponents of the landmark grid that a reader takes.
inline constexpr int kMinPositionExponent = kTranslationExponent, kMaxPositionExponent = 0;

/// Vectors in metres; coordinates up to kMaxCoordinateM.
GridVector ToGrid(const Eigen::Vector3d& vector, int exponent);
Eigen::Vector3d FromGrid(const GridVector& grid, int exponent);
/// True when FromGrid gives coordinates up to `limit_m`.
bool IsInRange(const GridVector& grid, int exponent, double limit_m);

/// Rotations as modified Rodrigues parameters, tan(angle / 4) axis, in steps of 2^-22: at most
/// 0.9e-6 rad off. Of the two of a rotation the one inside the unit ball.
GridVector RotationToGrid(const Eigen::Quaterniond& rotation);
Eigen::Quaterniond RotationFromGrid(const GridVector& grid);
/// True when the parameters lie in the unit ball.
bool IsRotation(const GridVector& grid);

/// Latitude and longitude in 1e-8 degrees (1.1 mm), altitude in millimetres.
GridVector GpsToGrid(const GpsFix& fix);
GpsFix GpsFromGrid(const GridVector& grid);

}  // namespace carmap
