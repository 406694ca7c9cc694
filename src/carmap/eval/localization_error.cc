#include "carmap/eval/localization_error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/eval/map_truth.h"
#include "carmap/solve/alignment.h"

namespace carmap {

absl::StatusOr<MapAlignment> AlignMapToTruth(const LeanMap& map, const Trajectory& truth) {
  const std::vector<TrueKeyframe> keyframes = FindTrueKeyframes(map, truth);
  CARMAP_RETURN_IF_ERROR(CheckTrueKeyframes(map, keyframes));
  std::vector<Rigid3> in_map, in_world;
  for (const TrueKeyframe& keyframe : keyframes) {
    in_map.push_back(keyframe.map_from_camera);
    in_world.push_back(keyframe.world_from_camera);
  }
  const std::optional<Rigid3> world_from_map = AlignTrajectories(in_map, in_world);
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
    const PoseError error =
        ErrorOf(world_from_map * *map_from_camera[i].world_from_camera, *true_pose);
    errors.back() = {path_m, error.position_m, error.rotation_deg};
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
