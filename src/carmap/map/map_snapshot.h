// An immutable map, or part of one, as matching and localization read it.
//
// The tracker's local window, a whole working map, and a lean map after reconstruction (§3.5) all
// take this one form. Freely shared between threads once built. Links are dense indices into the
// two vectors.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/map.h"

namespace carmap {

struct SnapshotKeyframe {
  KeyframeId id;
  Timestamp timestamp;
  Rigid3 map_from_camera;
  std::optional<GpsFix> gps;
  std::vector<uint32_t> landmark_idxs;  ///< landmarks seen here, ascending
};

struct SnapshotLandmark {
  LandmarkId id;
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  Descriptor descriptor;
  /// Mean direction, unit length, from the landmark to the keyframes that saw it.
  Eigen::Vector3f direction_to_viewers = Eigen::Vector3f::Zero();
  /// Nearest and farthest distance, metres, from which a keyframe saw it.
  float min_distance_m = 0, max_distance_m = 0;
  /// Pyramid level at which it would be seen from one metre away (not rounded, mostly far above
  /// kLevelCount): what PredictLevel derives the level at any distance from.
  float level_at_1m = 0;
  uint8_t drive_count = 1;  ///< drives that saw it, as far as the map tells
};

struct MapSnapshot {
  uint64_t version = 0;
  std::vector<SnapshotKeyframe> keyframes;  ///< ascending by id
  std::vector<SnapshotLandmark> landmarks;  ///< ascending by id
};

/// Indices of all landmarks.
std::vector<uint32_t> AllLandmarks(const MapSnapshot& map);

/// Of the landmarks of `map`, those whose id passes.
template <typename Predicate>
std::vector<uint32_t> SelectLandmarks(const MapSnapshot& map, Predicate&& passes) {
  std::vector<uint32_t> idxs;
  for (uint32_t i = 0; i < map.landmarks.size(); ++i) {
    if (passes(map.landmarks[i].id)) idxs.push_back(i);
  }
  return idxs;
}

/// Pyramid level, not rounded and possibly out of range, at which a camera of the same focal length
/// sees the landmark from this distance. It falls as the distance grows: a corner of a given size
/// is small from far away.
float PredictLevel(const SnapshotLandmark& landmark, double distance_m);

/// Fills the fields of `landmark` that follow from where it was seen: `viewers_in_map` are the
/// centres of the keyframes (at least one), `level` the pyramid level of its feature in the
/// keyframe whose centre is `anchor_in_map`.
void DeriveVisibility(const std::vector<Eigen::Vector3d>& viewers_in_map,
                      const Eigen::Vector3d& anchor_in_map, int level, SnapshotLandmark& landmark);

/// The part of a working map around some of its keyframes: these, and the landmarks that they see
/// but for those voted non-static (§3.3). `keyframe_ids` ascending, each in the map.
MapSnapshot SnapshotOf(const Map& map, const std::vector<KeyframeId>& keyframe_ids);

}  // namespace carmap
