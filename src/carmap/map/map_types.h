// The records of a map: keyframes, landmarks, and who saw what.
//
// Plain values linked by ids; frozen bulk data (a keyframe's features) is shared.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/semantics/mobility.h"

namespace carmap {

/// A frame kept for mapping, with all its features (paper §2).
struct Keyframe {
  KeyframeId id;
  Timestamp timestamp;
  Rigid3 map_from_camera;
  std::optional<GpsFix> gps;
  std::shared_ptr<const std::vector<Feature>> features;  ///< never null in a Map
  /// Of each feature (paper §3.3); null until the keyframe is labelled.
  std::shared_ptr<const std::vector<Mobility>> mobility;
  uint64_t placed_in = 0;  ///< version of the Map that first had it at this pose
};

/// A landmark was seen as feature `feature_idx` of a keyframe.
struct Observation {
  KeyframeId keyframe_id;
  int32_t feature_idx = 0;
  bool operator==(const Observation&) const = default;
};

/// A map-feature of the paper (§2): signature, position, and the keyframes that see it.
struct Landmark {
  LandmarkId id;
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  Descriptor descriptor;
  std::vector<Observation> observations;  ///< ascending by keyframe, one a keyframe
  MobilityVotes votes;                    ///< also of keyframes that were removed since
  uint64_t placed_in = 0;                 ///< version of the Map that first had it at this position

  /// Of traffic, or parked (paper §3.3). It holds no pose and enters no lean map.
  bool is_non_static() const { return votes.Elected() == Mobility::kNonStatic; }
};

}  // namespace carmap
