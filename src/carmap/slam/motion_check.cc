#include "carmap/slam/motion_check.h"

#include <fmt/format.h>

#include <algorithm>

namespace carmap {
namespace {

/// Beyond what tyres and engines give, with room for the noise of poses.
constexpr double kMaxSpeedMps = 90, kMaxAccelerationMps2 = 20, kMaxJumpM = 1.0;
constexpr double kWindowS = 0.5;  ///< over which a speed is measured
constexpr double kMaxGapS = 0.6;  ///< between frames that are one motion

struct Place {
  double time_s;
  uint32_t index;
  Eigen::Vector3d position;
};

Eigen::Vector3d Velocity(const Place& from, const Place& to) {
  return (to.position - from.position) / (to.time_s - from.time_s);
}

/// Stretches of frames that all have poses, without gaps in time.
std::vector<std::vector<Place>> Stretches(const Trajectory& trajectory,
                                          const std::vector<uint32_t>& frame_indices) {
  std::vector<std::vector<Place>> stretches(1);
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const TimedPose& pose = trajectory[i];
    std::vector<Place>& last = stretches.back();
    if (!pose.timestamp) continue;
    const double time_s = pose.timestamp->seconds();
    const bool is_cut =
        !last.empty() && (!pose.world_from_camera || time_s - last.back().time_s > kMaxGapS);
    if (is_cut) stretches.emplace_back();
    if (!pose.world_from_camera) continue;
    if (!stretches.back().empty() && time_s <= stretches.back().back().time_s) continue;
    stretches.back().push_back({time_s, frame_indices[i], pose.world_from_camera->translation});
  }
  return stretches;
}

void MeasureJumps(const std::vector<Place>& places, MotionHealth& motion) {
  for (size_t i = 2; i < places.size(); ++i) {
    const double interval_s = places[i].time_s - places[i - 1].time_s;
    const double jump_m =
        (Velocity(places[i - 1], places[i]) - Velocity(places[i - 2], places[i - 1])).norm() *
        interval_s;
    if (jump_m <= motion.max_jump_m) continue;
    motion.max_jump_m = jump_m;
    motion.jump_index = places[i].index;
  }
}

void MeasureAccelerations(const std::vector<Place>& places, MotionHealth& motion) {
  for (size_t middle = 0, before = 0, after = 0; middle < places.size(); ++middle) {
    const double time_s = places[middle].time_s;
    while (before + 1 < middle && places[before + 1].time_s <= time_s - kWindowS) ++before;
    while (after + 1 < places.size() && places[after].time_s < time_s + kWindowS) ++after;
    if (time_s - places[before].time_s < kWindowS || places[after].time_s - time_s < kWindowS)
      continue;
    const Eigen::Vector3d to_here = Velocity(places[before], places[middle]);
    const Eigen::Vector3d from_here = Velocity(places[middle], places[after]);
    motion.max_speed_mps = std::max(motion.max_speed_mps, to_here.norm());
    const double acceleration_mps2 =
        (from_here - to_here).norm() / ((places[after].time_s - places[before].time_s) / 2);
    if (acceleration_mps2 <= motion.max_acceleration_mps2) continue;
    motion.max_acceleration_mps2 = acceleration_mps2;
    motion.acceleration_index = places[middle].index;
  }
}

}  // namespace

MotionHealth MeasureMotion(const Trajectory& trajectory,
                           const std::vector<uint32_t>& frame_indices) {
  MotionHealth motion;
  for (const std::vector<Place>& places : Stretches(trajectory, frame_indices)) {
    MeasureJumps(places, motion);
    MeasureAccelerations(places, motion);
  }
  return motion;
}

std::optional<Suspicion> JudgeMotion(const MotionHealth& motion) {
  const bool is_jump = motion.max_jump_m > kMaxJumpM;
  const bool is_thrown = motion.max_acceleration_mps2 > kMaxAccelerationMps2;
  if (!is_jump && !is_thrown && motion.max_speed_mps <= kMaxSpeedMps) return std::nullopt;
  const uint32_t index = is_jump ? motion.jump_index : motion.acceleration_index;
  return Suspicion{
      DriveFault::kImpossibleMotion, index, index,
      fmt::format(
          "no vehicle moves so: up to {:.0f} m/s and {:.0f} m/s^2 near frame {}, and {:.1f} "
          "m in one step at frame {}",
          motion.max_speed_mps, motion.max_acceleration_mps2, motion.acceleration_index,
          motion.max_jump_m, motion.jump_index),
      "look at the images there: nothing near the camera in sight, or frames or their times "
      "missing or in a wrong order?"};
}

}  // namespace carmap
