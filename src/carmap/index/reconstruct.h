// Reconstruction (paper §3.5): from a lean map what it left out, as localization and stitching need
// it.
//
// Stored in a lean map are positions, signatures, one pyramid level and the keyframe list of each
// landmark, and each keyframe's pose. Derived here are: each landmark's viewing direction, range of
// distances and the scale at which a camera sees it; the covisibility graph; and the k-d trees of
// keyframes and landmarks. Features of keyframes are derived when they are asked for (FeatureOf,
// localize/keyframe_view.h).
//
// A ReconstructedMap is immutable and freely shared between threads.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/base/lazy.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/index/grouped.h"
#include "carmap/index/kd_tree.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

/// What bounds the covisibility graph by a multiple of the observations, whatever the lists of
/// keyframes: both are more than the lists of a drive reach.
inline constexpr size_t kMaxCovisible = 128, kMaxListNeighbours = 32;

struct CovisibleKeyframe {
  uint32_t keyframe_idx = 0;
  uint32_t shared_landmarks = 0;  ///< at least one
};

/// Keyframes by their place on the Earth, whatever the map's own frame is.
class GpsIndex {
 public:
  /// A keyframe without a fix takes its place from the fixes before and after it in its drive, by
  /// the distance driven. Nothing if no keyframe has a fix. Keyframes ascending by id.
  static std::optional<GpsIndex> Build(const std::vector<LeanKeyframe>& keyframes);

  /// The `max_count` nearest keyframes within this horizontal distance (altitudes of GPS are poor),
  /// nearest first.
  std::vector<uint32_t> KeyframesNear(const GpsFix& fix, double radius_m, size_t max_count) const;
  /// Keyframes that could not be placed: they have only fixes before or only fixes after them, or
  /// their drive has none. Ascending.
  const std::vector<uint32_t>& unplaced() const { return unplaced_; }

 private:
  explicit GpsIndex(const GpsFix& origin) : enu_(origin) {}
  Eigen::Vector3d OnPlane(const GpsFix& fix) const;
  void PlaceDrive(const std::vector<LeanKeyframe>& keyframes, size_t begin, size_t end,
                  std::vector<Eigen::Vector3d>& places);

  LocalEnu enu_;
  KdTree tree_;
  std::vector<uint32_t> placed_;  ///< keyframe of each point of the tree
  std::vector<uint32_t> unplaced_;
};

struct ReconstructedMap {
  std::vector<LeanDrive> drives;
  /// Keyframes and landmarks in the order of the lean map. Levels hold for a camera of
  /// `focal_length_px`, whichever drive mapped the landmark.
  MapSnapshot snapshot;
  double focal_length_px = 0;
  /// The map-feature index (§2): of each landmark the keyframes that see it, ascending.
  Grouped<uint32_t> keyframes_of_landmark;
  KdTree keyframe_centers;
  std::optional<GpsIndex> gps;

  /// Of each keyframe those that share most landmarks with it, most shared first, at most
  /// kMaxCovisible. Of a landmark's list the kMaxListNeighbours before and after the keyframe
  /// count. Built by the first call.
  const Grouped<CovisibleKeyframe>& covisible() const;
  /// Built by the first call.
  const KdTree& landmark_positions() const;

 private:
  Lazy<Grouped<CovisibleKeyframe>> covisible_;
  Lazy<KdTree> landmark_positions_;
};

/// The map must be consistent (CheckConsistency). `focal_length_px` is fx of the camera that the
/// map is rebuilt for; absent, that of the map's first drive.
ReconstructedMap Reconstruct(const LeanMap& map,
                             std::optional<double> focal_length_px = std::nullopt);

/// The same of a snapshot of a working map, to be searched like a given one. It has no drives,
/// features of keyframes or places on the Earth. `focal_length_px` is that of the camera whose
/// levels the snapshot has.
ReconstructedMap IndexSnapshot(MapSnapshot snapshot, double focal_length_px);

/// The rig that the keyframe's drive saw with.
const StereoRig& RigOf(const ReconstructedMap& map, uint32_t keyframe_idx);

/// The landmark as the rig measures it at this place in its camera's frame (equation 1): signature,
/// level and disparity, bias included.
Feature FeatureOf(const ReconstructedMap& map, const SnapshotLandmark& landmark,
                  const StereoRig& rig, const Eigen::Vector3d& p_in_camera);

}  // namespace carmap
