// Who else is on the road: parked and moving vehicles, cyclists, pedestrians.
//
// All follows from the seed and the time alone, so a drive can be continued at any frame.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/sim/road/route.h"
#include "carmap/sim/road/scene.h"
#include "carmap/sim/town/world.h"

namespace carmap {

enum class TrafficDensity : uint8_t { kNone, kParked, kMoving, kDense };

/// Where the vehicle with the cameras is at a time, along the route and to the left of it.
struct EgoState {
  double time_s = 0, along_m = 0, left_m = 0, speed_mps = 0;
};

class Traffic {
 public:
  /// `ego` are the states of all frames of the drive, ascending. `first_model_idx` is the number of
  /// the first of `models()` in placements. On a route driven in reverse `ego` has falling
  /// `along_m`.
  Traffic(std::shared_ptr<const World> world, const Route& route, const RoadProfile& profile,
          TrafficDensity density, uint64_t seed, const std::vector<EgoState>& ego,
          uint32_t first_model_idx);
  ~Traffic();

  const std::vector<Mesh>& models() const;
  /// All parked and moving ones within sight of the vehicle at frame `frame_idx` of `ego`.
  std::vector<Placement> At(size_t frame_idx) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace carmap
