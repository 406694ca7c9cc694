#include "carmap/localize/landmark_shift.h"

#include "carmap/solve/reprojection.h"

namespace carmap {

LandmarkShift ShiftOf(const SnapshotLandmark& landmark, const StereoRig& rig,
                      const Rigid3& camera_from_map, const MeasurementNoise& noise) {
  const Eigen::Vector3d p = camera_from_map * landmark.position_in_map;
  if (p.z() <= 0) return {};
  const double seen_from_m = landmark.min_distance_m;
  const double across_m = noise.pixel_px * seen_from_m / rig.camera.fx;
  const double along_m_per_px = seen_from_m * seen_from_m / (rig.camera.fx * rig.baseline_m);
  const Eigen::Matrix3d jacobian = StereoProjectionJacobian(rig, p);
  LandmarkShift shift;
  shift.along = jacobian *
                (camera_from_map.rotation * landmark.direction_to_viewers.cast<double>()) *
                along_m_per_px;
  shift.sigma_px = ((noise.disparity_px * shift.along).array().square() +
                    jacobian.rowwise().squaredNorm().array() * (across_m * across_m))
                       .sqrt();
  return shift;
}

}  // namespace carmap
