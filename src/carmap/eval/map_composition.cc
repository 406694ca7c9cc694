#include "carmap/eval/map_composition.h"

#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/feature/feature_grid.h"
#include "carmap/index/kd_tree.h"
#include "carmap/index/reconstruct.h"

namespace carmap {
namespace {

PlainKdTree PlainTree(const KdTree& tree) {
  KdTreeTables tables = tree.Tables();
  return {std::move(tables.links), std::move(tables.splits)};
}

std::vector<PlainCovisibility> PlainCovisibilityOf(const ReconstructedMap& map) {
  std::vector<PlainCovisibility> edges;
  for (uint32_t a = 0; a < map.covisible().size(); ++a) {
    for (const CovisibleKeyframe& b : map.covisible()[a]) {
      if (a < b.keyframe_idx) edges.push_back({a, b.keyframe_idx, b.shared_landmarks});
    }
  }
  return edges;
}

/// Which feature each landmark of the lean map is in each of its keyframes.
std::vector<std::vector<uint32_t>> ObservedFeatures(const Map& map, const StrippedMap& stripped) {
  std::vector<std::vector<uint32_t>> feature_idxs;
  for (const LandmarkId source : stripped.sources) {
    std::vector<uint32_t>& of_landmark = feature_idxs.emplace_back();
    for (const Observation& observation : map.Find(source)->observations) {
      of_landmark.push_back(static_cast<uint32_t>(observation.feature_idx));
    }
  }
  return feature_idxs;
}

}  // namespace

absl::StatusOr<CompositionBytes> MeasureComposition(const Map& map, const StrippedMap& stripped) {
  const LeanMap& lean = stripped.lean;
  const ReconstructedMap reconstructed = Reconstruct(lean);
  PlainMapContents contents;
  contents.lean = &lean;
  for (uint32_t i = 0; i < lean.keyframes.size(); ++i) {
    const Keyframe& keyframe = *map.Find(lean.keyframes[i].id);
    const PinholeCamera& camera = RigOf(reconstructed, i).camera;
    const FeatureGrid grid(*keyframe.features, camera.width, camera.height);
    contents.keyframe_features.push_back(keyframe.features);
    contents.feature_grids.push_back({grid.cell_begins(), grid.feature_idxs()});
  }
  contents.observed_feature_idxs = ObservedFeatures(map, stripped);
  contents.keyframe_tree = PlainTree(reconstructed.keyframe_centers);
  contents.landmark_tree = PlainTree(reconstructed.landmark_positions());
  contents.covisibility = PlainCovisibilityOf(reconstructed);
  return MeasureComposition(contents);
}

}  // namespace carmap
