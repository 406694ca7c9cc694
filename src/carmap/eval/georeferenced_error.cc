#include "carmap/eval/georeferenced_error.h"

#include "carmap/base/status_macros.h"
#include "carmap/eval/trajectory_metrics.h"

namespace carmap {

absl::StatusOr<std::vector<double>> GeoreferencedErrorsM(const Trajectory& estimate,
                                                         const Rigid3& enu_from_estimate,
                                                         const GpsFix& origin,
                                                         const Trajectory& truth,
                                                         const GpsFix& truth_origin) {
  CARMAP_ASSIGN_OR_RETURN(const MatchedTrajectory matched, MatchTrajectories(estimate, truth));
  const LocalEnu enu(origin), truth_enu(truth_origin);
  std::vector<double> errors_m;
  errors_m.reserve(matched.poses.size());
  for (const MatchedPose& pose : matched.poses) {
    const GpsFix place = enu.ToGps((enu_from_estimate * pose.estimate_from_camera).translation);
    const Eigen::Vector3d error = truth_enu.FromGps(place) - pose.truth_from_camera.translation;
    errors_m.push_back(error.head<2>().norm());
  }
  return errors_m;
}

}  // namespace carmap
