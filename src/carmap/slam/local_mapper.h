// Builds the map around the vehicle as keyframes come in (paper §2, map augmentation and error
// minimization): landmark creation, fusing, culling, local bundle adjustment.
//
// The one writer of its Map: owned by one thread. Each step reads the map and returns a MapEdit.
#pragma once

#include <absl/container/btree_map.h>

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/semantics/keyframe_labeller.h"
#include "carmap/slam/keyframe_culling.h"
#include "carmap/slam/map_parts.h"
#include "carmap/slam/map_window.h"
#include "carmap/slam/recovery.h"
#include "carmap/solve/bundle_adjustment.h"

namespace carmap {

/// How the rig's disparity bias is looked for. Angles, to suit any image size.
struct BiasOptions {
  size_t min_keyframes = 5;        ///< in the window
  double step_sigma_rad = 1.5e-4;  ///< how far an adjustment may move its coefficients at first
  /// A rig stays as it is: after so many adjustments steps are half as large, after nine times as
  /// many a tenth, and so on, so that the last of a drive say no more than those before.
  double settling_adjustments = 8;
  double max_rad = 0.7e-3;  ///< bound on each; half a pixel at a focal length of 700
};

struct LocalMapperOptions {
  MeasurementNoise noise;
  WindowOptions window;               ///< adjusted together, and offered to the tracker
  double min_new_disparity_px = 1.5;  ///< of a feature that becomes a landmark
  size_t trial_keyframes = 3;         ///< a landmark this many keyframes old ...
  size_t min_trial_observations = 3;  ///< ... is culled unless this many saw it
  BiasOptions bias;
  BundleOptions bundle;
  KeyframeCullingOptions culling;
  RecoveryOptions recovery;
  size_t join_attempts = 10;      ///< keyframes of a new part that are looked for in the older map
  size_t min_part_keyframes = 3;  ///< a part that ends with fewer is erased
};

/// A frame chosen as keyframe, with the landmarks that tracking found in it.
struct NewKeyframe {
  Keyframe keyframe;
  std::vector<std::pair<LandmarkId, uint32_t>> landmark_of_feature;
  bool begins_part = false;                ///< of the map, since the vehicle was lost before
  Gap gap;                                 ///< if so, what is known from before
  std::vector<LabelledKeyframe> labelled;  ///< keyframes before whose labels came meanwhile
};

/// What the mapper offers the tracker: the map around a keyframe, and the rig as calibrated so far.
struct LocalMap {
  MapSnapshot snapshot;
  KeyframeId reference;  ///< the keyframe around which it lies
  StereoRig rig;
};

/// A frame found again, and the map around it.
struct LocatedFrame {
  std::shared_ptr<const LocalMap> local;
  TrackedPose pose;  ///< in local->snapshot
};

class LocalMapper {
 public:
  LocalMapper(const StereoRig& rig, DriveId drive_id, const LocalMapperOptions& options)
      : rig_(rig), drive_id_(drive_id), options_(options) {}

  /// Inserts the keyframe into the map, improves the map around it, and returns that part.
  std::shared_ptr<const LocalMap> Insert(const NewKeyframe& keyframe);

  /// The map around a keyframe that is in it.
  std::shared_ptr<const LocalMap> MapAround(KeyframeId id) const;

  /// Finds a frame anywhere in the map, first near to where it should be. Leaves the newest part of
  /// the map when it is found in an older one.
  std::optional<LocatedFrame> Locate(const std::vector<Feature>& features,
                                     const Rigid3& predicted_map_from_camera);

  /// At the end of the drive: erases parts that are too short to hold a landmark that can be
  /// trusted.
  void EraseShortParts();

  /// Pose of a keyframe that was inserted, also of one that was culled as redundant since; nothing
  /// if it was erased with its part.
  std::optional<Rigid3> PoseOf(KeyframeId id) const;

  /// Labels of keyframes, which vote on the landmarks that they see (§3.3).
  void TakeLabels(const std::vector<LabelledKeyframe>& labelled);

  /// Applies an edit that was worked out elsewhere, as part of a step.
  void Apply(const char* step, const MapEdit& edit);

  const Map& map() const { return map_; }
  /// Hands the map over. To be called last, once.
  Map ReleaseMap() { return std::move(map_); }
  /// The rig with the disparity bias that the adjustments found.
  const StereoRig& rig() const { return rig_; }
  /// Time that was spent on the map by others.
  void CountTime(const char* step, double elapsed_ms) { step_ms_[step] += elapsed_ms; }
  /// Milliseconds spent in each step so far.
  const std::map<std::string, double>& step_ms() const { return step_ms_; }
  /// Records of edits that no longer fitted the map, in each step that had any.
  const std::map<std::string, size_t>& left_out() const { return left_out_; }

 private:
  MapEdit InsertKeyframe(const NewKeyframe& keyframe) const;
  MapEdit FindKnownLandmarks(KeyframeId newest, const std::vector<KeyframeId>& window) const;
  MapEdit CreateLandmarks(KeyframeId newest);
  MapEdit FindInNeighbours(KeyframeId newest, const std::vector<KeyframeId>& window) const;
  MapEdit RefreshDescriptors(KeyframeId newest) const;
  MapEdit CullLandmarks();
  MapEdit CullKeyframes(KeyframeId newest, const std::vector<KeyframeId>& window);
  MapEdit JoinPart(KeyframeId newest, std::optional<KeyframeId>& joined_at);
  MapEdit LeavePart();
  std::vector<KeyframeId> KeyframesBefore(std::optional<KeyframeId> end) const;
  MapEdit AdjustWindow(const std::vector<KeyframeId>& window);
  BundleOptions OptionsFor(size_t window_keyframes) const;
  void MoveLoneLandmarks(MapEdit& edit) const;
  Eigen::Vector3d Triangulate(const Keyframe& keyframe, const Feature& feature) const;
  void ApplyStep(const char* step, const MapEdit& edit, double elapsed_ms);

  StereoRig rig_;
  size_t bias_adjustments_ = 0;  ///< that estimated its disparity bias
  const DriveId drive_id_;
  const LocalMapperOptions options_;
  Map map_;
  uint32_t next_landmark_index_ = 0;
  std::deque<std::vector<LandmarkId>> on_trial_;  ///< by keyframe that created them, oldest first

  /// The newest part of the map while nothing joins it to the rest.
  struct OpenPart {
    KeyframeId first;
    Gap gap;
    size_t keyframes = 1;
  };
  std::optional<OpenPart> open_part_;

  /// Where a culled keyframe was, relative to one that stayed at the time.
  struct Anchor {
    KeyframeId keyframe_id;
    Rigid3 anchor_from_camera;
  };
  absl::btree_map<KeyframeId, Anchor> anchors_;
  std::map<std::string, double> step_ms_;
  std::map<std::string, size_t> left_out_;
};

}  // namespace carmap
