// The one currency of change: what every algorithm returns and Apply carries out.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/map/map.h"
#include "carmap/map/map_types.h"

namespace carmap {

/// A change made against version `base_version` of a map. Carried out in the order of the fields.
struct MapEdit {
  struct LandmarkObservation {
    LandmarkId landmark_id;
    Observation observation;
  };
  struct KeyframeLabels {
    KeyframeId id;
    std::shared_ptr<const std::vector<Mobility>> mobility;  ///< of each feature
  };
  struct Merge {
    LandmarkId from, into;
  };
  struct KeyframePose {
    KeyframeId id;
    Rigid3 map_from_camera;
  };
  struct LandmarkPosition {
    LandmarkId id;
    Eigen::Vector3d position_in_map;
  };
  struct LandmarkDescriptor {
    LandmarkId id;
    Descriptor descriptor;
  };

  uint64_t base_version = 0;
  std::vector<Keyframe> added_keyframes;
  std::vector<Landmark> added_landmarks;
  std::vector<LandmarkObservation> added_observations;
  std::vector<LandmarkObservation> removed_observations;
  std::vector<KeyframeLabels> labelled_keyframes;  ///< which vote on the landmarks that they see
  std::vector<Merge> merges;  ///< `into` takes over the observations of `from` where it has none
  std::vector<KeyframePose> moved_keyframes;
  std::vector<LandmarkPosition> moved_landmarks;
  std::vector<LandmarkDescriptor> changed_descriptors;
  std::vector<LandmarkId> removed_landmarks;
  std::vector<KeyframeId> removed_keyframes;  ///< with their observations
};

/// Applies the edit and returns how many of its records were left out. A landmark that loses its
/// last observation goes too.
///
/// An edit made against the present version leaves nothing out unless it contradicts itself or has
/// poses or positions that are not finite. One made against an older version is rebased: what
/// concerns a landmark that was merged since goes to the one that it was merged into; what concerns
/// records gone, links taken or places changed since is left out (PropagateEdit takes such moves
/// along). Errors: InvalidArgument, and an unchanged map, for an edit of a version yet to
/// come.
absl::StatusOr<size_t> Apply(const MapEdit& edit, Map& map);

}  // namespace carmap
