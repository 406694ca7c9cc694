// A drive's full map: all keyframes with all their features, nothing filtered. The map that the
// paper's peers, ORB-SLAM2 and QuickSketch, localize in (§5), kept for comparison only.
//
// Plain values. The file is a container (format/container.h) with one section of fixed-size
// records; its indexes are rebuilt, like those of a lean map. Bytes from outside are trusted in
// nothing. Thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {

struct FullFeature {
  static constexpr uint32_t kNoLandmark = ~uint32_t{0};

  Feature feature;
  uint32_t landmark_idx = kNoLandmark;  ///< into FullMap::landmarks_in_map
};

struct FullKeyframe {
  uint32_t index = 0;  ///< frame number in the drive
  Timestamp timestamp;
  Rigid3 map_from_camera;
  std::vector<FullFeature> features;
};

struct FullMap {
  LeanDrive drive;
  std::vector<FullKeyframe> keyframes;  ///< ascending by index
  std::vector<Eigen::Vector3d> landmarks_in_map;
};

/// Largest file that is read.
inline constexpr uint64_t kMaxFullMapBytes = uint64_t{1} << 34;

/// All keyframes of the map must be of `drive`.
FullMap FullMapOf(const Map& map, const LeanDrive& drive);

std::string EncodeFullMap(const FullMap& map);

/// Errors, one line each with `name`, cause and remedy: as ReadContainer; DataLoss for a section
/// that is cut or damaged, InvalidArgument for another file of carmap's.
absl::StatusOr<FullMap> DecodeFullMap(std::string_view bytes, const std::string& name);

/// For matching by appearance: each keyframe sees its own features, with their own descriptors,
/// where their landmarks are or, without one, where their disparity puts them; those with neither
/// are left out. Levels hold for the drive's own focal length.
MapSnapshot SnapshotOf(const FullMap& map);

/// Drive and keyframes without features, as AlignMapToTruth and MapTruth take them.
LeanMap KeyframesOf(const FullMap& map);

}  // namespace carmap
