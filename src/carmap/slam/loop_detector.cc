#include "carmap/slam/loop_detector.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <numeric>
#include <utility>

#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

/// How far ahead of a place a keyframe may stand and still see the same.
constexpr double kSightM = 20;

bool Contains(const std::vector<KeyframeId>& ascending, KeyframeId id) {
  return std::binary_search(ascending.begin(), ascending.end(), id);
}

/// The keyframe and those that hold it already by many landmarks; ascending.
std::vector<KeyframeId> WithTied(const Map& map, KeyframeId id, int tied_landmarks) {
  std::vector<KeyframeId> ids = {id};
  for (const Covisibility& other : CovisibleKeyframes(map, id, tied_landmarks)) {
    ids.push_back(other.id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

}  // namespace

std::optional<LoopMatch> MatchPlace(const Map& map, const StereoRig& rig, const Keyframe& keyframe,
                                    KeyframeId place_id, KeyframeId last_of_earlier_pass,
                                    const LoopDetectorOptions& options) {
  std::vector<KeyframeId> around_place = WindowAround(map, place_id, options.window);
  std::erase_if(around_place, [&](KeyframeId id) { return last_of_earlier_pass < id; });
  const MapSnapshot snapshot = SnapshotOf(map, around_place);
  const std::vector<uint32_t> of_earlier_pass = SelectLandmarks(snapshot, [&](LandmarkId id) {
    return !(last_of_earlier_pass < map.Find(id)->observations.back().keyframe_id);
  });
  const FeatureGrid grid(*keyframe.features, rig.camera.width, rig.camera.height);
  const auto pose =
      TrackByAppearance(snapshot, of_earlier_pass, grid, rig, options.tracking, /*seed=*/1);
  if (!pose) return std::nullopt;

  const auto in_sight = std::count_if(
      of_earlier_pass.begin(), of_earlier_pass.end(),
      [&](uint32_t idx) { return IsInSight(snapshot.landmarks[idx], rig, pose->camera_from_map); });
  const LoopMatch match{
      .keyframe_id = keyframe.id,
      .place_id = place_id,
      .keyframe_from_place = pose->camera_from_map * map.Find(place_id)->map_from_camera,
      .map_from_keyframe = pose->camera_from_map.Inverse(),
      .covariance = WithSharedErrors(pose->covariance),
      .inlier_count = static_cast<int>(pose->inliers.size()),
      .seen_share =
          static_cast<double>(pose->inliers.size()) / std::max(static_cast<double>(in_sight), 1.0)};
  if (match.seen_share < options.min_seen_share || SigmaM(match.covariance) > options.max_sigma_m ||
      SigmaRad(match.covariance) > options.max_sigma_rad) {
    return std::nullopt;
  }
  return match;
}

LoopDetector::LoopDetector(const LoopDetectorOptions& options,
                           std::shared_ptr<const Vocabulary> vocabulary)
    : options_(options), vocabulary_(std::move(vocabulary)) {
  if (vocabulary_) index_.emplace(vocabulary_->word_count());
}
LoopDetector::~LoopDetector() = default;

std::optional<Loop> LoopDetector::Detect(const Map& map, const StereoRig& rig, KeyframeId newest) {
  const Keyframe& keyframe = *map.Find(newest);
  Add(map, keyframe);
  const auto match = Match(map, rig, keyframe);
  if (index_) index_->Add(newest, histogram_);
  // A keyframe that was culled since tells no correction any more.
  std::erase_if(chain_, [&](const LoopMatch& m) {
    return !map.Find(m.keyframe_id) || !map.Find(m.place_id);
  });
  if (!match) {
    if (++missed_ > options_.max_missed_keyframes) chain_.clear();
    return std::nullopt;
  }
  if (!chain_.empty() && !Agrees(map, chain_.back(), *match)) chain_.clear();
  chain_.push_back(*match);
  missed_ = 0;
  const int inliers =
      std::accumulate(chain_.begin(), chain_.end(), 0,
                      [](int sum, const LoopMatch& m) { return sum + m.inlier_count; });
  if (chain_.size() < options_.min_keyframes || inliers < options_.min_chain_inliers ||
      Since(chain_.front().keyframe_id).driven_m < options_.min_chain_m) {
    return std::nullopt;
  }
  return std::exchange(chain_, {});
}

void LoopDetector::Add(const Map& map, const Keyframe& keyframe) {
  if (vocabulary_) {
    previous_histogram_ = std::move(histogram_);
    histogram_ = HistogramOf(*vocabulary_, *keyframe.features);
  }
  Odometer sum;
  if (!odometer_.empty()) {
    const auto& [previous_id, previous_sum] = *odometer_.rbegin();
    sum = previous_sum;
    const Keyframe* previous = map.Find(previous_id);
    const double step_m =
        previous
            ? (keyframe.map_from_camera.translation - previous->map_from_camera.translation).norm()
            : 0;
    sum.driven_m += step_m;
    sum.drift_m += options_.drift_ratio * step_m;
    sum.drift_rad += options_.drift_rad_per_m * step_m;
    if (CovisibleKeyframes(map, keyframe.id, 1).empty()) sum.drift_m += options_.drift_where_lost_m;
  }
  odometer_[keyframe.id] = sum;
}

LoopDetector::Odometer LoopDetector::Since(KeyframeId place_id) const {
  const Odometer& now = odometer_.rbegin()->second;
  const auto then = odometer_.find(place_id);
  if (then == odometer_.end()) return {};
  return {now.driven_m - then->second.driven_m, now.drift_m - then->second.drift_m,
          now.drift_rad - then->second.drift_rad};
}

/// The newest keyframe from which the vehicle has driven far enough to have come back.
std::optional<KeyframeId> LoopDetector::LastOfEarlierPass() const {
  const double now_m = odometer_.rbegin()->second.driven_m;
  const auto last = std::find_if(odometer_.rbegin(), odometer_.rend(), [&](const auto& keyframe) {
    return now_m - keyframe.second.driven_m >= options_.min_driven_m;
  });
  if (last == odometer_.rend()) return std::nullopt;
  return last->first;
}

bool LoopDetector::IsPossible(const Keyframe& keyframe, const Keyframe& place) const {
  const Odometer since = Since(place.id);
  const Rigid3 place_from_keyframe = place.map_from_camera.Inverse() * keyframe.map_from_camera;
  return place_from_keyframe.translation.norm() <=
             options_.drift_allowance_m + since.drift_m + kSightM &&
         RotationAngle(place_from_keyframe.rotation) <= options_.max_turn_rad + since.drift_rad;
}

bool LoopDetector::IsPossibleDrift(const Keyframe& keyframe, const LoopMatch& match) const {
  const Odometer since = Since(match.place_id);
  const Rigid3 drift = keyframe.map_from_camera.Inverse() * match.map_from_keyframe;
  return drift.translation.norm() <= options_.drift_allowance_m + since.drift_m &&
         RotationAngle(drift.rotation) <= options_.drift_allowance_rad + since.drift_rad;
}

std::vector<KeyframeId> LoopDetector::ProposePlaces(const Map& map, const Keyframe& keyframe,
                                                    KeyframeId last_of_earlier_pass) {
  const std::vector<KeyframeId> excluded = WithTied(map, keyframe.id, options_.tied_landmarks);
  std::vector<KeyframeId> places;
  std::vector<KeyframeId> taken = excluded;
  // Keyframes side by side are one place.
  const auto take = [&](const std::vector<KeyframeId>& ranked, size_t max_count) {
    size_t count = 0;
    for (const KeyframeId& id : ranked) {
      if (count == max_count) return;
      if (last_of_earlier_pass < id || Contains(taken, id) ||
          !IsPossible(keyframe, *map.Find(id))) {
        continue;
      }
      ++count;
      places.push_back(id);
      const std::vector<KeyframeId> window = WindowAround(map, id, options_.window);
      taken.insert(taken.end(), window.begin(), window.end());
      std::sort(taken.begin(), taken.end());
    }
  };
  if (index_) take(RankByWords(map, keyframe, excluded), options_.max_places_by_words);
  take(RankByPosition(map, keyframe), options_.max_places_by_position);
  return places;
}

std::vector<KeyframeId> LoopDetector::RankByWords(const Map& map, const Keyframe& keyframe,
                                                  const std::vector<KeyframeId>& excluded) {
  constexpr size_t kMaxCount = 100;  // of which most stand side by side
  std::vector<KeyframeId> ranked;
  const float min_similarity =
      options_.min_relative_similarity * Similarity(histogram_, previous_histogram_);
  for (const SimilarKeyframe& similar :
       index_->FindSimilar(histogram_, {excluded, min_similarity, kMaxCount})) {
    if (!map.Find(similar.id)) {
      index_->Remove(similar.id);
    } else if (similar.id != keyframe.id) {
      ranked.push_back(similar.id);
    }
  }
  return ranked;
}

/// Nearest first: by their fixes where both have one, or else by the map, which may have drifted.
std::vector<KeyframeId> LoopDetector::RankByPosition(const Map& map,
                                                     const Keyframe& keyframe) const {
  std::optional<LocalEnu> enu;
  if (keyframe.gps) enu.emplace(*keyframe.gps);
  std::vector<std::pair<double, KeyframeId>> near;
  for (const auto& [id, other] : map.keyframes()) {
    if (id == keyframe.id) break;
    double distance_m =
        (other.map_from_camera.translation - keyframe.map_from_camera.translation).norm();
    const bool has_fixes = enu && other.gps;
    if (has_fixes) distance_m = enu->FromGps(*other.gps).head<2>().norm();
    if ((has_fixes || index_) && distance_m > options_.position_radius_m) continue;
    near.emplace_back(distance_m, id);
  }
  std::sort(near.begin(), near.end());
  std::vector<KeyframeId> ranked;
  for (const auto& [distance_m, id] : near) ranked.push_back(id);
  return ranked;
}

std::optional<LoopMatch> LoopDetector::Match(const Map& map, const StereoRig& rig,
                                             const Keyframe& keyframe) {
  const std::optional<KeyframeId> last = LastOfEarlierPass();
  if (!last) return std::nullopt;
  std::vector<LoopMatch> matches;
  for (const KeyframeId& place_id : ProposePlaces(map, keyframe, *last)) {
    const auto match = MatchPlace(map, rig, keyframe, place_id, *last, options_);
    if (match) matches.push_back(*match);
  }
  if (matches.empty()) return std::nullopt;
  const auto best = std::max_element(
      matches.begin(), matches.end(),
      [](const LoopMatch& a, const LoopMatch& b) { return a.inlier_count < b.inlier_count; });
  const bool has_rival = std::any_of(matches.begin(), matches.end(), [&](const LoopMatch& other) {
    return other.inlier_count > options_.max_rival_ratio * best->inlier_count &&
           !Agrees(map, *best, other);
  });
  if (has_rival || !IsPossibleDrift(keyframe, *best)) {
    ++rejected_count_;
    return std::nullopt;
  }
  return *best;
}

bool LoopDetector::Agrees(const Map& map, const LoopMatch& a, const LoopMatch& b) const {
  const Rigid3 b_from_a =
      map.Find(b.keyframe_id)->map_from_camera.Inverse() * map.Find(a.keyframe_id)->map_from_camera;
  const Matrix6d adjoint = AdjointOf(b_from_a);
  const Vector6d difference =
      PoseDifference(b_from_a * a.map_from_keyframe.Inverse(), b.map_from_keyframe.Inverse());
  const Matrix6d covariance = adjoint * a.covariance * adjoint.transpose() + b.covariance;
  return difference.dot(covariance.ldlt().solve(difference)) <=
         options_.max_disagreement * options_.max_disagreement;
}

}  // namespace carmap
