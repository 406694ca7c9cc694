// How the error of a landmark's position appears in an image.
//
// A landmark's place is known across the line of sight as well as its nearest viewer saw it, along
// it by stereo: what was mapped from afar is some metres uncertain for a camera that drives up to
// it. Pure, thread-safe.
#pragma once

#include <Eigen/Core>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/map_snapshot.h"
#include "carmap/solve/pose_refinement.h"

namespace carmap {

struct LandmarkShift {
  /// Of (u, v, disparity), pixels, by each pixel that the disparity erred by when it was mapped.
  Eigen::Vector3d along = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_px = Eigen::Vector3d::Zero();  ///< standard deviations in all
};

/// Zero for a landmark that is not before the camera.
LandmarkShift ShiftOf(const SnapshotLandmark& landmark, const StereoRig& rig,
                      const Rigid3& camera_from_map, const MeasurementNoise& noise);

}  // namespace carmap
