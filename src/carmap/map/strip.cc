#include "carmap/map/strip.h"

#include <algorithm>
#include <cstdint>
#include <tuple>
#include <utility>

namespace carmap {
namespace {

struct Kept {
  LandmarkId source;
  LeanLandmark lean;
};

/// The landmark without what can be derived. `keyframes` ascending by id.
Kept StripLandmark(const Map& map, const Landmark& landmark,
                   const std::vector<LeanKeyframe>& keyframes) {
  Kept kept{landmark.id, {}};
  kept.lean.position_in_map = landmark.position_in_map;
  kept.lean.descriptor = landmark.descriptor;
  // The last to see it, which under forward motion is the nearest.
  const Observation& last = landmark.observations.back();
  kept.lean.anchor_level = (*map.Find(last.keyframe_id)->features)[last.feature_idx].level;
  auto keyframe = keyframes.begin();
  for (const Observation& observation : landmark.observations) {
    keyframe = std::lower_bound(keyframe, keyframes.end(), observation.keyframe_id,
                                [](const LeanKeyframe& a, KeyframeId b) { return a.id < b; });
    kept.lean.keyframe_idxs.push_back(static_cast<uint32_t>(keyframe - keyframes.begin()));
  }
  kept.lean.anchor_idx = kept.lean.keyframe_idxs.back();
  return kept;
}

}  // namespace

StrippedMap Strip(const Map& map, const LeanDrive& drive, const StripOptions& options) {
  StrippedMap stripped;
  LeanMap& lean = stripped.lean;
  lean.drives = {drive};
  for (const auto& [id, keyframe] : map.keyframes()) {
    lean.keyframes.push_back({id, keyframe.timestamp, keyframe.map_from_camera, keyframe.gps});
  }

  std::vector<Kept> kept;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (landmark.observations.size() < options.min_observations) continue;
    if (landmark.is_non_static()) continue;
    kept.push_back(StripLandmark(map, landmark, lean.keyframes));
  }
  std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) {
    return std::tie(a.lean.keyframe_idxs, a.lean.anchor_level, a.source) <
           std::tie(b.lean.keyframe_idxs, b.lean.anchor_level, b.source);
  });
  for (Kept& landmark : kept) {
    landmark.lean.id = {drive.id, static_cast<uint32_t>(lean.landmarks.size())};
    stripped.sources.push_back(landmark.source);
    lean.landmarks.push_back(std::move(landmark.lean));
  }
  return stripped;
}

}  // namespace carmap
