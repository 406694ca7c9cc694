// The vehicle's pose, frame by frame, in the map that it is building (paper §2, pose estimation).
//
// Owned by one thread. Reads immutable snapshots that the local mapper publishes.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/slam/local_mapper.h"

namespace carmap {

struct TrackerOptions {
  TrackingOptions tracking;
  int min_first_features = 100;          ///< with depth, to begin a map
  double max_keyframe_distance_m = 1.8;  ///< a keyframe at least this often while moving
  double max_keyframe_turn_rad = 0.12;
  double min_tracked_ratio = 0.7;  ///< of the landmarks tracked after the last keyframe
  int min_tracked = 120;           ///< fewer call for a keyframe at once
};

/// What tracking made of one frame.
struct TrackedFrame {
  /// Keyframe that the pose is relative to, and the pose; absent if the frame was lost.
  std::optional<KeyframeId> reference;
  Rigid3 camera_from_reference;
  /// Landmarks of the snapshot that agree with the pose.
  std::vector<std::pair<LandmarkId, uint32_t>> landmark_of_feature;
  Rigid3 map_from_camera;
  bool wants_keyframe = false;
  std::string lost_because;  ///< empty unless lost
};

class Tracker {
 public:
  explicit Tracker(const TrackerOptions& options) : options_(options) {}

  /// `local` is the mapper's latest: the newest keyframe is its last; null before the first.
  /// A frame without a map wants to become the first keyframe if it has features enough.
  TrackedFrame Track(Timestamp timestamp, const std::vector<Feature>& features,
                     const LocalMap* local);

 private:
  std::optional<TrackedPose> FindPose(const FeatureGrid& grid, const LocalMap& local,
                                      const Rigid3& predicted_camera_from_map) const;
  Rigid3 Predict(Timestamp timestamp, const MapSnapshot& map) const;
  bool WantsKeyframe(const TrackedFrame& frame, const MapSnapshot& map) const;

  const TrackerOptions options_;

  /// The last frame with a pose, relative to a keyframe so that it follows when that is adjusted.
  struct LastPose {
    Timestamp timestamp;
    KeyframeId reference;
    Rigid3 camera_from_reference;
    Rigid3 this_from_previous;  ///< motion since the tracked frame before
    double interval_s = 0;      ///< that it took; 0 if there was none
  };
  std::optional<LastPose> last_;
  /// Landmarks tracked in the first frame after the newest keyframe: what its map offers at best.
  KeyframeId newest_keyframe_;
  size_t tracked_after_keyframe_ = 0;
};

}  // namespace carmap
