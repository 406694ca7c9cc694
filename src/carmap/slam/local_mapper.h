// Builds the map around the vehicle as keyframes come in (paper §2, map augmentation and error
// minimization): landmark creation, fusing, culling, local bundle adjustment.
//
// The one writer of its Map: owned by one thread. Each step reads the map and returns a MapEdit.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/solve/bundle_adjustment.h"

namespace carmap {

struct LocalMapperOptions {
  MeasurementNoise noise;
  size_t window_keyframes = 12;       ///< adjusted together, and offered to the tracker
  int min_shared_landmarks = 15;      ///< for a keyframe to count as a neighbour
  double min_new_disparity_px = 1.5;  ///< of a feature that becomes a landmark
  size_t trial_keyframes = 3;         ///< a landmark this many keyframes old ...
  size_t min_trial_observations = 3;  ///< ... must have been seen by this many, or goes
  size_t min_calibrating_keyframes =
      5;  ///< in the window, for the rig's disparity bias to be estimated
  double bias_step_sigma_rad = 1e-4;  ///< see BundleOptions; as angles, to suit any image size
  double max_bias_rad = 0.7e-3;       ///< half a pixel at a focal length of 700
  BundleOptions bundle;
};

/// A frame chosen as keyframe, with the landmarks that tracking found in it.
struct NewKeyframe {
  Keyframe keyframe;
  std::vector<std::pair<LandmarkId, uint32_t>> landmark_of_feature;
};

/// What the mapper offers the tracker: the map around the newest keyframe, and the rig as
/// calibrated so far.
struct LocalMap {
  MapSnapshot snapshot;
  StereoRig rig;
};

class LocalMapper {
 public:
  LocalMapper(const StereoRig& rig, DriveId drive_id, const LocalMapperOptions& options)
      : rig_(rig), drive_id_(drive_id), options_(options) {}

  /// Takes the keyframe into the map, improves the map around it, and returns that part.
  std::shared_ptr<const LocalMap> Insert(const NewKeyframe& keyframe);

  const Map& map() const { return map_; }
  /// The rig with the disparity bias that the adjustments found.
  const StereoRig& rig() const { return rig_; }
  /// Milliseconds spent in each step so far.
  const std::map<std::string, double>& step_ms() const { return step_ms_; }

 private:
  std::vector<KeyframeId> WindowAround(KeyframeId id) const;
  MapEdit InsertKeyframe(const NewKeyframe& keyframe) const;
  MapEdit FindKnownLandmarks(KeyframeId newest, const std::vector<KeyframeId>& window) const;
  MapEdit CreateLandmarks(KeyframeId newest);
  MapEdit FindInNeighbours(KeyframeId newest, const std::vector<KeyframeId>& window) const;
  MapEdit RefreshDescriptors(KeyframeId newest) const;
  MapEdit CullLandmarks() const;
  MapEdit AdjustWindow(const std::vector<KeyframeId>& window);
  Eigen::Vector3d Triangulate(const Keyframe& keyframe, const Feature& feature) const;
  void Carry(const char* step, const MapEdit& edit, double elapsed_ms);

  StereoRig rig_;
  const DriveId drive_id_;
  const LocalMapperOptions options_;
  Map map_;
  uint32_t next_landmark_index_ = 0;
  /// Landmarks on trial and the keyframe that created them, oldest first.
  std::vector<std::pair<KeyframeId, std::vector<LandmarkId>>> on_trial_;
  std::map<std::string, double> step_ms_;
};

}  // namespace carmap
