#include "carmap/format/alternatives.h"

#include <absl/status/status.h>

#include <string>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

constexpr uint32_t kNoLandmark = UINT32_MAX;

absl::Status CheckParts(const PlainMapContents& map) {
  const LeanMap& lean = *map.lean;
  const size_t keyframes = lean.keyframes.size();
  if (map.keyframe_features.size() != keyframes ||
      map.observed_feature_idxs.size() != lean.landmarks.size() ||
      (!map.feature_grids.empty() && map.feature_grids.size() != keyframes)) {
    return absl::InvalidArgumentError("parts of the complete map have unequal numbers of records");
  }
  for (const auto& features : map.keyframe_features) {
    if (features == nullptr) return absl::InvalidArgumentError("a keyframe has no feature list");
  }
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {
    const std::vector<uint32_t>& seen_by = lean.landmarks[i].keyframe_idxs;
    const std::vector<uint32_t>& features = map.observed_feature_idxs[i];
    if (features.size() != seen_by.size()) {
      return absl::InvalidArgumentError("a landmark has not one feature for each of its keyframes");
    }
    for (size_t j = 0; j < features.size(); ++j) {
      if (features[j] >= map.keyframe_features[seen_by[j]]->size()) {
        return absl::InvalidArgumentError(
            "a landmark is a feature that its keyframe does not have");
      }
    }
  }
  return absl::OkStatus();
}

template <typename Vector>
void AppendFloats(const Vector& values, std::string& out) {
  for (const auto value : values) AppendFloat(static_cast<float>(value), out);
}

void AppendDescriptor(const Descriptor& descriptor, std::string& out) {
  for (const uint64_t word : descriptor.words) AppendUint(word, out);
}

void AppendTable(const std::vector<uint32_t>& table, std::string& out) {
  AppendUint(static_cast<uint32_t>(table.size()), out);
  for (const uint32_t value : table) AppendUint(value, out);
}

void AppendKeyframes(const LeanMap& lean, std::string& out) {
  for (const LeanDrive& drive : lean.drives) {
    const PinholeCamera& camera = drive.rig.camera;
    AppendUint(drive.id.input, out);
    AppendUint(drive.id.options, out);
    for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy, drive.rig.baseline_m}) {
      AppendDouble(value, out);
    }
    for (const double value : drive.rig.disparity_bias.coefficients_px) AppendDouble(value, out);
    AppendUint(static_cast<uint32_t>(camera.width), out);
    AppendUint(static_cast<uint32_t>(camera.height), out);
  }
  for (const LeanKeyframe& keyframe : lean.keyframes) {
    AppendUint(keyframe.id.index, out);
    AppendUint(static_cast<uint64_t>(keyframe.timestamp.ns), out);
    AppendFloats(keyframe.map_from_camera.rotation.coeffs(), out);
    AppendFloats(keyframe.map_from_camera.translation, out);
    AppendUint(static_cast<uint8_t>(keyframe.gps ? 1 : 0), out);
    if (!keyframe.gps) continue;
    AppendDouble(keyframe.gps->latitude_deg, out);
    AppendDouble(keyframe.gps->longitude_deg, out);
    AppendDouble(keyframe.gps->altitude_m, out);
  }
}

/// (A)
void AppendMapFeatures(const LeanMap& lean, std::string& out) {
  for (const LeanLandmark& landmark : lean.landmarks) {
    AppendUint(landmark.id.index, out);
    AppendFloats(landmark.position_in_map, out);
    AppendDescriptor(landmark.descriptor, out);
    AppendUint(landmark.anchor_level, out);
  }
}

/// (B)
void AppendKeyframeFeatures(const PlainMapContents& map, std::string& out) {
  for (const auto& features : map.keyframe_features) {
    AppendUint(static_cast<uint32_t>(features->size()), out);
    for (const Feature& feature : *features) {
      AppendFloat(feature.x_px, out);
      AppendFloat(feature.y_px, out);
      AppendFloat(feature.disparity_px, out);
      AppendUint(feature.level, out);
      AppendDescriptor(feature.descriptor, out);
    }
  }
}

/// (C), from landmarks to keyframes and their features.
void AppendObservations(const PlainMapContents& map, std::string& out) {
  for (size_t i = 0; i < map.lean->landmarks.size(); ++i) {
    const std::vector<uint32_t>& seen_by = map.lean->landmarks[i].keyframe_idxs;
    AppendUint(static_cast<uint32_t>(seen_by.size()), out);
    for (size_t j = 0; j < seen_by.size(); ++j) {
      AppendUint(seen_by[j], out);
      AppendUint(map.observed_feature_idxs[i][j], out);
    }
  }
}

/// (C), from the features of each keyframe to landmarks.
void AppendLandmarkOfFeatures(const PlainMapContents& map, std::string& out) {
  std::vector<std::vector<uint32_t>> landmark_of(map.keyframe_features.size());
  for (size_t k = 0; k < landmark_of.size(); ++k) {
    landmark_of[k].assign(map.keyframe_features[k]->size(), kNoLandmark);
  }
  for (size_t i = 0; i < map.lean->landmarks.size(); ++i) {
    const std::vector<uint32_t>& seen_by = map.lean->landmarks[i].keyframe_idxs;
    for (size_t j = 0; j < seen_by.size(); ++j) {
      landmark_of[seen_by[j]][map.observed_feature_idxs[i][j]] = static_cast<uint32_t>(i);
    }
  }
  for (const std::vector<uint32_t>& landmarks : landmark_of) {
    for (const uint32_t landmark : landmarks) AppendUint(landmark, out);
  }
}

/// What is left of AppendLandmarkOfFeatures without the features.
void AppendLandmarksOfKeyframes(const LeanMap& lean, std::string& out) {
  std::vector<std::vector<uint32_t>> landmarks_of(lean.keyframes.size());
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {
    for (const uint32_t keyframe : lean.landmarks[i].keyframe_idxs) {
      landmarks_of[keyframe].push_back(static_cast<uint32_t>(i));
    }
  }
  for (const std::vector<uint32_t>& landmarks : landmarks_of) AppendTable(landmarks, out);
}

/// (D), what it has for keyframes and landmarks.
void AppendSearchTrees(const PlainMapContents& map, std::string& out) {
  for (const PlainKdTree* tree : {&map.keyframe_tree, &map.landmark_tree}) {
    AppendTable(tree->links, out);
    AppendUint(static_cast<uint32_t>(tree->splits.size()), out);
    AppendFloats(tree->splits, out);
  }
  AppendUint(static_cast<uint32_t>(map.covisibility.size()), out);
  for (const PlainCovisibility& edge : map.covisibility) {
    AppendUint(edge.a, out);
    AppendUint(edge.b, out);
    AppendUint(edge.weight, out);
  }
}

/// (D), what it has for keyframe features.
void AppendFeatureGrids(const PlainMapContents& map, std::string& out) {
  for (const PlainFeatureGrid& grid : map.feature_grids) {
    AppendTable(grid.cell_begins, out);
    AppendTable(grid.feature_idxs, out);
  }
}

std::string SerializeFull(const PlainMapContents& map) {
  std::string out;
  AppendKeyframes(*map.lean, out);
  AppendMapFeatures(*map.lean, out);
  AppendKeyframeFeatures(map, out);
  AppendObservations(map, out);
  AppendLandmarkOfFeatures(map, out);
  AppendSearchTrees(map, out);
  AppendFeatureGrids(map, out);
  return out;
}

std::string SerializeWithoutIndex(const PlainMapContents& map) {
  std::string out;
  AppendKeyframes(*map.lean, out);
  AppendMapFeatures(*map.lean, out);
  AppendKeyframeFeatures(map, out);
  AppendObservations(map, out);
  return out;
}

std::string SerializeWithoutKeyframeFeatures(const PlainMapContents& map) {
  std::string out;
  AppendKeyframes(*map.lean, out);
  AppendMapFeatures(*map.lean, out);
  AppendObservations(map, out);
  AppendLandmarksOfKeyframes(*map.lean, out);
  AppendSearchTrees(map, out);
  return out;
}

}  // namespace

absl::StatusOr<CompositionBytes> MeasureComposition(const PlainMapContents& map) {
  CARMAP_ASSIGN_OR_RETURN(const std::string lean, EncodeLeanMap(*map.lean));
  CARMAP_RETURN_IF_ERROR(CheckParts(map));
  return CompositionBytes{SerializeFull(map).size(), SerializeWithoutIndex(map).size(),
                          SerializeWithoutKeyframeFeatures(map).size(), lean.size()};
}

}  // namespace carmap
