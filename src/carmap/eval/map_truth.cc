#include "carmap/eval/map_truth.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

constexpr int64_t kMaxTimeDifferenceNs = 20'000'000;
constexpr size_t kMinKeyframes = 3, kNearKeyframes = 5;
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

std::vector<Eigen::Vector3d> TrueCenters(const std::vector<TrueKeyframe>& keyframes) {
  std::vector<Eigen::Vector3d> centers;
  for (const TrueKeyframe& keyframe : keyframes) {
    centers.push_back(keyframe.world_from_camera.translation);
  }
  return centers;
}

template <int size>
double SquaredMahalanobis(const Eigen::Matrix<double, size, 1>& error,
                          const Eigen::Matrix<double, size, size>& covariance) {
  const Eigen::LLT<Eigen::Matrix<double, size, size>> factor(covariance);
  if (factor.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  return error.dot(factor.solve(error));
}

}  // namespace

LeanMap KeyframesOf(const LeanMap& map, const std::vector<DriveId>& drives) {
  const auto is_of_them = [&](DriveId id) {
    return std::find(drives.begin(), drives.end(), id) != drives.end();
  };
  LeanMap part;
  std::copy_if(map.drives.begin(), map.drives.end(), std::back_inserter(part.drives),
               [&](const LeanDrive& drive) { return is_of_them(drive.id); });
  std::copy_if(map.keyframes.begin(), map.keyframes.end(), std::back_inserter(part.keyframes),
               [&](const LeanKeyframe& keyframe) { return is_of_them(keyframe.id.drive); });
  return part;
}

std::vector<TrueKeyframe> FindTrueKeyframes(const LeanMap& map, const Trajectory& truth) {
  std::vector<TrueKeyframe> keyframes;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    const std::optional<Rigid3> true_pose = TruePoseAt(truth, keyframe.timestamp);
    if (true_pose) keyframes.push_back({keyframe.map_from_camera, *true_pose});
  }
  return keyframes;
}

absl::Status CheckTrueKeyframes(const LeanMap& map, const std::vector<TrueKeyframe>& keyframes) {
  if (keyframes.size() >= kMinKeyframes) return absl::OkStatus();
  return absl::FailedPreconditionError(fmt::format(
      "of the map's {} keyframes {} have a time stamp of the ground truth, {} are needed; name "
      "the drive that the map was made from",
      map.keyframes.size(), keyframes.size(), kMinKeyframes));
}

MapTruth::MapTruth(std::vector<TrueKeyframe> keyframes)
    : keyframes_(std::move(keyframes)), true_centers_(TrueCenters(keyframes_)) {}

absl::StatusOr<MapTruth> MapTruth::Create(const LeanMap& map, const Trajectory& truth) {
  std::vector<TrueKeyframe> keyframes = FindTrueKeyframes(map, truth);
  CARMAP_RETURN_IF_ERROR(CheckTrueKeyframes(map, keyframes));
  return MapTruth(std::move(keyframes));
}

Rigid3 MapTruth::InMap(const Rigid3& world_from_camera) const {
  const auto nearest = true_centers_.Nearest(world_from_camera.translation, kNearKeyframes);
  Eigen::Matrix4d turns = Eigen::Matrix4d::Zero();
  Eigen::Vector3d mean_in_map = Eigen::Vector3d::Zero(), mean_in_world = Eigen::Vector3d::Zero();
  for (const uint32_t idx : nearest) {
    const auto& [in_map, in_world] = keyframes_[idx];
    const Eigen::Quaterniond map_from_world = in_map.rotation * in_world.rotation.conjugate();
    turns += map_from_world.coeffs() * map_from_world.coeffs().transpose();
    mean_in_map += in_map.translation / static_cast<double>(nearest.size());
    mean_in_world += in_world.translation / static_cast<double>(nearest.size());
  }
  // The mean of rotations in the sense of the chordal distance (Markley et al. 2007).
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(turns);
  const Eigen::Quaterniond map_from_world(Eigen::Vector4d(solver.eigenvectors().col(3)));
  return Rigid3{map_from_world, mean_in_map - map_from_world * mean_in_world} * world_from_camera;
}

PoseError ErrorOf(const Rigid3& estimated, const Rigid3& truth) {
  const Rigid3 error = truth.Inverse() * estimated;
  return {error.translation.norm(), kDegPerRad * RotationAngle(error.rotation)};
}

NormalizedError NormalizedErrorOf(const Rigid3& estimated_camera_from_map,
                                  const Eigen::Matrix<double, 6, 6>& covariance,
                                  const Rigid3& true_camera_from_map) {
  const Vector6d delta = PoseDifference(estimated_camera_from_map, true_camera_from_map);
  return {SquaredMahalanobis<3>(delta.head<3>(), covariance.topLeftCorner<3, 3>()),
          SquaredMahalanobis<6>(delta, covariance)};
}

}  // namespace carmap
