#include "carmap/slam/loop_detector.h"

#include <algorithm>
#include <array>
#include <utility>

#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {
namespace {

/// How far ahead of a place a keyframe may stand and still see the same.
constexpr double kSightM = 20;

bool Contains(const std::vector<KeyframeId>& ascending, KeyframeId id) {
  return std::binary_search(ascending.begin(), ascending.end(), id);
}

/// The keyframe and all that see a landmark that it sees; ascending.
std::vector<KeyframeId> WithAllCovisible(const Map& map, KeyframeId id) {
  std::vector<KeyframeId> ids = {id};
  for (const Covisibility& other : CovisibleKeyframes(map, id, 1)) ids.push_back(other.id);
  std::sort(ids.begin(), ids.end());
  return ids;
}

/// Cells of the image that hold at least two of the inliers.
int CountImageCells(const std::vector<LandmarkMatch>& inliers, const std::vector<Feature>& features,
                    const PinholeCamera& camera) {
  constexpr int kColumns = 4, kRows = 2;
  std::array<int, kColumns * kRows> counts{};
  for (const LandmarkMatch& match : inliers) {
    const Feature& feature = features[match.feature_idx];
    const int column = static_cast<int>(kColumns * feature.x_px / static_cast<float>(camera.width));
    const int row = static_cast<int>(kRows * feature.y_px / static_cast<float>(camera.height));
    ++counts[std::clamp(row, 0, kRows - 1) * kColumns + std::clamp(column, 0, kColumns - 1)];
  }
  return static_cast<int>(
      std::count_if(counts.begin(), counts.end(), [](int count) { return count >= 2; }));
}

/// What the keyframe moves by if the match is right.
Rigid3 CorrectionBy(const Map& map, const LoopMatch& match) {
  return match.map_from_keyframe * map.Find(match.keyframe_id)->map_from_camera.Inverse();
}

}  // namespace

std::optional<LoopMatch> MatchPlace(const Map& map, const StereoRig& rig, const Keyframe& keyframe,
                                    KeyframeId place_id, const LoopDetectorOptions& options) {
  const std::vector<KeyframeId> seen_already = WithAllCovisible(map, keyframe.id);
  std::vector<KeyframeId> around_place = WindowAround(map, place_id, options.window);
  std::erase_if(around_place, [&](KeyframeId id) { return Contains(seen_already, id); });
  if (around_place.empty()) return std::nullopt;

  const MapSnapshot snapshot = SnapshotOf(map, around_place);
  const FeatureGrid grid(*keyframe.features, rig.camera.width, rig.camera.height);
  const auto pose =
      TrackByAppearance(snapshot, AllLandmarks(snapshot), grid, rig, options.tracking, /*seed=*/1);
  if (!pose || static_cast<int>(pose->inliers.size()) < options.min_inliers) return std::nullopt;

  const auto in_sight = std::count_if(snapshot.landmarks.begin(), snapshot.landmarks.end(),
                                      [&](const SnapshotLandmark& landmark) {
                                        return IsInSight(landmark, rig, pose->camera_from_map);
                                      });
  const auto near =
      std::count_if(pose->inliers.begin(), pose->inliers.end(), [&](const LandmarkMatch& match) {
        const auto& p_in_map = snapshot.landmarks[match.landmark_idx].position_in_map;
        return (pose->camera_from_map * p_in_map).z() < options.near_m;
      });
  const LoopMatch match{
      .keyframe_id = keyframe.id,
      .place_id = place_id,
      .keyframe_from_place = pose->camera_from_map * map.Find(place_id)->map_from_camera,
      .map_from_keyframe = pose->camera_from_map.Inverse(),
      .inlier_count = static_cast<int>(pose->inliers.size()),
      .seen_share =
          static_cast<double>(pose->inliers.size()) / std::max(static_cast<double>(in_sight), 1.0)};
  if (match.seen_share < options.min_seen_share || near < options.min_near_inliers ||
      CountImageCells(pose->inliers, *keyframe.features, rig.camera) < options.min_image_cells) {
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
  TakeIn(map, keyframe);
  const auto match = Match(map, rig, keyframe);
  if (index_) index_->Add(newest, histogram_);
  // A keyframe that went tells no correction any more.
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
  if (chain_.size() < options_.min_keyframes ||
      Since(chain_.front().keyframe_id).driven_m < options_.min_chain_m) {
    return std::nullopt;
  }
  return std::exchange(chain_, {});
}

void LoopDetector::TakeIn(const Map& map, const Keyframe& keyframe) {
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

bool LoopDetector::IsPossible(const Keyframe& keyframe, const Keyframe& place) const {
  const Odometer since = Since(place.id);
  const Rigid3 place_from_keyframe = place.map_from_camera.Inverse() * keyframe.map_from_camera;
  return since.driven_m >= options_.min_driven_m &&
         place_from_keyframe.translation.norm() <=
             options_.drift_allowance_m + since.drift_m + kSightM &&
         RotationAngle(place_from_keyframe.rotation) <= options_.max_turn_rad + since.drift_rad;
}

bool LoopDetector::IsPossibleDrift(const Keyframe& keyframe, const LoopMatch& match) const {
  const Odometer since = Since(match.place_id);
  const Rigid3 drift = keyframe.map_from_camera.Inverse() * match.map_from_keyframe;
  return drift.translation.norm() <= options_.drift_allowance_m + since.drift_m &&
         RotationAngle(drift.rotation) <= options_.drift_allowance_rad + since.drift_rad;
}

std::vector<KeyframeId> LoopDetector::ProposePlaces(const Map& map, const Keyframe& keyframe) {
  const std::vector<KeyframeId> excluded = WithAllCovisible(map, keyframe.id);
  std::vector<KeyframeId> places;
  std::vector<KeyframeId> taken = excluded;
  // Keyframes side by side are one place.
  const auto take = [&](const std::vector<KeyframeId>& ranked, size_t max_count) {
    size_t count = 0;
    for (const KeyframeId& id : ranked) {
      if (count == max_count) return;
      if (Contains(taken, id) || !IsPossible(keyframe, *map.Find(id))) continue;
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
  std::vector<LoopMatch> matches;
  for (const KeyframeId& place_id : ProposePlaces(map, keyframe)) {
    const auto match = MatchPlace(map, rig, keyframe, place_id, options_);
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
  const Rigid3 by_a = CorrectionBy(map, a) * map.Find(b.keyframe_id)->map_from_camera;
  const Rigid3 difference = by_a.Inverse() * b.map_from_keyframe;
  return difference.translation.norm() <= options_.max_disagreement_m &&
         RotationAngle(difference.rotation) <= options_.max_disagreement_rad;
}

}  // namespace carmap
