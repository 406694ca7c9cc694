// What stands and lies along streets of any scene: the parts that scenes are put together from.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string_view>

#include "carmap/sim/town/site.h"

namespace carmap {

/// One side of a road.
struct RoadSide {
  const CentreLine* line;
  uint32_t line_idx;
  int side;  ///< +1 left, -1 right

  double length_m() const { return line->path.length_m(); }
  double sidewalk_m() const { return line->section.sidewalk_m; }
  double EdgeM() const { return line->section.Edge(side); }
  bool HasParking() const {
    return (side > 0 ? line->section.left_parking_m : line->section.right_parking_m) > 0;
  }
  /// Along the line, `out_m` beyond the carriageway's edge.
  Eigen::Vector2d At(double along_m, double out_m) const;
  /// Of who drives on this side, which is the heading of props here.
  double Heading(double along_m) const;
  /// Of a building's x axis (buildings.h).
  double BuildingHeading(double along_m) const { return Heading(along_m) + M_PI; }
  /// A sequence of numbers that depends on this side only.
  HashSequence Draw(uint64_t stream) const;
};
/// Both sides of all lines but connectors, those that the route drives first.
std::vector<RoadSide> RoadSidesOf(const Site& site);

/// True where the line's end is that of a street that leads nowhere.
bool IsDeadEnd(const CentreLine& line);

/// True when the route drives nowhere within that of the place.
bool IsOffRoute(const Site& site, const Eigen::Vector2d& p_in_enu, double distance_m);

/// Patches of other asphalt, trenches, cracks filled with tar, manhole covers, gullies.
void AddRoadWear(Site& site, const RoadSide& side);

/// Stop lines, zebra crossings with `zebra_share` of junctions, lines between parking bays.
void AddRoadMarks(Site& site, const CentreLine& line, double zebra_share);

/// Places along the kerb, but before and in junctions.
void AddKerbParking(Site& site, const RoadSide& side);

/// Every `spacing_m` or so, `out_m` from the edge; sometimes one is missing. Those that do not
/// fit are left out.
struct RowSpec {
  std::string_view kind;
  double spacing_m = 30, jitter_m = 2, out_m = 0.5;
  double chance = 1;
  double lift_m = 0, margin_m = 0;
  double scale_low = 1, scale_high = 1;
  bool one_variant = false;  ///< the same model all along
};
void AddRow(Site& site, const RoadSide& side, const RowSpec& row, uint64_t stream);

/// Wooden poles with wires between them.
void AddPoleLine(Site& site, const RoadSide& side, double out_m, double spacing_m, double lift_m);

/// Modules of fences, hedges, rails: one after the other from `begin_m` to `end_m` along the road.
/// `module_m` is the length of one.
void AddModules(Site& site, const RoadSide& side, std::string_view kind, uint32_t variant,
                double module_m, double begin_m, double end_m, double out_m, HashSequence& draw);

/// The same on a straight line.
void AddModulesBetween(Site& site, std::string_view kind, uint32_t variant, double module_m,
                       const Eigen::Vector2d& from, const Eigen::Vector2d& to, double edge_m,
                       HashSequence& draw);

/// A strip of other ground that leads away from the road, from `out_m` to `to_out_m`. Nothing may
/// be put there afterwards.
void AddWay(Site& site, const RoadSide& side, double along_m, double out_m, double to_out_m,
            double width_m, const GroundCover& cover);

/// A low wall along the road, part of the ground's tiles.
void AddGardenWall(Site& site, const RoadSide& side, double begin_m, double end_m, double out_m,
                   double height_m, const Surface& surface);

/// Trees and bushes in what is still free, up to 130 m from roads.
struct FillSpec {
  double near_share = 0.25, far_share = 0.4;  ///< of squares of 9 m, within 40 m and beyond
  double edge_m = 3;
};
void FillWithGreen(Site& site, const FillSpec& spec);

}  // namespace carmap
