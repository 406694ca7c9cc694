#include "carmap/eval/true_matches.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "carmap/localize/frame_tracking.h"
#include "carmap/map/map_snapshot.h"

namespace carmap {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
/// The descriptor's patch, which the extractor keeps inside the image, and a little more.
constexpr double kMarginPx = 18;

Eigen::Vector3d PositionInCamera(const Feature& feature, const StereoRig& rig) {
  return rig.Triangulate({feature.x_px, feature.y_px},
                         rig.WithoutBias(feature.x_px, feature.disparity_px));
}

bool HasDepth(const Feature& feature, const StereoRig& rig) {
  return feature.has_disparity() && rig.WithoutBias(feature.x_px, feature.disparity_px) > 0;
}

/// The features with depth as a map in the camera's frame.
MapSnapshot MapOf(const std::vector<Feature>& features, const StereoRig& rig) {
  MapSnapshot map;
  for (const Feature& feature : features) {
    if (!HasDepth(feature, rig)) continue;
    SnapshotLandmark& landmark = map.landmarks.emplace_back();
    landmark.position_in_map = PositionInCamera(feature, rig);
    landmark.descriptor = feature.descriptor;
    DeriveVisibility({Eigen::Vector3d::Zero()}, Eigen::Vector3d::Zero(), feature.level, landmark);
  }
  return map;
}

bool IsWellInside(const Eigen::Vector3d& uvd, double scale, const PinholeCamera& camera) {
  const double margin = kMarginPx * scale;
  return uvd.x() >= margin && uvd.y() >= margin && uvd.x() <= camera.width - 1 - margin &&
         uvd.y() <= camera.height - 1 - margin;
}

bool IsLevelNear(const Feature& feature, const PredictedFeature& prediction,
                 const TrueMatchOptions& options) {
  return std::abs(feature.level - prediction.level) <= options.max_level_difference;
}

struct Nearest {
  uint32_t idx = kNone;
  double distance_px = std::numeric_limits<double>::infinity();
};

Nearest FindNearest(const PredictedFeature& prediction, const FeatureGrid& to, const StereoRig& rig,
                    const TrueMatchOptions& options) {
  const double scale = std::pow(kLevelScale, prediction.level);
  const double radius_px = options.max_distance_px * scale;
  Nearest nearest;
  to.VisitNear(prediction.uvd.x(), prediction.uvd.y(), radius_px, [&](uint32_t idx) {
    const Feature& feature = to.features()[idx];
    if (!HasDepth(feature, rig) || !IsLevelNear(feature, prediction, options)) return;
    const double disparity = rig.WithoutBias(feature.x_px, feature.disparity_px);
    if (std::abs(disparity - prediction.uvd.z()) > radius_px) return;
    const double distance_px =
        std::hypot(feature.x_px - prediction.uvd.x(), feature.y_px - prediction.uvd.y()) / scale;
    if (distance_px <= options.max_distance_px && distance_px < nearest.distance_px) {
      nearest = {idx, distance_px};
    }
  });
  return nearest;
}

}  // namespace

std::optional<Rigid3> EstimateMotion(const std::vector<Feature>& from,
                                     const std::vector<Feature>& to, const StereoRig& rig) {
  const MapSnapshot map = MapOf(from, rig);
  const FeatureGrid grid(to, rig.camera.width, rig.camera.height);
  const auto pose =
      TrackByAppearance(map, AllLandmarks(map), grid, rig, TrackingOptions(), /*seed=*/1);
  if (!pose) return std::nullopt;
  return pose->camera_from_map;
}

std::vector<PredictedFeature> PredictFeatures(const std::vector<Feature>& from,
                                              const Rigid3& to_from_from, const StereoRig& rig) {
  constexpr double kMinDepthM = 0.1;
  std::vector<PredictedFeature> predictions;
  for (uint32_t i = 0; i < from.size(); ++i) {
    if (!HasDepth(from[i], rig)) continue;
    const Eigen::Vector3d p_in_from = PositionInCamera(from[i], rig);
    const Eigen::Vector3d p_in_to = to_from_from * p_in_from;
    if (p_in_to.z() < kMinDepthM) continue;
    // What comes nearer grows.
    const double level =
        from[i].level + std::log(p_in_from.norm() / p_in_to.norm()) / std::log(kLevelScale);
    const PredictedFeature prediction{i, rig.Project(p_in_to), level};
    if (level > -0.5 && level < kLevelCount - 0.5 &&
        IsWellInside(prediction.uvd, std::pow(kLevelScale, level), rig.camera)) {
      predictions.push_back(prediction);
    }
  }
  return predictions;
}

std::vector<TrueMatch> FindTrueMatches(const std::vector<PredictedFeature>& predictions,
                                       const FeatureGrid& to, const StereoRig& rig,
                                       const TrueMatchOptions& options) {
  std::vector<TrueMatch> nearest_of(to.features().size(), {.prediction_idx = kNone});
  for (uint32_t i = 0; i < predictions.size(); ++i) {
    const Nearest nearest = FindNearest(predictions[i], to, rig, options);
    if (nearest.idx == kNone) continue;
    TrueMatch& taken = nearest_of[nearest.idx];
    if (taken.prediction_idx == kNone || nearest.distance_px < taken.distance_px) {
      taken = {i, nearest.idx, nearest.distance_px};
    }
  }
  std::erase_if(nearest_of, [](const TrueMatch& match) { return match.prediction_idx == kNone; });
  std::sort(nearest_of.begin(), nearest_of.end(), [](const TrueMatch& a, const TrueMatch& b) {
    return a.prediction_idx < b.prediction_idx;
  });
  return nearest_of;
}

bool IsAmbiguous(const Descriptor& descriptor, const PredictedFeature& prediction,
                 const TrueMatch& match, const FeatureGrid& to, double window_px,
                 const TrueMatchOptions& options) {
  constexpr double kMaxRatio = 1.25;
  constexpr int kMaxMoreBits = 2;
  const Feature& truth = to.features()[match.feature_idx];
  const int true_distance = HammingDistance(descriptor, truth.descriptor);
  const double same_place_px = options.max_distance_px * ScaleOfLevel(truth.level);
  bool is_ambiguous = false;
  to.VisitNear(prediction.uvd.x(), prediction.uvd.y(), window_px, [&](uint32_t idx) {
    const Feature& other = to.features()[idx];
    if (is_ambiguous || !IsLevelNear(other, prediction, options) ||
        std::hypot(other.x_px - truth.x_px, other.y_px - truth.y_px) <= same_place_px) {
      return;
    }
    const int distance = HammingDistance(descriptor, other.descriptor);
    is_ambiguous =
        distance <= std::max(kMaxRatio * true_distance, 1.0 * true_distance + kMaxMoreBits);
  });
  return is_ambiguous;
}

}  // namespace carmap
