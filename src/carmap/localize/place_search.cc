#include "carmap/localize/place_search.h"

#include <algorithm>
#include <utility>

#include "carmap/solve/pnp.h"

namespace carmap {
namespace {

// So far from where the middle of the place shows them are landmarks looked for.
constexpr double kPlaceRadiusPx = 60;
// Poses this close are of one place.
constexpr double kSamePoseM = 2, kSamePoseRad = 0.2;
// A place so near to where the frame surely is explains nothing else.
constexpr double kSamePlaceM = 20;

Eigen::Vector3d CenterOf(const Rigid3& camera_from_map) {
  return camera_from_map.Inverse().translation;
}

bool AreOnePlace(const Rigid3& a, const Rigid3& b) {
  return (CenterOf(a) - CenterOf(b)).norm() <= kSamePoseM &&
         RotationAngle((a * b.Inverse()).rotation) <= kSamePoseRad;
}

/// Of hypotheses with the same pose the one with most inliers stays.
void AddDistinct(PlaceHypothesis hypothesis, std::vector<PlaceHypothesis>& hypotheses) {
  const auto same =
      std::find_if(hypotheses.begin(), hypotheses.end(), [&](const PlaceHypothesis& other) {
        return AreOnePlace(other.camera_from_map, hypothesis.camera_from_map);
      });
  if (same == hypotheses.end()) {
    hypotheses.push_back(std::move(hypothesis));
  } else if (same->inliers.size() < hypothesis.inliers.size()) {
    *same = std::move(hypothesis);
  }
}

}  // namespace

PlaceSearch::PlaceSearch(const ReconstructedMap& map, std::shared_ptr<const Vocabulary> vocabulary,
                         const PlaceSearchOptions& options)
    : map_(map), vocabulary_(std::move(vocabulary)), options_(options) {}

std::vector<PlaceHypothesis> PlaceSearch::Search(const FeatureGrid& grid, const StereoRig& rig,
                                                 const std::optional<GpsFix>& gps) {
  if (!index_) index_.emplace(map_, vocabulary_, options_.places);
  last_vain_search_.resize(index_->size(), 0);
  ++search_count_;
  const SizedFeatures features(grid.features(), rig);
  std::vector<PlaceHypothesis> hypotheses;
  std::optional<Candidate> found;  // where the frame surely is
  size_t tries = 0, comparisons = 0;
  for (const Candidate& candidate : RankPlaces(grid.features(), gps)) {
    if (tries == options_.max_tries || comparisons >= options_.max_comparisons) break;
    if (!IsWorthATry(candidate, found, hypotheses)) continue;
    ++tries;
    auto hypothesis = Try(candidate, features, grid, rig, comparisons);
    if (!hypothesis) {
      last_vain_search_[candidate.place_idx] = search_count_;
      continue;
    }
    hypothesis->is_near_fix = gps && IsNearFix(hypothesis->camera_from_map, *gps);
    if (!found && hypothesis->inliers.size() >= options_.sure_inliers) found = candidate;
    AddDistinct(*std::move(hypothesis), hypotheses);
  }
  std::stable_sort(hypotheses.begin(), hypotheses.end(),
                   [](const PlaceHypothesis& a, const PlaceHypothesis& b) {
                     return a.inliers.size() > b.inliers.size();
                   });
  if (hypotheses.size() > options_.max_hypotheses) hypotheses.resize(options_.max_hypotheses);
  return hypotheses;
}

/// Those near the fix before all others, each by resemblance; behind them those that were tried in
/// vain a short while ago, the longest rested first.
std::vector<PlaceSearch::Candidate> PlaceSearch::RankPlaces(
    const std::vector<Feature>& features, const std::optional<GpsFix>& gps) const {
  const WordHistogram histogram = index_->HistogramOfFrame(features);
  std::vector<Candidate> candidates;
  if (gps && map_.gps) candidates = PlacesNear(histogram, *gps);
  // So many that some are left when all that were tried lately rest.
  const size_t count = options_.max_tries * (options_.resting_searches + 1);
  const size_t near_count = candidates.size();
  for (const SimilarPlace& similar : index_->FindSimilar(histogram, count)) {
    const bool is_near =
        std::any_of(candidates.begin(), candidates.begin() + static_cast<ptrdiff_t>(near_count),
                    [&](const Candidate& near) { return near.place_idx == similar.place_idx; });
    if (!is_near) candidates.push_back({similar.place_idx, similar.similarity, false});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [&](const Candidate& a, const Candidate& b) {
                     return RestingSince(a.place_idx) < RestingSince(b.place_idx);
                   });
  return candidates;
}

std::vector<PlaceSearch::Candidate> PlaceSearch::PlacesNear(const WordHistogram& histogram,
                                                            const GpsFix& fix) const {
  std::vector<Candidate> near;
  for (const uint32_t keyframe_idx :
       map_.gps->KeyframesNear(fix, options_.gps_radius_m, options_.max_gps_keyframes)) {
    if (near.size() == options_.max_gps_places) break;
    const uint32_t place_idx = index_->PlaceOf(keyframe_idx);
    const bool is_listed = std::any_of(near.begin(), near.end(), [&](const Candidate& other) {
      return other.place_idx == place_idx;
    });
    if (is_listed) continue;
    near.push_back({place_idx, Similarity(histogram, index_->HistogramOfPlace(place_idx)), true});
  }
  std::stable_sort(near.begin(), near.end(), [](const Candidate& a, const Candidate& b) {
    return a.similarity > b.similarity;
  });
  return near;
}

/// Number of the search that tried it in vain, 0 if it does not rest.
size_t PlaceSearch::RestingSince(uint32_t place_idx) const {
  const size_t last = last_vain_search_[place_idx];
  return last + options_.resting_searches >= search_count_ ? last : 0;
}

/// Once the frame was surely found, only what resembles it nearly as much elsewhere is.
bool PlaceSearch::IsWorthATry(const Candidate& candidate, const std::optional<Candidate>& found,
                              const std::vector<PlaceHypothesis>& hypotheses) const {
  if (!found) return true;
  if (found->proposed_by_gps && !candidate.proposed_by_gps) return false;
  if (candidate.similarity < options_.rival_similarity * found->similarity) return false;
  const Eigen::Vector3d& place =
      map_.snapshot.keyframes[index_->CenterOf(candidate.place_idx)].map_from_camera.translation;
  return std::none_of(hypotheses.begin(), hypotheses.end(), [&](const PlaceHypothesis& other) {
    return other.inliers.size() >= options_.sure_inliers &&
           (CenterOf(other.camera_from_map) - place).norm() <= kSamePlaceM;
  });
}

/// Matches by appearance and size, PnP with RANSAC, then search by position around that pose. If
/// too few agree, search by position as if the frame stood in the middle of the place.
std::optional<PlaceHypothesis> PlaceSearch::Try(const Candidate& candidate,
                                                const SizedFeatures& features,
                                                const FeatureGrid& grid, const StereoRig& rig,
                                                size_t& comparisons) const {
  const uint32_t center_idx = index_->CenterOf(candidate.place_idx);
  const Rigid3& map_from_center = map_.snapshot.keyframes[center_idx].map_from_camera;
  const auto matches = features.Match(map_.snapshot, index_->LandmarksOf(candidate.place_idx),
                                      options_.matching, comparisons);
  const auto coarse = SolvePnpRansac(
      rig, options_.tracking.noise, MeasurementsOf(map_.snapshot, grid.features(), rig, matches),
      {.max_iterations = options_.max_samples,
       .min_inliers = options_.min_agreeing_matches,
       .down_in_map = map_from_center.rotation * Eigen::Vector3d::UnitY(),
       .seed = candidate.place_idx + 1});
  TrackingOptions tracking = options_.tracking;
  if (!coarse) tracking.first_radius_px = kPlaceRadiusPx;
  const auto pose =
      TrackAround(map_, grid, rig, coarse ? coarse->camera_from_map : map_from_center.Inverse(),
                  tracking, options_.neighbourhood);
  if (!pose) return std::nullopt;
  auto hypothesis = Judge(*pose, rig);
  if (!hypothesis) return std::nullopt;
  hypothesis->keyframe_idx = center_idx;
  return hypothesis;
}

bool PlaceSearch::IsNearFix(const Rigid3& camera_from_map, const GpsFix& fix) const {
  if (!map_.gps) return false;
  const auto nearest = map_.keyframe_centers.Nearest(CenterOf(camera_from_map), 1);
  const auto near = map_.gps->KeyframesNear(fix, options_.gps_radius_m, options_.max_gps_keyframes);
  return !nearest.empty() && std::find(near.begin(), near.end(), nearest.front()) != near.end();
}

/// What speaks for the pose; nothing if its landmarks are not those around it.
std::optional<PlaceHypothesis> PlaceSearch::Judge(const TrackedPose& pose,
                                                  const StereoRig& rig) const {
  size_t in_sight = 0;
  for (const uint32_t landmark_idx :
       LandmarksAround(map_, pose.camera_from_map.Inverse(), options_.neighbourhood)) {
    if (IsInSight(map_.snapshot.landmarks[landmark_idx], rig, pose.camera_from_map)) ++in_sight;
  }
  if (in_sight < pose.inliers.size()) return std::nullopt;
  PlaceHypothesis hypothesis;
  hypothesis.camera_from_map = pose.camera_from_map;
  hypothesis.inliers = pose.inliers;
  hypothesis.covariance = pose.covariance;
  hypothesis.seen_share = static_cast<double>(pose.inliers.size()) / static_cast<double>(in_sight);
  return hypothesis;
}

}  // namespace carmap
