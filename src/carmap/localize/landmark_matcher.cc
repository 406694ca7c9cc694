#include "carmap/localize/landmark_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace carmap {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
// A landmark stays recognisable a little beyond the distances it was seen from: the pyramid covers
// a range of scales, of which the mapping drive used a part.
constexpr double kDistanceSlack = 2.0;

struct Projection {
  Eigen::Vector3d uvd;
  float level;
};

/// Where and at which level the camera must see the landmark; nothing if it cannot.
std::optional<Projection> Project(const SnapshotLandmark& landmark, const StereoRig& rig,
                                  const Rigid3& camera_from_map,
                                  const Eigen::Vector3d& center_in_map, double min_cosine) {
  const Eigen::Vector3d p_in_camera = camera_from_map * landmark.position_in_map;
  if (p_in_camera.z() < 0.1) return std::nullopt;
  const Eigen::Vector3d uvd = rig.Project(p_in_camera);
  if (!rig.camera.Contains(uvd.head<2>())) return std::nullopt;

  const Eigen::Vector3d to_viewer = center_in_map - landmark.position_in_map;
  const double distance = to_viewer.norm();
  if (distance * kDistanceSlack < landmark.min_distance_m ||
      distance > kDistanceSlack * landmark.max_distance_m ||
      to_viewer.dot(landmark.direction_to_viewers.cast<double>()) < min_cosine * distance) {
    return std::nullopt;
  }
  return Projection{uvd, PredictLevel(landmark, distance)};
}

struct BestTwo {
  int best = std::numeric_limits<int>::max(), second = std::numeric_limits<int>::max();
  uint32_t best_idx = kNone;

  void Offer(uint32_t idx, int distance) {
    if (distance < best) {
      second = best;
      best = distance;
      best_idx = idx;
    } else if (distance < second) {
      second = distance;
    }
  }
  bool IsClear(int max_distance, double max_ratio) const {
    return best <= max_distance && best < max_ratio * second;
  }
};

BestTwo SearchWindow(const SnapshotLandmark& landmark, const Projection& projection,
                     const FeatureGrid& grid, const ProjectionMatchOptions& options) {
  const double level = std::clamp<double>(projection.level, 0, kLevelCount - 1);
  const double radius = options.radius_px * std::pow(kLevelScale, level);
  BestTwo found;
  grid.VisitNear(projection.uvd.x(), projection.uvd.y(), radius, [&](uint32_t feature_idx) {
    const Feature& feature = grid.features()[feature_idx];
    if (std::abs(feature.level - level) > options.max_level_difference) return;
    if (feature.has_disparity() && std::abs(feature.disparity_px - projection.uvd.z()) > radius)
      return;
    found.Offer(feature_idx, HammingDistance(landmark.descriptor, feature.descriptor));
  });
  return found;
}

/// Gives each feature to the landmark nearest in appearance.
class Assignment {
 public:
  explicit Assignment(size_t feature_count)
      : landmark_of_(feature_count, kNone), distance_of_(feature_count, 0) {}

  void Offer(uint32_t landmark_idx, uint32_t feature_idx, int distance) {
    if (landmark_of_[feature_idx] == kNone || distance < distance_of_[feature_idx]) {
      landmark_of_[feature_idx] = landmark_idx;
      distance_of_[feature_idx] = distance;
    }
  }
  std::vector<LandmarkMatch> Matches() const {
    std::vector<LandmarkMatch> matches;
    for (uint32_t i = 0; i < landmark_of_.size(); ++i) {
      if (landmark_of_[i] != kNone) matches.push_back({landmark_of_[i], i});
    }
    return matches;
  }

 private:
  std::vector<uint32_t> landmark_of_;
  std::vector<int> distance_of_;
};

}  // namespace

bool IsInSight(const SnapshotLandmark& landmark, const StereoRig& rig,
               const Rigid3& camera_from_map, const ProjectionMatchOptions& options) {
  return Project(landmark, rig, camera_from_map, camera_from_map.Inverse().translation,
                 std::cos(options.max_viewing_angle_rad))
      .has_value();
}

std::vector<LandmarkMatch> MatchByProjection(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const FeatureGrid& grid, const StereoRig& rig,
                                             const Rigid3& camera_from_map,
                                             const ProjectionMatchOptions& options) {
  const Eigen::Vector3d center_in_map = camera_from_map.Inverse().translation;
  const double min_cosine = std::cos(options.max_viewing_angle_rad);
  Assignment assignment(grid.features().size());
  for (const uint32_t landmark_idx : landmark_idxs) {
    const SnapshotLandmark& landmark = map.landmarks[landmark_idx];
    const auto projection = Project(landmark, rig, camera_from_map, center_in_map, min_cosine);
    if (!projection) continue;
    const BestTwo found = SearchWindow(landmark, *projection, grid, options);
    if (found.IsClear(options.max_distance_bits, options.max_ratio)) {
      assignment.Offer(landmark_idx, found.best_idx, found.best);
    }
  }
  return assignment.Matches();
}

std::vector<LandmarkMatch> MatchByAppearance(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const std::vector<Feature>& features,
                                             const AppearanceMatchOptions& options) {
  Assignment assignment(features.size());
  for (const uint32_t landmark_idx : landmark_idxs) {
    const Descriptor& descriptor = map.landmarks[landmark_idx].descriptor;
    BestTwo found;
    for (uint32_t i = 0; i < features.size(); ++i) {
      found.Offer(i, HammingDistance(descriptor, features[i].descriptor));
    }
    if (found.IsClear(options.max_distance_bits, options.max_ratio)) {
      assignment.Offer(landmark_idx, found.best_idx, found.best);
    }
  }
  return assignment.Matches();
}

std::vector<PoseMeasurement> MeasurementsOf(const MapSnapshot& map,
                                            const std::vector<Feature>& features,
                                            const StereoRig& rig,
                                            const std::vector<LandmarkMatch>& matches) {
  std::vector<PoseMeasurement> measurements;
  measurements.reserve(matches.size());
  for (const auto& [landmark_idx, feature_idx] : matches) {
    const Feature& feature = features[feature_idx];
    measurements.push_back(
        {.position_in_map = map.landmarks[landmark_idx].position_in_map,
         .px = {feature.x_px, feature.y_px},
         .disparity_px = feature.has_disparity()
                             ? rig.WithoutBias(feature.x_px, feature.disparity_px)
                             : Feature::kNoDisparity,
         .scale = ScaleOfLevel(feature.level)});
  }
  return measurements;
}

}  // namespace carmap
