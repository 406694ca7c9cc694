// The cells that a base map is cut into, and the frame of each cell's tiles.
//
// On the Earth cells are S2 cells of one level, and a tile's frame is east-north-up at the cell's
// centre, at altitude 0; the root that all frames of a grid have in common is the Earth's centre
// (ECEF). Without any GPS cells are squares in the plane of x and z of a frame like a drive's own
// (y down), which is the root. Transforms between tiles are exact. Pure functions, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

struct CellGrid {
  bool is_on_earth = true;
  int level = 16;  ///< of S2 cells: about 140 m wide; local squares are as large

  bool operator==(const CellGrid&) const = default;
};

/// Whether there is such a cell.
bool IsCell(const CellGrid& grid, uint64_t cell);

/// The cell that a place lies in; altitude does not matter.
uint64_t CellAt(const CellGrid& grid, const Eigen::Vector3d& p_in_root);

/// All cells with a point within `radius_m` of the place, and possibly some nearby; ascending.
std::vector<uint64_t> CellsNear(const CellGrid& grid, const Eigen::Vector3d& p_in_root,
                                double radius_m);

Rigid3 RootFromTile(const CellGrid& grid, uint64_t cell);

/// From a frame like a drive's own, x to the right, y down, z forward (north on the Earth), with
/// the tile's origin. Maps that people look at, and searches, work in such frames.
Rigid3 RootFromView(const CellGrid& grid, uint64_t cell);

/// Corners of a cell in the root's frame, in order around it.
std::vector<Eigen::Vector3d> CornersOf(const CellGrid& grid, uint64_t cell);

}  // namespace carmap
