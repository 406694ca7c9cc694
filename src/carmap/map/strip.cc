#include "carmap/map/strip.h"

#include <algorithm>
#include <cstdint>
#include <set>
#include <tuple>
#include <utility>

namespace carmap {
namespace {

struct Kept {
  LandmarkId source;
  LeanLandmark lean;
};

/// The landmark without what can be derived. `keyframes` ascending by id, one of which sees it;
/// others do not count.
Kept StripLandmark(const Map& map, const Landmark& landmark,
                   const std::vector<LeanKeyframe>& keyframes) {
  Kept kept{landmark.id, {}};
  kept.lean.position_in_map = landmark.position_in_map;
  kept.lean.descriptor = landmark.descriptor;
  auto keyframe = keyframes.begin();
  for (const Observation& observation : landmark.observations) {
    keyframe = std::lower_bound(keyframe, keyframes.end(), observation.keyframe_id,
                                [](const LeanKeyframe& a, KeyframeId b) { return a.id < b; });
    if (keyframe == keyframes.end()) break;
    if (keyframe->id != observation.keyframe_id) continue;
    kept.lean.keyframe_idxs.push_back(static_cast<uint32_t>(keyframe - keyframes.begin()));
    // The last to see it, which under forward motion is the nearest.
    const auto& features = *map.Find(observation.keyframe_id)->features;
    kept.lean.anchor_level = features[observation.feature_idx].level;
  }
  kept.lean.anchor_idx = kept.lean.keyframe_idxs.back();
  return kept;
}

bool Stays(const Landmark& landmark, const StripOptions& options) {
  return landmark.observations.size() >= options.min_observations && !landmark.is_non_static();
}

/// With their final ids, in the order in which these and lists cost least.
void AddLandmarks(std::vector<Kept> kept, DriveId drive, StrippedMap& stripped) {
  std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) {
    return std::tie(a.lean.keyframe_idxs, a.lean.anchor_level, a.source) <
           std::tie(b.lean.keyframe_idxs, b.lean.anchor_level, b.source);
  });
  for (Kept& landmark : kept) {
    landmark.lean.id = {drive, static_cast<uint32_t>(stripped.lean.landmarks.size())};
    stripped.sources.push_back(landmark.source);
    stripped.lean.landmarks.push_back(std::move(landmark.lean));
  }
}

LeanKeyframe StripKeyframe(const Keyframe& keyframe) {
  return {keyframe.id, keyframe.timestamp, keyframe.map_from_camera, keyframe.gps};
}

}  // namespace

StrippedMap Strip(const Map& map, const LeanDrive& drive, const StripOptions& options) {
  StrippedMap stripped;
  LeanMap& lean = stripped.lean;
  lean.drives = {drive};
  for (const auto& [id, keyframe] : map.keyframes()) {
    lean.keyframes.push_back(StripKeyframe(keyframe));
  }
  std::vector<Kept> kept;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (Stays(landmark, options)) kept.push_back(StripLandmark(map, landmark, lean.keyframes));
  }
  AddLandmarks(std::move(kept), drive.id, stripped);
  return stripped;
}

StrippedMap StripStretch(const Map& map, const LeanDrive& drive, KeyframeId first, KeyframeId last,
                         const StripOptions& options) {
  StrippedMap stripped;
  LeanMap& lean = stripped.lean;
  lean.drives = {drive};
  std::set<LandmarkId> seen;
  const auto end = map.keyframes().upper_bound(last);
  for (auto keyframe = map.keyframes().lower_bound(first); keyframe != end; ++keyframe) {
    lean.keyframes.push_back(StripKeyframe(keyframe->second));
    for (const auto& landmark : map.LandmarksOf(keyframe->first)) {
      if (landmark) seen.insert(*landmark);
    }
  }
  std::vector<Kept> kept;
  for (const LandmarkId& id : seen) {
    const Landmark& landmark = *map.Find(id);
    if (Stays(landmark, options)) kept.push_back(StripLandmark(map, landmark, lean.keyframes));
  }
  AddLandmarks(std::move(kept), drive.id, stripped);
  return stripped;
}

}  // namespace carmap
