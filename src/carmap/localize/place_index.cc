#include "carmap/localize/place_index.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "carmap/localize/map_neighbourhood.h"

namespace carmap {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

}  // namespace

PlaceIndex::PlaceIndex(const ReconstructedMap& map, std::shared_ptr<const Vocabulary> vocabulary,
                       const PlaceOptions& options)
    : map_(map),
      vocabulary_(std::move(vocabulary)),
      options_(options),
      index_(vocabulary_->word_count()) {
  GroupKeyframes();
  word_of_landmark_.reserve(map_.snapshot.landmarks.size());
  for (const SnapshotLandmark& landmark : map_.snapshot.landmarks) {
    word_of_landmark_.push_back(vocabulary_->WordOf(landmark.descriptor));
  }
  for (uint32_t i = 0; i < size(); ++i) {
    index_.Add(map_.snapshot.keyframes[centers_[i]].id, HistogramOfPlace(i));
  }
}

/// The keyframe and those within the radius that share landmarks with it, most shared first.
std::vector<uint32_t> PlaceIndex::KeyframesBeside(uint32_t keyframe_idx) const {
  const auto& keyframes = map_.snapshot.keyframes;
  const Eigen::Vector3d& center = keyframes[keyframe_idx].map_from_camera.translation;
  std::vector<uint32_t> beside = {keyframe_idx};
  for (const CovisibleKeyframe& other : map_.covisible()[keyframe_idx]) {
    const auto& p_in_map = keyframes[other.keyframe_idx].map_from_camera.translation;
    if ((p_in_map - center).norm() <= options_.radius_m) beside.push_back(other.keyframe_idx);
  }
  return beside;
}

void PlaceIndex::GroupKeyframes() {
  place_of_keyframe_.assign(map_.snapshot.keyframes.size(), kNone);
  for (uint32_t i = 0; i < place_of_keyframe_.size(); ++i) {
    if (place_of_keyframe_[i] != kNone) continue;
    for (const uint32_t member : KeyframesBeside(i)) {
      if (place_of_keyframe_[member] == kNone) {
        place_of_keyframe_[member] = static_cast<uint32_t>(centers_.size());
      }
    }
    centers_.push_back(i);
  }
}

std::vector<uint32_t> PlaceIndex::LandmarksOf(uint32_t place_idx) const {
  std::vector<uint32_t> keyframe_idxs = KeyframesBeside(centers_[place_idx]);
  keyframe_idxs.resize(std::min(keyframe_idxs.size(), options_.max_keyframes));
  const auto& of_center = map_.snapshot.keyframes[centers_[place_idx]].landmark_idxs;
  const size_t max_observations =
      options_.max_landmark_ratio * std::max(of_center.size(), options_.few_landmarks);
  return LandmarksSeenBy(map_, FirstThatSee(map_, std::move(keyframe_idxs), max_observations));
}

WordHistogram PlaceIndex::HistogramOfPlace(uint32_t place_idx) const {
  std::vector<uint32_t> word_idxs = LandmarksOf(place_idx);
  for (uint32_t& idx : word_idxs) idx = word_of_landmark_[idx];
  return HistogramOf(*vocabulary_, std::move(word_idxs));
}

std::vector<SimilarPlace> PlaceIndex::FindSimilar(const WordHistogram& histogram,
                                                  size_t max_count) const {
  const auto& keyframes = map_.snapshot.keyframes;
  std::vector<SimilarPlace> places;
  for (const SimilarKeyframe& similar : index_.FindSimilar(
           histogram, {.max_count = max_count, .max_postings = options_.max_postings})) {
    const auto keyframe =
        std::lower_bound(keyframes.begin(), keyframes.end(), similar.id,
                         [](const SnapshotKeyframe& a, const KeyframeId& id) { return a.id < id; });
    places.push_back(
        {PlaceOf(static_cast<uint32_t>(keyframe - keyframes.begin())), similar.similarity});
  }
  return places;
}

}  // namespace carmap
