#include "carmap/slam/global_adjustment.h"

#include <absl/container/flat_hash_map.h>

#include <algorithm>
#include <utility>

namespace carmap {

std::vector<LandmarkId> ChooseLandmarks(const Map& map, const GlobalAdjustmentOptions& options) {
  std::vector<std::pair<size_t, LandmarkId>> ranked;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (landmark.observations.size() >= options.min_observations && !landmark.is_non_static()) {
      ranked.emplace_back(landmark.observations.size(), id);
    }
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  absl::flat_hash_map<KeyframeId, size_t> chosen_of;
  std::vector<LandmarkId> chosen;
  for (const auto& [count, id] : ranked) {
    const auto& observations = map.Find(id)->observations;
    const bool is_needed =
        std::any_of(observations.begin(), observations.end(), [&](const Observation& observation) {
          return chosen_of[observation.keyframe_id] < options.landmarks_per_keyframe;
        });
    if (!is_needed) continue;
    chosen.push_back(id);
    for (const Observation& observation : observations) ++chosen_of[observation.keyframe_id];
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

MapBundle MakeGlobalBundle(const Map& map, const StereoRig& rig,
                           const std::vector<PositionPrior>& fixes,
                           const GlobalAdjustmentOptions& options) {
  std::vector<KeyframeId> ids;
  for (const auto& [id, keyframe] : map.keyframes()) ids.push_back(id);
  MapBundle problem = MakeMapBundle(map, rig, options.noise, ids, ChooseLandmarks(map, options));
  problem.bundle.priors = fixes;
  problem.bundle.pose_is_fixed.front() = fixes.empty();
  return problem;
}

GlobalAdjustment::GlobalAdjustment(MapBundle problem, const BundleOptions& options, bool sequential)
    : problem_(std::move(problem)), options_(options) {
  options_.stop = &stop_;
  summary_ = std::async(sequential ? std::launch::deferred : std::launch::async,
                        [this] { return AdjustBundle(problem_.bundle, options_); });
}

GlobalAdjustment::~GlobalAdjustment() { stop_ = true; }

MapEdit GlobalAdjustment::Finish() {
  const BundleSummary summary = summary_.get();
  return EditOf(problem_, summary);
}

}  // namespace carmap
