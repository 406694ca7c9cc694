#include "carmap/geometry/cell_grid.h"

#include <s2/s2cap.h>
#include <s2/s2cell.h>
#include <s2/s2cell_id.h>
#include <s2/s2latlng.h>
#include <s2/s2region_coverer.h>

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

constexpr double kMeanEarthRadiusM = 6'371'010;

/// Local squares are named by whole numbers of 32 bits, east and north of the origin.
double SideM(const CellGrid& grid) {
  constexpr double kSideAtLevel0M = 9.3e6;  // about that of S2 cells
  return std::round(std::ldexp(kSideAtLevel0M, -grid.level));
}

int32_t ColumnOf(uint64_t cell) { return static_cast<int32_t>(static_cast<uint32_t>(cell >> 32)); }
int32_t RowOf(uint64_t cell) { return static_cast<int32_t>(static_cast<uint32_t>(cell)); }

uint64_t LocalCell(double column, double row) {
  const auto whole = [](double number) {
    return static_cast<uint32_t>(
        static_cast<int32_t>(std::clamp(number, -2147483648.0, 2147483647.0)));
  };
  return (uint64_t{whole(column)} << 32) | whole(row);
}

S2LatLng LatLngOf(const Eigen::Vector3d& p_in_ecef) {
  const GpsFix fix = GpsOfEcef(p_in_ecef);
  return S2LatLng::FromDegrees(fix.latitude_deg, fix.longitude_deg);
}

GpsFix FixOf(const S2LatLng& place) { return {place.lat().degrees(), place.lng().degrees(), 0}; }

}  // namespace

bool IsCell(const CellGrid& grid, uint64_t cell) {
  if (!grid.is_on_earth) return true;
  const S2CellId id(cell);
  return id.is_valid() && id.level() == grid.level;
}

uint64_t CellAt(const CellGrid& grid, const Eigen::Vector3d& p_in_root) {
  if (grid.is_on_earth) return S2CellId(LatLngOf(p_in_root)).parent(grid.level).id();
  const double side_m = SideM(grid);
  return LocalCell(std::round(p_in_root.x() / side_m), std::round(p_in_root.z() / side_m));
}

std::vector<uint64_t> CellsNear(const CellGrid& grid, const Eigen::Vector3d& p_in_root,
                                double radius_m) {
  std::vector<uint64_t> cells;
  if (grid.is_on_earth) {
    S2RegionCoverer::Options options;
    options.set_fixed_level(grid.level);
    std::vector<S2CellId> covering;
    S2RegionCoverer(options).GetCovering(
        S2Cap(LatLngOf(p_in_root).ToPoint(), S1Angle::Radians(radius_m / kMeanEarthRadiusM)),
        &covering);
    for (const S2CellId& id : covering) cells.push_back(id.id());
  } else {
    const double side_m = SideM(grid);
    const auto index = [&](double metres) { return std::round(metres / side_m); };
    for (double column = index(p_in_root.x() - radius_m); column <= index(p_in_root.x() + radius_m);
         ++column) {
      for (double row = index(p_in_root.z() - radius_m); row <= index(p_in_root.z() + radius_m);
           ++row) {
        cells.push_back(LocalCell(column, row));
      }
    }
  }
  std::sort(cells.begin(), cells.end());
  cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  return cells;
}

Rigid3 RootFromTile(const CellGrid& grid, uint64_t cell) {
  if (grid.is_on_earth) return EcefFromEnu(FixOf(S2CellId(cell).ToLatLng()));
  const double side_m = SideM(grid);
  return {Eigen::Quaterniond::Identity(), {ColumnOf(cell) * side_m, 0, RowOf(cell) * side_m}};
}

Rigid3 RootFromView(const CellGrid& grid, uint64_t cell) {
  const Rigid3 root_from_tile = RootFromTile(grid, cell);
  if (!grid.is_on_earth) return root_from_tile;
  // East, down, north in east-north-up: a quarter turn about east.
  return root_from_tile * Rigid3{RotationExp({-M_PI / 2, 0, 0}), Eigen::Vector3d::Zero()};
}

std::vector<Eigen::Vector3d> CornersOf(const CellGrid& grid, uint64_t cell) {
  std::vector<Eigen::Vector3d> corners;
  if (grid.is_on_earth) {
    const S2Cell s2cell((S2CellId(cell)));
    for (int i = 0; i < 4; ++i) {
      corners.push_back(EcefFromEnu(FixOf(S2LatLng(s2cell.GetVertex(i)))).translation);
    }
    return corners;
  }
  const Eigen::Vector3d center = RootFromTile(grid, cell).translation;
  const double half_m = SideM(grid) / 2;
  for (const auto& [x, z] :
       {std::pair(-1, -1), std::pair(1, -1), std::pair(1, 1), std::pair(-1, 1)}) {
    corners.push_back(center + Eigen::Vector3d(x * half_m, 0, z * half_m));
  }
  return corners;
}

}  // namespace carmap
