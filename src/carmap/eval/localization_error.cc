#include "carmap/eval/localization_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "carmap/solve/alignment.h"

namespace carmap {
namespace {

constexpr int64_t kMaxTimeDifferenceNs = 20'000'000;
constexpr size_t kMinKeyframes = 3;
constexpr double kDegPerRad = 180 / M_PI;

/// A pose as points: its position and the tips of its axes. Mapping knows positions to centimetres
/// and orientations to some milliradians, so a tip this far away is about as good a point as the
/// position. Positions alone would leave the turn about a straight road to their noise.
void AppendPoints(const Rigid3& pose, std::vector<Eigen::Vector3d>& points) {
  constexpr double kAxisLengthM = 5;
  points.push_back(pose.translation);
  for (int axis = 0; axis < 3; ++axis) {
    points.push_back(pose * (kAxisLengthM * Eigen::Vector3d::Unit(axis)));
  }
}

std::optional<Rigid3> TruePoseAt(const Trajectory& truth, Timestamp time) {
  const auto after =
      std::lower_bound(truth.begin(), truth.end(), time,
                       [](const TimedPose& pose, Timestamp t) { return pose.timestamp < t; });
  const TimedPose* nearest = nullptr;
  int64_t least_ns = kMaxTimeDifferenceNs + 1;
  for (const auto pose : {after - (after == truth.begin() ? 0 : 1), after}) {
    if (pose == truth.end() || !pose->timestamp) continue;
    const int64_t difference_ns = std::abs(pose->timestamp->ns - time.ns);
    if (difference_ns < least_ns) {
      least_ns = difference_ns;
      nearest = &*pose;
    }
  }
  return nearest ? nearest->world_from_camera : std::nullopt;
}

}  // namespace

absl::StatusOr<MapAlignment> AlignMapToTruth(const LeanMap& map, const Trajectory& truth) {
  std::vector<Eigen::Vector3d> points_in_map, points_in_world;
  MapAlignment alignment;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    const std::optional<Rigid3> true_pose = TruePoseAt(truth, keyframe.timestamp);
    if (!true_pose) continue;
    ++alignment.keyframes;
    AppendPoints(keyframe.map_from_camera, points_in_map);
    AppendPoints(*true_pose, points_in_world);
  }
  const auto world_from_map = AlignRigidly(points_in_map, points_in_world);
  if (alignment.keyframes < kMinKeyframes || !world_from_map) {
    return absl::FailedPreconditionError(fmt::format(
        "of the map's {} keyframes {} have a time stamp of the ground truth, {} are needed; name "
        "the drive that the map was made from",
        map.keyframes.size(), alignment.keyframes, kMinKeyframes));
  }
  alignment.world_from_map = *world_from_map;
  const size_t points_per_pose = points_in_map.size() / alignment.keyframes;
  double sum_of_squares = 0;
  for (size_t i = 0; i < points_in_map.size(); i += points_per_pose) {
    sum_of_squares += (*world_from_map * points_in_map[i] - points_in_world[i]).squaredNorm();
  }
  alignment.rmse_m = std::sqrt(sum_of_squares / static_cast<double>(alignment.keyframes));
  return alignment;
}

LocalizationError EvaluateLocalization(const Trajectory& map_from_camera, const Trajectory& truth,
                                       const Rigid3& world_from_map) {
  std::vector<double> position_m, rotation_deg;
  for (size_t i = 0; i < std::min(map_from_camera.size(), truth.size()); ++i) {
    if (!map_from_camera[i].world_from_camera || !truth[i].world_from_camera) continue;
    const Rigid3 estimated = world_from_map * *map_from_camera[i].world_from_camera;
    const Rigid3 error = truth[i].world_from_camera->Inverse() * estimated;
    position_m.push_back(error.translation.norm());
    rotation_deg.push_back(kDegPerRad * RotationAngle(error.rotation));
  }
  const size_t frames = position_m.size();
  return {frames, Summarize(std::move(position_m)), Summarize(std::move(rotation_deg))};
}

}  // namespace carmap
