#include "carmap/localize/relocalization.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace carmap {
namespace {

constexpr int kMaxSearches = 5;
constexpr double kSettledM = 0.3;
constexpr double kLaterRadiusPx = 12;  // of searches from a pose that was found, not guessed

/// For each keyframe of the map how many of the frame's sampled features resemble, more than
/// anything else in the candidates' sight, a landmark that it sees.
std::vector<int> CountVotes(const ReconstructedMap& map, const std::vector<uint32_t>& candidates,
                            const std::vector<Feature>& features,
                            const RelocalizationOptions& options) {
  std::vector<int> votes(map.snapshot.keyframes.size(), 0);
  const std::vector<uint32_t> landmark_idxs = LandmarksSeenBy(map, candidates);
  for (const uint32_t feature_idx : SampleFeatures(features.size(), options.ranking_features)) {
    const Descriptor& descriptor = features[feature_idx].descriptor;
    int best = options.max_ranking_bits + 1;
    uint32_t best_idx = 0;
    for (const uint32_t landmark_idx : landmark_idxs) {
      const int bits = HammingDistance(descriptor, map.snapshot.landmarks[landmark_idx].descriptor);
      if (bits >= best) continue;
      best = bits;
      best_idx = landmark_idx;
    }
    if (best > options.max_ranking_bits) continue;
    for (const uint32_t keyframe_idx : map.keyframes_of_landmark[best_idx]) ++votes[keyframe_idx];
  }
  return votes;
}

bool IsSure(const std::optional<TrackedPose>& pose, const RelocalizationOptions& options) {
  return pose && pose->inliers.size() >= options.sure_inliers;
}

void KeepBetter(std::optional<TrackedPose> other, std::optional<TrackedPose>& pose) {
  if (other && (!pose || other->inliers.size() > pose->inliers.size())) pose = std::move(other);
}

/// Refines with all landmarks around; nothing unless enough of them agree.
std::optional<TrackedPose> Confirm(const ReconstructedMap& map,
                                   const std::optional<TrackedPose>& pose, const FeatureGrid& grid,
                                   const StereoRig& rig, const RelocalizationOptions& options) {
  if (!pose) return std::nullopt;
  TrackingOptions tracking = options.tracking;
  tracking.min_inliers = options.min_inliers;
  return TrackAround(map, grid, rig, pose->camera_from_map, tracking, options.neighbourhood);
}

/// Matches by position as if the frame stood at the keyframe, and by appearance alone unless that
/// gave a sure pose.
std::optional<TrackedPose> TryKeyframe(const ReconstructedMap& map, uint32_t keyframe_idx,
                                       const std::vector<uint32_t>& landmark_idxs,
                                       const FeatureGrid& grid, const StereoRig& rig,
                                       const RelocalizationOptions& options) {
  TrackingOptions wide = options.tracking;
  wide.first_radius_px = options.position_radius_px;
  const Rigid3 camera_from_map = map.snapshot.keyframes[keyframe_idx].map_from_camera.Inverse();
  auto pose =
      Confirm(map, TrackByProjection(map.snapshot, landmark_idxs, grid, rig, camera_from_map, wide),
              grid, rig, options);
  if (IsSure(pose, options)) return pose;
  const auto by_appearance = TrackByAppearance(map.snapshot, landmark_idxs, grid, rig,
                                               options.tracking, /*seed=*/keyframe_idx + 1);
  KeepBetter(Confirm(map, by_appearance, grid, rig, options), pose);
  return pose;
}

}  // namespace

std::vector<uint32_t> SampleFeatures(size_t feature_count, size_t max_count) {
  const size_t count = std::min(feature_count, max_count);
  std::vector<uint32_t> idxs;
  for (size_t i = 0; i < count; ++i) {
    idxs.push_back(static_cast<uint32_t>(i * feature_count / count));
  }
  return idxs;
}

std::vector<uint32_t> CandidateKeyframes(const ReconstructedMap& map,
                                         const std::optional<GpsFix>& gps, double gps_radius_m) {
  if (gps && map.gps) {
    std::vector<uint32_t> candidates = map.gps->KeyframesNear(*gps, gps_radius_m);
    const auto& unplaced = map.gps->unplaced();
    candidates.insert(candidates.end(), unplaced.begin(), unplaced.end());
    return candidates;
  }
  std::vector<uint32_t> all(map.snapshot.keyframes.size());
  std::iota(all.begin(), all.end(), 0u);
  return all;
}

std::optional<TrackedPose> TrackAround(const ReconstructedMap& map, const FeatureGrid& grid,
                                       const StereoRig& rig, Rigid3 camera_from_map,
                                       TrackingOptions tracking,
                                       const NeighbourhoodOptions& neighbourhood) {
  const double later_radius_px = std::min(tracking.first_radius_px, kLaterRadiusPx);
  std::optional<TrackedPose> best;
  for (int i = 0; i < kMaxSearches; ++i) {
    const auto landmark_idxs = LandmarksAround(map, camera_from_map.Inverse(), neighbourhood);
    auto pose =
        TrackByProjection(map.snapshot, landmark_idxs, grid, rig, camera_from_map, tracking);
    if (!pose || (best && pose->inliers.size() < best->inliers.size())) break;
    const double moved_m = (pose->camera_from_map * camera_from_map.Inverse()).translation.norm();
    camera_from_map = pose->camera_from_map;
    best = std::move(pose);
    if (moved_m < kSettledM) break;
    tracking.first_radius_px = later_radius_px;
  }
  return best;
}

std::optional<TrackedPose> Relocalize(const ReconstructedMap& map, const FeatureGrid& grid,
                                      const StereoRig& rig, const std::optional<GpsFix>& gps,
                                      const RelocalizationOptions& options) {
  std::vector<uint32_t> candidates = CandidateKeyframes(map, gps, options.gps_radius_m);
  const std::vector<int> votes = CountVotes(map, candidates, grid.features(), options);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](uint32_t a, uint32_t b) { return votes[a] > votes[b]; });

  std::vector<bool> is_tried(map.snapshot.keyframes.size(), false);
  size_t tries = 0;
  std::optional<TrackedPose> best;
  for (const uint32_t keyframe_idx : candidates) {
    if (is_tried[keyframe_idx]) continue;
    if (tries++ == options.max_candidates) break;
    const auto place = WithCovisible(map, keyframe_idx, options.covisible_neighbours);
    for (const uint32_t idx : place) is_tried[idx] = true;
    KeepBetter(TryKeyframe(map, keyframe_idx, LandmarksSeenBy(map, place), grid, rig, options),
               best);
    if (IsSure(best, options)) break;
  }
  return best;
}

}  // namespace carmap
