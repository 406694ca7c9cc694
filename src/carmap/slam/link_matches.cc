#include "carmap/slam/link_matches.h"

#include <algorithm>

namespace carmap {

void LinkMatches(const Map& map, const MapSnapshot& snapshot, KeyframeId keyframe_id,
                 const std::vector<LandmarkMatch>& matches, MapEdit& edit) {
  const auto& links = map.LandmarksOf(keyframe_id);
  for (const auto& [landmark_idx, feature_idx] : matches) {
    const LandmarkId landmark_id = snapshot.landmarks[landmark_idx].id;
    const auto& taken_by = links[feature_idx];
    if (!taken_by) {
      edit.added_observations.push_back(
          {landmark_id, {keyframe_id, static_cast<int32_t>(feature_idx)}});
    } else if (*taken_by != landmark_id) {
      // The older landmark, seen more often, stays.
      edit.merges.push_back({std::max(*taken_by, landmark_id), std::min(*taken_by, landmark_id)});
    }
  }
}

}  // namespace carmap
