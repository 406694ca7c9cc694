#include "carmap/eval/localization_error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "carmap/solve/alignment.h"

namespace carmap {
namespace {

constexpr int64_t kMaxTimeDifferenceNs = 20'000'000;
constexpr size_t kMinKeyframes = 3;
constexpr double kDegPerRad = 180 / M_PI;

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
  std::vector<Rigid3> in_map, in_world;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    const std::optional<Rigid3> true_pose = TruePoseAt(truth, keyframe.timestamp);
    if (!true_pose) continue;
    in_map.push_back(keyframe.map_from_camera);
    in_world.push_back(*true_pose);
  }
  const std::optional<Rigid3> world_from_map =
      in_map.size() < kMinKeyframes ? std::nullopt : AlignTrajectories(in_map, in_world);
  if (!world_from_map) {
    return absl::FailedPreconditionError(fmt::format(
        "of the map's {} keyframes {} have a time stamp of the ground truth, {} are needed; name "
        "the drive that the map was made from",
        map.keyframes.size(), in_map.size(), kMinKeyframes));
  }
  double sum_of_squares = 0;
  for (size_t i = 0; i < in_map.size(); ++i) {
    const Eigen::Vector3d aligned = *world_from_map * in_map[i].translation;
    sum_of_squares += (aligned - in_world[i].translation).squaredNorm();
  }
  return MapAlignment{*world_from_map, in_map.size(),
                      std::sqrt(sum_of_squares / static_cast<double>(in_map.size()))};
}

std::vector<FrameError> LocalizationErrors(const Trajectory& map_from_camera,
                                           const Trajectory& truth, const Rigid3& world_from_map) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  std::vector<FrameError> errors;
  double path_m = 0;
  std::optional<Eigen::Vector3d> last;
  for (size_t i = 0; i < std::min(map_from_camera.size(), truth.size()); ++i) {
    const std::optional<Rigid3>& true_pose = truth[i].world_from_camera;
    if (true_pose) {
      if (last) path_m += (true_pose->translation - *last).norm();
      last = true_pose->translation;
    }
    errors.push_back({path_m, kNone, kNone});
    if (!map_from_camera[i].world_from_camera || !true_pose) continue;
    const Rigid3 estimated = world_from_map * *map_from_camera[i].world_from_camera;
    const Rigid3 error = true_pose->Inverse() * estimated;
    errors.back() = {path_m, error.translation.norm(), kDegPerRad * RotationAngle(error.rotation)};
  }
  return errors;
}

LocalizationError EvaluateLocalization(const Trajectory& map_from_camera, const Trajectory& truth,
                                       const Rigid3& world_from_map) {
  std::vector<double> position_m, rotation_deg;
  for (const FrameError& error : LocalizationErrors(map_from_camera, truth, world_from_map)) {
    if (std::isnan(error.position_m)) continue;
    position_m.push_back(error.position_m);
    rotation_deg.push_back(error.rotation_deg);
  }
  const size_t frames = position_m.size();
  return {frames, Summarize(std::move(position_m)), Summarize(std::move(rotation_deg))};
}

}  // namespace carmap
