// The motion of vehicles one behind the other, in the lane of the vehicle with the cameras ("ego")
// and in others.
//
// Only the surroundings of ego are filled: vehicles come in and go out where it does not see them.
// Pure functions; all follows from the seed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "carmap/sim/road/lane_line.h"
#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/traffic/ego_track.h"
#include "carmap/sim/traffic/fleet.h"
#include "carmap/sim/traffic/obstacle_map.h"

namespace carmap {

/// The way of one vehicle or person along a path, at each step of an EgoTrack for a while.
struct Course {
  struct Place {
    double along_m = 0, left_m = 0;
  };

  uint32_t body = 0;            ///< of the fleet
  const Route* path = nullptr;  ///< outlives the course
  int direction = 1;            ///< of travel: +1 along the path, -1 against it
  size_t first_step = 0;
  std::vector<Place> places;
};

/// A body on a path, its axles on the path and so its middle inside of it in bends.
GroundBox OutlineOf(const Body& body, const Route& path, const Course::Place& place, int direction);

/// Where a lane is too narrow because something stands in it.
class NarrowPlaces {
 public:
  NarrowPlaces(const Route& path, const ObstacleMap& obstacles);
  /// From a place to the next where less than that is free to both sides; 1e9 where there is none
  /// within 150 m.
  double DistanceFrom(double along_m, int direction, double half_width_m) const;

 private:
  struct Narrow {
    double along_m, half_width_m;
  };
  std::vector<Narrow> narrows_;  // ascending
  double lap_m_ = 0;             // 0: open
};

struct LeaderOptions {
  std::span<const KindWeight> first, others;  ///< kinds of the nearest one, of those before it
  uint32_t max_members = 3;
  double min_gap_m = 20, max_gap_m = 45;  ///< from ego to the nearest one while it is near
  double min_near_s = 15, max_near_s = 30;
  double sight_m = 170;
};

/// Groups of vehicles ahead of ego in its own lane. They come near, drive ahead for a while, and
/// drive away. A leader is a follower when time runs backwards, so their motion is computed from
/// the drive's end to its beginning, and where ego stopped they stopped before it.
std::vector<Course> SimulateLeaders(const Route& route, const EgoTrack& ego, const Fleet& fleet,
                                    const LeaderOptions& options, HashSequence random);

struct FlowOptions {
  int direction = 1;  ///< of travel along the lane's path
  std::span<const KindWeight> mix;
  double mean_spacing_m = 60;  ///< from middle to middle
  /// Of each driver's desired speed to the base; that is `base_mps`, or ego's own at the time for
  /// those that drive with it.
  double min_factor = 0.85, max_factor = 1.1;
  bool with_ego = false;
  double base_mps = 10;
  double sight_m = 200;
};

/// The vehicles of another lane.
std::vector<Course> SimulateFlow(const LaneLine& lane, const NarrowPlaces& narrows,
                                 const EgoTrack& ego, const Fleet& fleet,
                                 const FlowOptions& options, HashSequence random);

}  // namespace carmap
