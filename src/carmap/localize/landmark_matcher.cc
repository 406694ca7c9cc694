#include "carmap/localize/landmark_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "carmap/feature/twins.h"

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

/// A feature that may be the landmark.
struct Candidate {
  uint32_t feature_idx = kNone;
  int bits = std::numeric_limits<int>::max();
};

/// The candidate that resembles the landmark most, if none at another place resembles it nearly as
/// much: the same corner found at another level is no rival.
std::optional<Candidate> ClearlyBest(const std::vector<Candidate>& candidates,
                                     const std::vector<Feature>& features, int max_bits,
                                     double max_ratio) {
  const auto best =
      std::min_element(candidates.begin(), candidates.end(),
                       [](const Candidate& a, const Candidate& b) { return a.bits < b.bits; });
  if (best == candidates.end() || best->bits > max_bits) return std::nullopt;
  const Feature& feature = features[best->feature_idx];
  for (const Candidate& other : candidates) {
    if (best->bits < max_ratio * other.bits) continue;
    const Feature& rival = features[other.feature_idx];
    const double place_px = TwinRadiusPx(std::max(feature.level, rival.level));
    if (std::abs(feature.x_px - rival.x_px) > place_px ||
        std::abs(feature.y_px - rival.y_px) > place_px) {
      return std::nullopt;
    }
  }
  return *best;
}

/// Features around the projection, at about its level and with a disparity that agrees.
void SearchWindow(const SnapshotLandmark& landmark, const Projection& projection,
                  const StereoRig& rig, const FeatureGrid& grid,
                  const ProjectionMatchOptions& options, std::vector<Candidate>& candidates) {
  candidates.clear();
  const double level = std::clamp<double>(projection.level, 0, kLevelCount - 1);
  const double px_per_m = projection.uvd.z() / rig.baseline_m;  // at the landmark's distance
  const double radius =
      options.radius_px * std::pow(kLevelScale, level) + options.position_radius_m * px_per_m;
  grid.VisitNear(projection.uvd.x(), projection.uvd.y(), radius, [&](uint32_t feature_idx) {
    const Feature& feature = grid.features()[feature_idx];
    if (std::abs(feature.level - level) > options.max_level_difference) return;
    if (feature.has_disparity() && std::abs(feature.disparity_px - projection.uvd.z()) > radius)
      return;
    candidates.push_back({feature_idx, HammingDistance(landmark.descriptor, feature.descriptor)});
  });
}

/// Gives each corner of the frame to the landmark nearest in appearance.
class Assignment {
 public:
  explicit Assignment(const std::vector<Feature>& features)
      : features_(features), of_corner_(features.size()) {}

  void Offer(uint32_t landmark_idx, const Candidate& candidate) {
    Match& match = of_corner_[CornerOf(features_, candidate.feature_idx)];
    if (candidate.bits < match.feature.bits) match = {landmark_idx, candidate};
  }
  std::vector<LandmarkMatch> Matches() const {
    std::vector<LandmarkMatch> matches;
    for (const Match& match : of_corner_) {
      if (match.feature.feature_idx != kNone)
        matches.push_back({match.landmark_idx, match.feature.feature_idx});
    }
    return matches;
  }

 private:
  struct Match {
    uint32_t landmark_idx = kNone;
    Candidate feature;
  };
  const std::vector<Feature>& features_;
  std::vector<Match> of_corner_;
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
  Assignment assignment(grid.features());
  std::vector<Candidate> candidates;
  for (const uint32_t landmark_idx : landmark_idxs) {
    const SnapshotLandmark& landmark = map.landmarks[landmark_idx];
    const auto projection = Project(landmark, rig, camera_from_map, center_in_map, min_cosine);
    if (!projection) continue;
    SearchWindow(landmark, *projection, rig, grid, options, candidates);
    const auto best =
        ClearlyBest(candidates, grid.features(), options.max_distance_bits, options.max_ratio);
    if (best) assignment.Offer(landmark_idx, *best);
  }
  return assignment.Matches();
}

std::vector<LandmarkMatch> MatchByAppearance(const MapSnapshot& map,
                                             const std::vector<uint32_t>& landmark_idxs,
                                             const std::vector<Feature>& features,
                                             const AppearanceMatchOptions& options) {
  Assignment assignment(features);
  std::vector<Candidate> candidates(features.size());
  for (const uint32_t landmark_idx : landmark_idxs) {
    const Descriptor& descriptor = map.landmarks[landmark_idx].descriptor;
    for (uint32_t i = 0; i < features.size(); ++i) {
      candidates[i] = {i, HammingDistance(descriptor, features[i].descriptor)};
    }
    const auto best =
        ClearlyBest(candidates, features, options.max_distance_bits, options.max_ratio);
    if (best) assignment.Offer(landmark_idx, *best);
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
