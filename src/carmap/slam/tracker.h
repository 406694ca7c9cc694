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
#include "carmap/slam/map_parts.h"

namespace carmap {

struct TrackerOptions {
  TrackingOptions tracking;
  /// Where too few measurements agree as tightly as the noise demands, they may be so many times
  /// noisier: small images of dark roads at speed. Slower than this a camera sees the same again,
  /// and what does not agree tightly is traffic.
  double noisy_factor = 2, min_noisy_speed_mps = 3;
  int min_first_features = 100;          ///< with depth, to begin a map or a new part of it
  double max_keyframe_distance_m = 1.8;  ///< from the nearest keyframe; farther calls for a new one
  double max_keyframe_turn_rad = 0.12;
  double min_keyframe_distance_m = 0.3;  ///< nearer none is made: a standing vehicle adds nothing
  double min_keyframe_turn_rad = 0.03;
  double min_tracked_ratio = 0.7;  ///< of the landmarks tracked when the vehicle came there
  int min_tracked = 120;           ///< fewer call for a keyframe at once
  int max_misplaced_frames = 3;    ///< in a row, found nowhere; then a new part of the map begins
};

/// What tracking made of one frame.
struct TrackedFrame {
  /// Keyframe that the pose is relative to, the nearest one, and the pose; absent if the frame was
  /// lost.
  std::optional<KeyframeId> reference;
  Rigid3 camera_from_reference;
  /// Motion since the frame before that had a pose, and how long ago that was; absent if nothing is
  /// known of it.
  std::optional<Rigid3> camera_from_previous;
  double since_previous_s = 0;
  DisparityBias disparity_bias;  ///< of the rig, as far as the drive so far tells
  /// Landmarks of the snapshot that agree with the pose.
  std::vector<std::pair<LandmarkId, uint32_t>> landmark_of_feature;
  Rigid3 map_from_camera;
  bool wants_keyframe = false;
  std::string lost_because;  ///< empty unless lost
  /// The frame shows enough to be found, but not where the vehicle should be: `map_from_camera`.
  bool is_misplaced = false;
  bool begins_part = false;  ///< of the map, unless the misplaced frame is found elsewhere
  Gap gap;                   ///< if so, what is known from before
};

class Tracker {
 public:
  explicit Tracker(const TrackerOptions& options) : options_(options) {}

  /// `local` is the map around the reference of the frame before, or around the newest keyframe if
  /// that frame became one; null before the first. A frame without a map wants to become the first
  /// keyframe if it has features enough.
  TrackedFrame Track(Timestamp timestamp, const std::vector<Feature>& features,
                     const LocalMap* local);

  /// The frame became the first keyframe of the map, or of a new part of it.
  void BeginAt(Timestamp timestamp, KeyframeId id) { last_ = LastPose{timestamp, id, {}, {}, 0}; }

  /// Goes on from where the misplaced frame was found, which tells nothing of its speed.
  TrackedFrame Resume(Timestamp timestamp, const LocatedFrame& found);

 private:
  /// The last frame with a pose, relative to a keyframe so that it follows when that is adjusted.
  struct LastPose {
    Timestamp timestamp;
    KeyframeId reference;
    Rigid3 camera_from_reference;
    Rigid3 this_from_previous;  ///< motion since the tracked frame before
    double interval_s = 0;      ///< that it took; 0 if there was none

    double SpeedMps() const { return this_from_previous.translation.norm() / interval_s; }
  };

  TrackedFrame Begin(const std::vector<Feature>& features);
  std::optional<TrackedPose> FindPose(Timestamp timestamp, const FeatureGrid& grid,
                                      const LocalMap& local) const;
  Rigid3 Predict(Timestamp timestamp, const LocalMap& local) const;
  TrackedFrame Accept(Timestamp timestamp, const LocalMap& local, const TrackedPose& pose);
  TrackedFrame Lose(Timestamp timestamp, const std::vector<Feature>& features,
                    const Rigid3& predicted_camera_from_map);
  bool WantsKeyframe(const TrackedFrame& frame) const;
  double StepsFrom(const Rigid3& reference_from_camera) const;

  const TrackerOptions options_;
  std::optional<LastPose> last_;
  /// Landmarks tracked in the first frame with this local map: what it offers at best.
  KeyframeId local_reference_;
  size_t tracked_at_best_ = 0;
  int misplaced_frames_ = 0;  ///< in a row
};

}  // namespace carmap
