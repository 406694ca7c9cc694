// The lean map (paper §3.1): landmarks alone, and of each keyframe what cannot be derived.
//
// This is what a vehicle sends, the service keeps and a file holds. It has no keyframe features and
// no index; carmap/index rebuilds both (§3.5). A plain value.
#pragma once

#include <absl/status/status.h>

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/drive_fault.h"

namespace carmap {

/// What no camera exceeds, so that no map costs more than its size to rebuild and to match.
inline constexpr int kMaxImageSidePx = 1 << 14;
/// Of focal lengths, which are at least a pixel, and principal points; of baselines, which are at
/// least a micrometre. What is computed of a rig stays finite.
inline constexpr double kMaxRigPx = 1 << 20, kMaxBaselineM = 100;
inline constexpr size_t kMaxLandmarksOfKeyframe = 1 << 12;

/// A drive that contributed, and the rig that it saw with.
struct LeanDrive {
  DriveId id;
  StereoRig rig;
  DriveFaults faults = {};
  /// Unix time at the drive's time 0, where it is known.
  std::optional<Timestamp> unix_start = std::nullopt;
};

struct LeanKeyframe {
  KeyframeId id;
  Timestamp timestamp;
  Rigid3 map_from_camera;
  std::optional<GpsFix> gps;
  bool is_stub = false;  ///< in a tile: belongs to another one, and sees landmarks of this
};

struct LeanLandmark {
  LandmarkId id;
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  Descriptor descriptor;
  /// Ascending indices into LeanMap::keyframes; at least one.
  std::vector<uint32_t> keyframe_idxs;
  /// The one of them that the landmark rides on: its position is stored in that camera's frame. It
  /// stays the same whoever sees the landmark later.
  uint32_t anchor_idx = 0;
  /// Pyramid level of the landmark's feature there. With the distance it gives the scale at which
  /// any other camera will see it.
  uint8_t anchor_level = 0;
  /// Drives that saw it, up to 255; also those whose keyframes the map does not keep.
  uint8_t drive_count = 1;
};

struct LeanMap {
  std::vector<LeanDrive> drives;        ///< ascending by id
  std::vector<LeanKeyframe> keyframes;  ///< ascending by id
  std::vector<LeanLandmark> landmarks;  ///< ascending by id
};

/// The drive with this id, of drives ascending by id; null if there is none.
const LeanDrive* FindDrive(const std::vector<LeanDrive>& drives, DriveId id);

/// Checks every invariant and limit written above, that numbers are finite and that ids refer to
/// drives that are there. Errors: InvalidArgument, naming the first record that breaks one.
absl::Status CheckConsistency(const LeanMap& map);

/// The landmark's position in the frame of its anchor's camera.
Eigen::Vector3d PositionInAnchor(const LeanMap& map, const LeanLandmark& landmark);

/// The map in another frame.
LeanMap Moved(LeanMap map, const Rigid3& new_from_map);

/// Distance driven along the keyframes, metres, summed over drives.
double PathLengthM(const LeanMap& map);

}  // namespace carmap
