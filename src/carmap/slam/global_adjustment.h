// Bundle adjustment of all keyframes of a map at once, while the map goes on changing.
#pragma once

#include <atomic>
#include <cstddef>
#include <future>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/slam/map_bundle.h"
#include "carmap/solve/bundle_adjustment.h"
#include "carmap/solve/position_prior.h"

namespace carmap {

struct GlobalAdjustmentOptions {
  MeasurementNoise noise;
  BundleOptions bundle;
  size_t min_observations = 3;  ///< of landmarks that take part
  /// Landmarks that are chosen to hold each keyframe, those first that most keyframes see. The
  /// others follow their keyframes: they would add more to the time than to the poses.
  size_t landmarks_per_keyframe = 150;
};

/// The landmarks that take part, ascending.
std::vector<LandmarkId> ChooseLandmarks(const Map& map, const GlobalAdjustmentOptions& options);

/// The whole map as a problem. With `fixes` (FixesAsPriors) all poses are free.
MapBundle MakeGlobalBundle(const Map& map, const StereoRig& rig,
                           const std::vector<PositionPrior>& fixes,
                           const GlobalAdjustmentOptions& options);

/// Solves on a thread of its own, from construction on; sequentially it solves when the result is
/// asked for. Destroyed before, it stops.
class GlobalAdjustment {
 public:
  GlobalAdjustment(MapBundle problem, const BundleOptions& options, bool sequential);
  ~GlobalAdjustment();
  GlobalAdjustment(const GlobalAdjustment&) = delete;
  GlobalAdjustment& operator=(const GlobalAdjustment&) = delete;

  /// Waits for the result: an edit against the version of the map that the problem was made of. To
  /// be asked once. Throws what the solver threw.
  MapEdit Finish();

 private:
  MapBundle problem_;
  BundleOptions options_;
  std::atomic<bool> stop_ = false;
  std::future<BundleSummary> summary_;  ///< last: its destructor waits for the thread
};

}  // namespace carmap
