#include "carmap/map/map_snapshot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace carmap {
namespace {

const double kInverseLogScale = 1 / std::log(kLevelScale);

}  // namespace

std::vector<uint32_t> AllLandmarks(const MapSnapshot& map) {
  std::vector<uint32_t> idxs(map.landmarks.size());
  std::iota(idxs.begin(), idxs.end(), 0u);
  return idxs;
}

float PredictLevel(const SnapshotLandmark& landmark, double distance_m) {
  return landmark.level_at_1m - static_cast<float>(std::log(distance_m) * kInverseLogScale);
}

void DeriveVisibility(const std::vector<Eigen::Vector3d>& viewers_in_map,
                      const Eigen::Vector3d& anchor_in_map, int level, SnapshotLandmark& landmark) {
  double min_distance = std::numeric_limits<double>::infinity(), max_distance = 0;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& viewer : viewers_in_map) {
    const Eigen::Vector3d to_viewer = viewer - landmark.position_in_map;
    const double distance = std::max(to_viewer.norm(), 1e-3);
    direction += to_viewer / distance;
    min_distance = std::min(min_distance, distance);
    max_distance = std::max(max_distance, distance);
  }
  landmark.direction_to_viewers = direction.normalized().cast<float>();
  landmark.min_distance_m = static_cast<float>(min_distance);
  landmark.max_distance_m = static_cast<float>(max_distance);
  const double anchor_distance = std::max((anchor_in_map - landmark.position_in_map).norm(), 1e-3);
  landmark.level_at_1m = static_cast<float>(level + std::log(anchor_distance) * kInverseLogScale);
}

MapSnapshot SnapshotOf(const Map& map, const std::vector<KeyframeId>& keyframe_ids) {
  std::vector<LandmarkId> landmark_ids;
  for (const KeyframeId& id : keyframe_ids) {
    for (const auto& link : map.LandmarksOf(id)) {
      if (link) landmark_ids.push_back(*link);
    }
  }
  std::sort(landmark_ids.begin(), landmark_ids.end());
  landmark_ids.erase(std::unique(landmark_ids.begin(), landmark_ids.end()), landmark_ids.end());
  std::erase_if(landmark_ids, [&](LandmarkId id) { return map.Find(id)->is_non_static(); });

  MapSnapshot snapshot{.version = map.version(), .keyframes = {}, .landmarks = {}};
  snapshot.landmarks.reserve(landmark_ids.size());
  std::vector<Eigen::Vector3d> viewers_in_map;
  for (const LandmarkId& id : landmark_ids) {
    const Landmark& landmark = *map.Find(id);
    viewers_in_map.clear();
    for (const Observation& observation : landmark.observations) {
      viewers_in_map.push_back(map.Find(observation.keyframe_id)->map_from_camera.translation);
    }
    const Observation& first = landmark.observations.front();
    snapshot.landmarks.push_back(
        {.id = id, .position_in_map = landmark.position_in_map, .descriptor = landmark.descriptor});
    DeriveVisibility(viewers_in_map, viewers_in_map.front(),
                     (*map.Find(first.keyframe_id)->features)[first.feature_idx].level,
                     snapshot.landmarks.back());
  }
  for (const KeyframeId& id : keyframe_ids) {
    const Keyframe& keyframe = *map.Find(id);
    SnapshotKeyframe& copy = snapshot.keyframes.emplace_back(
        SnapshotKeyframe{id, keyframe.timestamp, keyframe.map_from_camera, keyframe.gps, {}});
    for (const auto& link : map.LandmarksOf(id)) {
      if (!link) continue;
      const auto place = std::lower_bound(landmark_ids.begin(), landmark_ids.end(), *link);
      if (place == landmark_ids.end() || *place != *link) continue;
      copy.landmark_idxs.push_back(static_cast<uint32_t>(place - landmark_ids.begin()));
    }
    std::sort(copy.landmark_idxs.begin(), copy.landmark_idxs.end());
  }
  return snapshot;
}

}  // namespace carmap
