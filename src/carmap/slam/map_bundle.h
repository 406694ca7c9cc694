// The part of a map around some keyframes as a bundle adjustment, and its result as an edit.
//
// A MapBundle is a copy: it is solved on any thread while the map goes on changing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/map.h"
#include "carmap/map/map_edit.h"
#include "carmap/solve/bundle_adjustment.h"

namespace carmap {

struct MapBundle {
  uint64_t map_version = 0;
  Bundle bundle;
  std::vector<KeyframeId> keyframe_ids;             ///< of the poses
  std::vector<LandmarkId> landmark_ids;             ///< of the points
  std::vector<MapEdit::LandmarkObservation> links;  ///< of the observations
};

/// The keyframes `free_ids` are to be adjusted, together with `landmark_ids` (both ascending and in
/// the map); other keyframes that see these landmarks hold still. So does the first keyframe of the
/// drive, where the map begins, or else the first of `free_ids`.
MapBundle MakeMapBundle(const Map& map, const StereoRig& rig, const MeasurementNoise& noise,
                        const std::vector<KeyframeId>& free_ids,
                        const std::vector<LandmarkId>& landmark_ids);

/// Landmarks that these keyframes see and that constrain poses: those seen more than once and not
/// voted non-static. Ascending.
std::vector<LandmarkId> SharedLandmarks(const Map& map, const std::vector<KeyframeId>& ids);

/// Moves poses and points to where they are in `adjusted`, takes observations away that do not
/// agree, and landmarks that went to where no disparity tells a distance.
MapEdit EditOf(const MapBundle& adjusted, const BundleSummary& summary);

}  // namespace carmap
