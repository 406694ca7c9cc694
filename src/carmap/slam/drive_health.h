// What a drive shows of its own soundness while it is mapped or localized: a result that rests on
// images, times or a calibration that cannot be right is not to be called right.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"
#include "carmap/slam/motion_check.h"
#include "carmap/slam/pair_check.h"

namespace carmap {

struct DriveHealth {
  PairHealth pairs;
  MotionHealth motion;
  double depth_share = 0;         ///< of features, that have depth
  double near_share = 0;          ///< of tracked landmarks, that are nearer than 40 baselines
  double keyframes_per_m = 0;     ///< 0 of a vehicle that stood
  bool is_bias_at_bound = false;  ///< the constant part of the disparity bias
  std::vector<Suspicion> suspicions;

  DriveFaults faults() const;
};

/// Follows one drive. One thread calls.
class DriveHealthMonitor {
 public:
  /// `camera_rig`: of the drive's own images; `rig`: in whose pixels features are.
  DriveHealthMonitor(const StereoRig& camera_rig, const StereoRig& rig)
      : camera_rig_(camera_rig), rig_(rig) {}

  void TakePair(const CheckedPair& pair) { pairs_.push_back(pair); }
  void TakeFeatures(const std::vector<Feature>& features);
  /// Features whose landmarks agree with the pose.
  void TakeTracked(const std::vector<Feature>& features, const std::vector<uint32_t>& tracked);

  /// The verdict at the end: on the trajectory, of frames of these numbers, and the disparity bias
  /// found, which may not be larger than `max_bias_px`.
  DriveHealth Judge(const Trajectory& trajectory, const std::vector<uint32_t>& frame_indices,
                    size_t keyframes, const DisparityBias& bias, double max_bias_px) const;

 private:
  const StereoRig camera_rig_, rig_;
  std::vector<CheckedPair> pairs_;
  size_t features_ = 0, with_depth_ = 0, tracked_ = 0, near_ = 0;
};

}  // namespace carmap
