// How the vehicle with the cameras drives: along a route, in a lane, at a speed, on its springs.
//
// Immutable, thread-safe.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/sim/render/renderer.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/route.h"
#include "carmap/sim/traffic/traffic.h"

namespace carmap {

/// Metres along the route at each frame. The first frame stands at the beginning of an open route.
/// Speeds up and slows down by 1.5 m/s², and takes curves with at most 2 m/s² to the side.
std::vector<double> AlongAtSpeed(const Route& route, double speed_mps, double frame_rate_hz,
                                 size_t max_frames);

struct EgoMotionOptions {
  double frame_rate_hz = 10;
  double camera_height_m = 1.65;
  double left_m = 0;       ///< of the route, in its direction
  bool reverse = false;    ///< looks and drives against the route's direction
  double unevenness = 1;   ///< of the road; 1 tilts the camera by a few milliradians
  uint64_t road_seed = 1;  ///< where its bumps are
};

class EgoMotion {
 public:
  /// `along_m` by frame; falling in reverse.
  EgoMotion(const Route& route, std::shared_ptr<const GroundMap> ground,
            std::vector<double> along_m, const EgoMotionOptions& options);

  size_t frame_count() const { return along_m_.size(); }
  double TimeOf(size_t frame_idx) const;
  Rigid3 EnuFromCamera(size_t frame_idx) const;
  /// Of the camera at that moment, seen from itself.
  ViewMotion MotionAt(size_t frame_idx) const;
  std::vector<EgoState> States() const;

 private:
  /// Between frames too: `frame` counts them.
  Rigid3 PoseAt(double frame) const;
  double AlongAt(double frame) const;

  Route route_;
  std::shared_ptr<const GroundMap> ground_;
  std::vector<double> along_m_;
  EgoMotionOptions options_;
};

}  // namespace carmap
