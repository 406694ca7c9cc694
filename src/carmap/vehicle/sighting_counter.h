// Which landmarks of the base a vehicle saw, and which it should have seen but did not: what the
// base forgets by (paper §3.4 leaves it open).
//
// A landmark is expected in a frame whose pose is known well, from about where it was recognised
// before, where nothing stands before it: the image's dense disparity tells, and where it does not,
// nothing is said. Owned by one thread.
#pragma once

#include <absl/container/flat_hash_map.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/feature/dense_disparity.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/map_neighbourhood.h"
#include "carmap/map/map_diff.h"
#include "carmap/vehicle/base_tracker.h"

namespace carmap {

struct SightingOptions {
  NeighbourhoodOptions neighbourhood;
  double spacing_m = 1;      ///< of frames in which landmarks are expected
  double max_sigma_m = 0.3;  ///< of their poses
  size_t min_inliers = 15;   ///< and of the base in them

  // From where a landmark is expected to be recognised.
  double border_ratio = 0.02;           ///< of the image's width, without it
  double distance_slack = 1.2;          ///< beyond the distances that it was seen from
  double max_viewing_angle_rad = 0.35;  ///< from the mean direction
  double min_disparity_rad = 0.008;     ///< as an angle: 50 m away on a baseline of 0.4 m

  // What stands there: in a window around it so much nearer than it, or so much farther.
  double window_rad = 0.012, min_known_share = 0.6;
  double depth_m = 0.8, depth_ratio = 0.08;
  double max_hidden_share = 0.1;   ///< of the window, that something nearer takes
  double max_present_share = 0.1;  ///< that is as near as it is, where it is seen through

  // What its frames together tell.
  size_t min_seen_frames = 2;      ///< one may be a false match
  size_t min_expected_frames = 3;  ///< without one in which it was seen: it is missed ...
  double min_through_share = 0.5;  ///< ... or seen through, in so many of them
};

class SightingCounter {
 public:
  explicit SightingCounter(const SightingOptions& options = {}) : options_(options) {}

  /// Whether the frame is one in which landmarks are expected, so that its disparities are needed.
  bool IsDue(const VehiclePose& pose) const;

  /// Frames in the order of time. `pose` is that in the frame of `base`; `disparities` of the frame
  /// if it is due.
  void Take(const ReconstructedMap& base, const StereoRig& rig, const VehiclePose& pose,
            const DenseDisparity* disparities);

  /// What was seen and missed of landmarks that the vehicle left behind by so much, metres driven;
  /// they begin anew.
  std::map<LandmarkId, Sighting> Release(double behind_m);

  /// Whether it was seen since its last release.
  bool HasSeen(LandmarkId id) const;

 private:
  struct Count {
    uint32_t seen_frames = 0, expected_frames = 0, through_frames = 0;
    double last_at_m = 0;
  };
  void Expect(const SnapshotLandmark& landmark, const StereoRig& rig,
              const Rigid3& camera_from_base, const DenseDisparity& disparities);
  bool IsInSight(const SnapshotLandmark& landmark, const StereoRig& rig,
                 const Rigid3& camera_from_base, const Eigen::Vector3d& p_in_camera) const;

  const SightingOptions options_;
  absl::flat_hash_map<LandmarkId, Count> counts_;
  std::optional<Rigid3> last_, last_due_;  ///< base_from_camera
  double driven_m_ = 0;
};

}  // namespace carmap
