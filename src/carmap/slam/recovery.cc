#include "carmap/slam/recovery.h"

#include <memory>
#include <utility>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/index/reconstruct.h"

namespace carmap {
namespace {

/// The pose in the map around the place.
std::optional<FoundPlace> TrackInWindow(const Map& map, KeyframeId id, const FeatureGrid& grid,
                                        const StereoRig& rig, const Rigid3& camera_from_map,
                                        const RecoveryOptions& options) {
  MapSnapshot snapshot = SnapshotOf(map, WindowAround(map, id, options.window));
  auto pose = TrackByProjection(snapshot, AllLandmarks(snapshot), grid, rig, camera_from_map,
                                options.tracking);
  if (!pose) return std::nullopt;
  return FoundPlace{id, std::move(snapshot), *std::move(pose)};
}

std::optional<FoundPlace> FindAmong(const Map& map, const std::vector<KeyframeId>& keyframe_ids,
                                    size_t min_inliers, const FeatureGrid& grid,
                                    const StereoRig& rig, const RecoveryOptions& options) {
  const ReconstructedMap view = IndexSnapshot(SnapshotOf(map, keyframe_ids), rig.camera.fx);
  PlaceSearch search(view, {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()},
                     options.search);
  for (const PlaceHypothesis& place : search.Search(grid, rig, std::nullopt)) {
    if (place.inliers.size() < min_inliers) break;
    auto found = TrackInWindow(map, view.snapshot.keyframes[place.keyframe_idx].id, grid, rig,
                               place.camera_from_map, options);
    if (found) return found;
  }
  return std::nullopt;
}

}  // namespace

std::optional<FoundPlace> FindNear(const Map& map, const std::vector<KeyframeId>& candidates,
                                   const FeatureGrid& grid, const StereoRig& rig,
                                   const Rigid3& predicted_map_from_camera,
                                   const RecoveryOptions& options) {
  std::vector<KeyframeId> near;
  for (const KeyframeId& id : candidates) {
    const double distance_m =
        (map.Find(id)->map_from_camera.translation - predicted_map_from_camera.translation).norm();
    if (distance_m <= options.near_m) near.push_back(id);
  }
  return FindAmong(map, near, options.near_inliers, grid, rig, options);
}

std::optional<FoundPlace> FindAnywhere(const Map& map, const std::vector<KeyframeId>& candidates,
                                       const FeatureGrid& grid, const StereoRig& rig,
                                       const RecoveryOptions& options) {
  return FindAmong(map, candidates, options.far_inliers, grid, rig, options);
}

}  // namespace carmap
