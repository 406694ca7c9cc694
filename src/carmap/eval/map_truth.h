// Where true poses lie in a map by the map's own trajectory.
//
// A map is bent and scaled a little against the world, so an error against the truth is the map's
// and the localizer's together. The keyframes near a place tell how the map lies there; against the
// truth brought into the map by these, only the localizer's own error is left. Immutable,
// thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/kd_tree.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// A keyframe's pose by the map and by the truth.
struct TrueKeyframe {
  Rigid3 map_from_camera, world_from_camera;
};

/// The part of the map that these drives made: its keyframes, without landmarks. Drives that were
/// made in one world share clocks, so that times do not tell whose keyframe it is.
LeanMap KeyframesOf(const LeanMap& map, const std::vector<DriveId>& drives);

/// `map` holds keyframes of the drive whose truth it is (KeyframesOf). `truth` has time
/// stamps, ascending, of the clock of the keyframes; those within 0.02 s belong together. Keyframes
/// without a true pose are left out.
std::vector<TrueKeyframe> FindTrueKeyframes(const LeanMap& map, const Trajectory& truth);

/// FailedPrecondition unless there are at least three.
absl::Status CheckTrueKeyframes(const LeanMap& map, const std::vector<TrueKeyframe>& keyframes);

class MapTruth {
 public:
  /// Errors: as CheckTrueKeyframes.
  static absl::StatusOr<MapTruth> Create(const LeanMap& map, const Trajectory& truth);

  /// The pose in the map's frame (map_from_camera) of a camera whose true pose this is: by the
  /// rigid motion that brings the five keyframes truly nearest to where the map has them, their
  /// turns averaged and the means of their positions laid on each other.
  Rigid3 InMap(const Rigid3& world_from_camera) const;

 private:
  explicit MapTruth(std::vector<TrueKeyframe> keyframes);

  std::vector<TrueKeyframe> keyframes_;
  KdTree true_centers_;
};

struct PoseError {
  double position_m = 0, rotation_deg = 0;
};
/// Both poses map_from_camera or world_from_camera.
PoseError ErrorOf(const Rigid3& estimated, const Rigid3& truth);

/// Squared Mahalanobis distances between an estimated pose and the true one: if the covariance is
/// right, chi-square distributed with 3 (position) and 6 (pose) degrees of freedom.
struct NormalizedError {
  double position = 0, pose = 0;
};

/// 95 % of the values of chi-square with 3 degrees of freedom are not above it.
inline constexpr double kChiSquare95Of3 = 7.815;

/// `covariance` of the estimate in the tangent of Perturb on camera_from_map: metres, then radians,
/// both in the camera's frame. Infinite where it is not positive definite.
NormalizedError NormalizedErrorOf(const Rigid3& estimated_camera_from_map,
                                  const Eigen::Matrix<double, 6, 6>& covariance,
                                  const Rigid3& true_camera_from_map);

}  // namespace carmap
