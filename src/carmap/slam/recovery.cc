#include "carmap/slam/recovery.h"

#include <absl/container/btree_map.h>
#include <absl/container/btree_set.h>

#include <algorithm>
#include <utility>

#include "carmap/localize/relocalization.h"

namespace carmap {
namespace {

/// Matches with what a place's keyframes see: by position as if the frame stood at the keyframe in
/// the middle, and by appearance alone unless that gave a sure pose.
std::optional<TrackedPose> TryPlace(const MapSnapshot& snapshot, const Rigid3& camera_from_map,
                                    const FeatureGrid& grid, const StereoRig& rig,
                                    const RecoveryOptions& options) {
  const std::vector<uint32_t> landmark_idxs = AllLandmarks(snapshot);
  TrackingOptions wide = options.tracking;
  wide.first_radius_px = options.position_radius_px;
  auto pose = TrackByProjection(snapshot, landmark_idxs, grid, rig, camera_from_map, wide);
  if (pose && pose->inliers.size() >= static_cast<size_t>(options.far_inliers)) return pose;
  auto by_appearance =
      TrackByAppearance(snapshot, landmark_idxs, grid, rig, options.tracking, /*seed=*/1);
  if (by_appearance && (!pose || by_appearance->inliers.size() > pose->inliers.size())) {
    pose = std::move(by_appearance);
  }
  return pose;
}

/// The first of the ranked keyframes around which the frame is found. Keyframes side by side are
/// one place, which is tried once.
std::optional<FoundPlace> FirstAgreeing(const Map& map, const std::vector<KeyframeId>& ranked,
                                        size_t max_places, int min_inliers, const FeatureGrid& grid,
                                        const StereoRig& rig, const RecoveryOptions& options) {
  absl::btree_set<KeyframeId> tried;
  size_t places = 0;
  for (const KeyframeId& id : ranked) {
    if (tried.contains(id)) continue;
    if (places++ == max_places) break;
    const std::vector<KeyframeId> window = WindowAround(map, id, options.window);
    tried.insert(window.begin(), window.end());
    MapSnapshot snapshot = SnapshotOf(map, window);
    auto pose = TryPlace(snapshot, map.Find(id)->map_from_camera.Inverse(), grid, rig, options);
    if (pose && pose->inliers.size() >= static_cast<size_t>(min_inliers)) {
      return FoundPlace{id, std::move(snapshot), *std::move(pose)};
    }
  }
  return std::nullopt;
}

/// The candidates by how many of the frame's features resemble, more than anything else in their
/// sight, a landmark that they see.
std::vector<KeyframeId> RankByAppearance(const Map& map, const std::vector<KeyframeId>& candidates,
                                         const std::vector<Feature>& features,
                                         const RecoveryOptions& options) {
  absl::btree_set<LandmarkId> landmark_ids;
  absl::btree_map<KeyframeId, int> votes;
  for (const KeyframeId& id : candidates) {
    votes[id] = 0;
    for (const auto& link : map.LandmarksOf(id)) {
      if (link) landmark_ids.insert(*link);
    }
  }
  std::vector<const Landmark*> landmarks;
  for (const LandmarkId& id : landmark_ids) landmarks.push_back(map.Find(id));
  for (const uint32_t feature_idx : SampleFeatures(features.size(), options.ranking_features)) {
    const Descriptor& descriptor = features[feature_idx].descriptor;
    int best = options.max_ranking_bits + 1;
    const Landmark* voted = nullptr;
    for (const Landmark* landmark : landmarks) {
      const int bits = HammingDistance(descriptor, landmark->descriptor);
      if (bits >= best) continue;
      best = bits;
      voted = landmark;
    }
    if (!voted) continue;
    for (const Observation& observation : voted->observations) {
      const auto vote = votes.find(observation.keyframe_id);
      if (vote != votes.end()) ++vote->second;
    }
  }
  std::vector<KeyframeId> ranked = candidates;
  std::stable_sort(ranked.begin(), ranked.end(),
                   [&](KeyframeId a, KeyframeId b) { return votes.at(a) > votes.at(b); });
  return ranked;
}

}  // namespace

std::optional<FoundPlace> FindNear(const Map& map, const std::vector<KeyframeId>& candidates,
                                   const FeatureGrid& grid, const StereoRig& rig,
                                   const Rigid3& predicted_map_from_camera,
                                   const RecoveryOptions& options) {
  std::vector<std::pair<double, KeyframeId>> near;
  for (const KeyframeId& id : candidates) {
    const double distance_m =
        (map.Find(id)->map_from_camera.translation - predicted_map_from_camera.translation).norm();
    if (distance_m <= options.near_m) near.emplace_back(distance_m, id);
  }
  std::sort(near.begin(), near.end());
  std::vector<KeyframeId> ranked;
  for (const auto& [distance_m, id] : near) ranked.push_back(id);
  return FirstAgreeing(map, ranked, options.near_places, options.near_inliers, grid, rig, options);
}

std::optional<FoundPlace> FindAnywhere(const Map& map, const std::vector<KeyframeId>& candidates,
                                       const FeatureGrid& grid, const StereoRig& rig,
                                       const RecoveryOptions& options) {
  return FirstAgreeing(map, RankByAppearance(map, candidates, grid.features(), options),
                       options.far_places, options.far_inliers, grid, rig, options);
}

}  // namespace carmap
