#include "carmap/localize/keyframe_view.h"

#include "carmap/localize/landmark_matcher.h"
#include "carmap/localize/map_neighbourhood.h"

namespace carmap {

KeyframeView ViewFrom(const ReconstructedMap& map, uint32_t keyframe_idx, size_t neighbours) {
  const StereoRig& rig = RigOf(map, keyframe_idx);
  const Rigid3 camera_from_map = map.snapshot.keyframes[keyframe_idx].map_from_camera.Inverse();
  KeyframeView view;
  for (const uint32_t landmark_idx :
       LandmarksSeenBy(map, WithCovisible(map, keyframe_idx, neighbours))) {
    if (view.features.size() == kMaxLandmarksOfKeyframe) break;
    const SnapshotLandmark& landmark = map.snapshot.landmarks[landmark_idx];
    if (!IsInSight(landmark, rig, camera_from_map)) continue;
    const Eigen::Vector3d p_in_camera = camera_from_map * landmark.position_in_map;
    view.features.push_back(FeatureOf(map, landmark, rig, p_in_camera));
    view.landmark_idxs.push_back(landmark_idx);
  }
  return view;
}

}  // namespace carmap
