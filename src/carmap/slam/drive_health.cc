#include "carmap/slam/drive_health.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

double ShareOf(size_t part, size_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

/// Cameras that look towards each other or apart bend all depths: the bias goes as far as it may.
Suspicion LookTogetherOrApart(double bias_px, const std::vector<uint32_t>& frame_indices) {
  return {DriveFault::kMisaligned, frame_indices.empty() ? 0 : frame_indices.front(),
          frame_indices.empty() ? 0 : frame_indices.back(),
          fmt::format("disparities are {} by {:.1f} px or more: the cameras look {}",
                      bias_px > 0 ? "too large" : "too small", std::abs(bias_px),
                      bias_px > 0 ? "together" : "apart"),
          "calibrate the cameras anew and rectify the images by it"};
}

}  // namespace

DriveFaults DriveHealth::faults() const {
  DriveFaults faults;
  for (const Suspicion& suspicion : suspicions) faults.set(static_cast<size_t>(suspicion.fault));
  return faults;
}

void DriveHealthMonitor::TakeFeatures(const std::vector<Feature>& features) {
  features_ += features.size();
  with_depth_ += static_cast<size_t>(
      std::count_if(features.begin(), features.end(),
                    [](const Feature& feature) { return feature.has_disparity(); }));
}

void DriveHealthMonitor::TakeTracked(const std::vector<Feature>& features,
                                     const std::vector<uint32_t>& tracked) {
  constexpr double kNearBaselines = 40;
  tracked_ += tracked.size();
  near_ += static_cast<size_t>(std::count_if(tracked.begin(), tracked.end(), [&](uint32_t idx) {
    return features[idx].disparity_px > rig_.camera.fx / kNearBaselines;
  }));
}

DriveHealth DriveHealthMonitor::Judge(const Trajectory& trajectory,
                                      const std::vector<uint32_t>& frame_indices, size_t keyframes,
                                      const DisparityBias& bias, double max_bias_px) const {
  constexpr double kAtBound = 0.98;
  DriveHealth health;
  health.pairs = Summarize(camera_rig_.camera, pairs_);
  health.motion = MeasureMotion(trajectory, frame_indices);
  health.depth_share = ShareOf(with_depth_, features_);
  health.near_share = ShareOf(near_, tracked_);
  const double length_m = PathLengthM(trajectory);
  if (length_m > 0) health.keyframes_per_m = static_cast<double>(keyframes) / length_m;
  health.suspicions = JudgePairs(camera_rig_, pairs_);
  const double constant_px = bias.coefficients_px.x();
  health.is_bias_at_bound = std::abs(constant_px) >= kAtBound * max_bias_px;
  if (health.is_bias_at_bound && health.suspicions.empty())  // or else it follows from those
    health.suspicions.push_back(LookTogetherOrApart(constant_px, frame_indices));
  if (auto motion = JudgeMotion(health.motion)) health.suspicions.push_back(*std::move(motion));
  return health;
}

}  // namespace carmap
