// The roads of a simulated world: centre lines, cross-sections, junctions.
//
// Made of the route: where a later stretch of it runs along an earlier road, it is that road; where
// it crosses one, there are both. Side streets are added. "Left" and "right" are those of a centre
// line. Immutable once made, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "carmap/sim/road/route.h"
#include "carmap/sim/road/scene.h"

namespace carmap {

/// Across a road, from its centre line outwards, the same on both sides but for the strips.
struct RoadSection {
  double lane_width_m = 3.5;
  int lanes = 1;              ///< a direction
  double median_half_m = 0;   ///< between the centre line and the first lane
  double shoulder_m = 0;      ///< paved, beyond the last lane
  double left_parking_m = 0;  ///< width of the strip where cars park; 0 where there is none
  double right_parking_m = 0;
  double sidewalk_m = 0;  ///< beyond the carriageway, raised

  /// Of what is not driven on in the middle.
  double MedianStripHalf() const { return median_half_m > 0 ? median_half_m - 1.2 : -1e6; }
  /// From the centre line to the edge of the lanes.
  double LanesHalf() const { return median_half_m + lane_width_m * lanes; }
  /// To the edge of the carriageway on one side: +1 is left, -1 right.
  double Edge(int side) const {
    return LanesHalf() + shoulder_m + (side > 0 ? left_parking_m : right_parking_m);
  }
};

struct CentreLine {
  enum class Kind : uint8_t {
    kMain,       ///< driven by the route
    kSide,       ///< leads away from it
    kConnector,  ///< a turn between two roads that are there already
  };
  /// A stretch along the line that other roads' carriageways reach.
  struct Junction {
    double begin_m, end_m;
  };

  Kind kind = Kind::kMain;
  Route path;
  RoadSection section;
  std::vector<Junction> junctions;  ///< ascending, apart
  uint64_t seed = 0;

  bool InJunction(double along_m, double margin_m) const;
  /// From there to the next junction forwards and backwards, 0 in one; large where there is none.
  double ToJunctionAhead(double along_m) const;
  double ToJunctionBehind(double along_m) const;
};

/// Where a place is, seen from a stretch of road.
struct RoadHit {
  uint32_t line = 0;
  double along_m = 0, left_m = 0;
  double heading_rad = 0;
  /// To the edge of this carriageway, negative on it.
  double edge_m = 0;
};

class RoadNetwork {
 public:
  RoadNetwork(Scene scene, const Route& route, uint64_t seed);

  const std::vector<CentreLine>& lines() const { return lines_; }
  /// The stretches of road whose centre lines come within `reach_m`, one hit for each (the nearest
  /// point of it), nearest first. Two hits on one line are further apart along it than 40 m.
  std::vector<RoadHit> Near(const Eigen::Vector2d& p_in_enu, double reach_m) const;
  /// To the nearest carriageway's edge, negative on it; at least `reach_m` less half a road where
  /// there is none near.
  double EdgeDistance(const Eigen::Vector2d& p_in_enu, double reach_m) const;
  /// Points of all centre lines, about 4 m apart.
  std::vector<Eigen::Vector2d> Points() const;

 private:
  struct Run;  ///< of consecutive points of the route, on a road that is there already or a new one

  void AddLine(CentreLine::Kind kind, const Route& path, const RoadSection& section);
  std::vector<Run> SplitIntoRuns(const std::vector<RoutePoint>& route, bool closed) const;
  void AddRoute(const std::vector<RoutePoint>& route, bool closed);
  void AddConnectors(const std::vector<RoutePoint>& route);
  void AddSideStreets();
  void AddSideStreet(uint32_t from_line, double along_m, double heading_rad, double length_m);
  void FindJunctions();
  RoadSection DrawSection(uint64_t line_seed) const;
  static uint64_t CellKey(int64_t x, int64_t y);

  struct Entry {
    uint32_t line, point;
  };
  Scene scene_;
  uint64_t seed_;
  std::vector<CentreLine> lines_;
  double widest_m_ = 0;                                     ///< half carriageway
  std::unordered_map<uint64_t, std::vector<Entry>> cells_;  ///< points of lines; looked up only
};

/// The hit on one stretch from a place near its point `point`.
RoadHit HitAt(const CentreLine& line, uint32_t line_idx, size_t point,
              const Eigen::Vector2d& p_in_enu);

/// True where both are on one road, near each other along it.
bool SameStretch(const CentreLine& line, const RoadHit& a, const RoadHit& b);

}  // namespace carmap
