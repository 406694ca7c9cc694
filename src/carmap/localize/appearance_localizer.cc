#include "carmap/localize/appearance_localizer.h"

#include <utility>

#include "carmap/feature/feature_grid.h"

namespace carmap {
namespace {

/// The word index knows keyframes by ids; the snapshot's own may come from several drives.
KeyframeId IdOf(uint32_t keyframe_idx) { return {{0}, keyframe_idx}; }

}  // namespace

AppearanceLocalizer::AppearanceLocalizer(const MapSnapshot& map, const Vocabulary& vocabulary,
                                         const AppearanceLocalizerOptions& options)
    : map_(map), vocabulary_(vocabulary), options_(options), words_(vocabulary.word_count()) {
  for (uint32_t k = 0; k < map.keyframes.size(); ++k) {
    std::vector<uint32_t> word_idxs;
    for (const uint32_t landmark_idx : map.keyframes[k].landmark_idxs) {
      word_idxs.push_back(vocabulary.WordOf(map.landmarks[landmark_idx].descriptor));
    }
    words_.Add(IdOf(k), HistogramOf(vocabulary, std::move(word_idxs)));
  }
}

std::vector<uint32_t> AppearanceLocalizer::Candidates(const std::vector<Feature>& features) const {
  std::vector<uint32_t> candidates;
  float most_similar = 0;
  for (const auto& [id, similarity] : words_.FindSimilar(HistogramOf(vocabulary_, features),
                                                         {.max_count = options_.max_candidates})) {
    if (candidates.empty()) most_similar = similarity;
    if (similarity >= options_.min_similarity * most_similar) candidates.push_back(id.index);
  }
  return candidates;
}

std::optional<TrackedPose> AppearanceLocalizer::Localize(const std::vector<Feature>& features,
                                                         const StereoRig& rig) const {
  const FeatureGrid grid(features, rig.camera.width, rig.camera.height);
  TrackingOptions tracking = options_.tracking;
  tracking.min_inliers = options_.min_inliers;
  for (const uint32_t keyframe_idx : Candidates(features)) {
    auto pose = TrackByAppearance(map_, map_.keyframes[keyframe_idx].landmark_idxs, grid, rig,
                                  tracking, /*seed=*/keyframe_idx + 1);
    if (pose) return pose;
  }
  return std::nullopt;
}

}  // namespace carmap
