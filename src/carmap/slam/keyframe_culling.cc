#include "carmap/slam/keyframe_culling.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "carmap/slam/map_window.h"

namespace carmap {
namespace {

class Culler {
 public:
  Culler(const Map& map, const KeyframeCullingOptions& options) : map_(map), options_(options) {}

  bool IsCulled(KeyframeId id) const {
    return std::find(culled_.begin(), culled_.end(), id) != culled_.end();
  }

  /// Whether enough others see what the keyframe sees, as large as it does.
  bool IsRedundant(KeyframeId id) const {
    const std::vector<Feature>& features = *map_.Find(id)->features;
    const auto& links = map_.LandmarksOf(id);
    int landmarks = 0, seen_by_others = 0;
    for (size_t i = 0; i < links.size(); ++i) {
      if (!links[i]) continue;
      ++landmarks;
      const auto& observations = map_.Find(*links[i])->observations;
      const auto others =
          std::count_if(observations.begin(), observations.end(), [&](const Observation& o) {
            return o.keyframe_id != id && LevelOf(o) <= features[i].level &&
                   !IsCulled(o.keyframe_id);
          });
      seen_by_others += others >= options_.min_other_viewers;
    }
    return seen_by_others >= options_.min_redundant_ratio * landmarks;
  }

  /// Whether the keyframes around leave no gap without this one.
  bool IsCovered(KeyframeId id) const {
    const Rigid3 camera_from_map = map_.Find(id)->map_from_camera.Inverse();
    double ahead_m = std::numeric_limits<double>::infinity(), behind_m = ahead_m;
    for (const Covisibility& other : CovisibleKeyframes(map_, id, 1)) {
      if (IsCulled(other.id)) continue;
      const Rigid3 step = camera_from_map * map_.Find(other.id)->map_from_camera;
      if (RotationAngle(step.rotation) > options_.max_turn_rad ||
          step.translation.head<2>().norm() > options_.max_lateral_m) {
        continue;
      }
      double& nearest_m = step.translation.z() > 0 ? ahead_m : behind_m;
      nearest_m = std::min(nearest_m, std::abs(step.translation.z()));
    }
    return ahead_m + behind_m <= options_.max_gap_m;
  }

  void Remove(KeyframeId id) { culled_.push_back(id); }
  const std::vector<KeyframeId>& culled() const { return culled_; }

 private:
  int LevelOf(const Observation& o) const {
    return (*map_.Find(o.keyframe_id)->features)[o.feature_idx].level;
  }

  const Map& map_;
  const KeyframeCullingOptions& options_;
  std::vector<KeyframeId> culled_;
};

}  // namespace

std::vector<KeyframeId> RedundantKeyframes(const Map& map,
                                           const std::vector<KeyframeId>& candidates,
                                           const KeyframeCullingOptions& options) {
  Culler culler(map, options);
  for (const KeyframeId& id : candidates) {
    if (culler.IsRedundant(id) && culler.IsCovered(id)) culler.Remove(id);
  }
  return culler.culled();
}

}  // namespace carmap
