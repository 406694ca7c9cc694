#include "carmap/slam/link_matches.h"

#include <algorithm>
#include <cmath>

#include "carmap/feature/twins.h"

namespace carmap {

namespace {

/// Whether a frame shows something else in each of the two places.
bool AreApart(const Feature& a, const Feature& b) {
  const double radius_px = TwinRadiusPx(std::max(a.level, b.level));
  return std::abs(a.x_px - b.x_px) > radius_px || std::abs(a.y_px - b.y_px) > radius_px;
}

/// Whether a keyframe sees the two in different places.
bool AreSideBySide(const Map& map, const Landmark& a, const Landmark& b) {
  auto of_b = b.observations.begin();
  for (const auto& [keyframe_id, feature_idx] : a.observations) {
    while (of_b != b.observations.end() && of_b->keyframe_id < keyframe_id) ++of_b;
    if (of_b == b.observations.end()) return false;
    if (keyframe_id < of_b->keyframe_id) continue;
    const std::vector<Feature>& features = *map.Find(keyframe_id)->features;
    if (AreApart(features[feature_idx], features[of_b->feature_idx])) return true;
  }
  return false;
}

}  // namespace

std::vector<std::optional<LandmarkId>> LandmarksOfCorners(const Map& map, KeyframeId keyframe_id) {
  const auto& links = map.LandmarksOf(keyframe_id);
  const std::vector<Feature>& features = *map.Find(keyframe_id)->features;
  std::vector<std::optional<LandmarkId>> of_corner(links.size());
  for (uint32_t i = 0; i < links.size(); ++i) {
    auto& landmark = of_corner[CornerOf(features, i)];
    if (links[i] && (!landmark || *links[i] < *landmark)) landmark = links[i];
  }
  return of_corner;
}

void LinkMatches(const Map& map, const MapSnapshot& snapshot, KeyframeId keyframe_id,
                 const std::vector<LandmarkMatch>& matches, MapEdit& edit) {
  const std::vector<Feature>& features = *map.Find(keyframe_id)->features;
  const auto of_corner = LandmarksOfCorners(map, keyframe_id);
  for (const auto& [landmark_idx, feature_idx] : matches) {
    const LandmarkId landmark_id = snapshot.landmarks[landmark_idx].id;
    const auto& taken_by = of_corner[CornerOf(features, feature_idx)];
    if (!taken_by) {
      edit.added_observations.push_back(
          {landmark_id, {keyframe_id, static_cast<int32_t>(feature_idx)}});
    } else if (*taken_by != landmark_id &&
               !AreSideBySide(map, *map.Find(*taken_by), *map.Find(landmark_id))) {
      // The older landmark, seen more often, stays.
      edit.merges.push_back({std::max(*taken_by, landmark_id), std::min(*taken_by, landmark_id)});
    }
  }
}

}  // namespace carmap
