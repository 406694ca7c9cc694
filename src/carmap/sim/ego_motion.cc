#include "carmap/sim/ego_motion.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "carmap/base/random.h"

namespace carmap {
namespace {

constexpr double kAcceleration = 1.5, kSidewaysAcceleration = 2;  // m/s²

/// What the road allows at each of its points, having to slow down in time for what follows.
std::vector<double> SpeedLimits(const Route& route, double speed_mps, double step_m) {
  const auto count = static_cast<size_t>(std::ceil(route.length_m() / step_m)) + 1;
  std::vector<double> limits(count);
  for (size_t i = 0; i < count; ++i) {
    const double curvature = std::abs(route.At(static_cast<double>(i) * step_m).curvature_per_m);
    limits[i] = std::min(speed_mps, std::sqrt(kSidewaysAcceleration / std::max(curvature, 1e-6)));
  }
  const auto bound = [&](size_t i, size_t neighbour) {
    const double reachable = std::hypot(limits[neighbour], std::sqrt(2 * kAcceleration * step_m));
    limits[i] = std::min(limits[i], reachable);
  };
  const int rounds = route.closed() ? 2 : 1;
  for (int round = 0; round < rounds; ++round) {
    for (size_t i = count - 1; i-- > 0;) bound(i, i + 1);
    for (size_t i = 1; i < count; ++i) bound(i, i - 1);
    if (route.closed()) limits.front() = limits.back() = std::min(limits.front(), limits.back());
  }
  return limits;
}

/// Waves of the road under the wheels: smooth noise of zero mean and about this deviation.
double Bumps(double along_m, uint64_t seed, double deviation) {
  constexpr int kWaves = 6;
  double sum = 0;
  for (int wave = 0; wave < kWaves; ++wave) {
    const double length_m = 3.5 * std::pow(1.45, wave);  // 3.5 to 22 m
    const double phase = 2 * M_PI * UnitHash(seed, static_cast<uint64_t>(wave));
    sum += std::sin(2 * M_PI * along_m / length_m + phase);
  }
  return deviation * sum * std::sqrt(2.0 / kWaves);
}

/// Looks along the heading, level.
Eigen::Matrix3d EnuFromLevelCamera(double heading_rad) {
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  Eigen::Matrix3d rotation;
  rotation.col(0) << s, -c, 0;
  rotation.col(1) << 0, 0, -1;
  rotation.col(2) << c, s, 0;
  return rotation;
}

}  // namespace

std::vector<double> AlongAtSpeed(const Route& route, double speed_mps, double frame_rate_hz,
                                 size_t max_frames) {
  constexpr double kStepM = 0.5;
  constexpr int kSubsteps = 10;
  const std::vector<double> limits = SpeedLimits(route, speed_mps, kStepM);
  const double lap_m = static_cast<double>(limits.size() - 1) * kStepM;
  const auto limit_at = [&](double along_m) {
    const double within = route.closed() ? std::fmod(along_m, lap_m) : std::min(along_m, lap_m);
    const auto i = std::min(static_cast<size_t>(within / kStepM), limits.size() - 2);
    return std::lerp(limits[i], limits[i + 1], within / kStepM - static_cast<double>(i));
  };
  std::vector<double> along;
  double s = 0;
  while (along.size() < max_frames && (route.closed() || s <= route.length_m())) {
    along.push_back(s);
    for (int i = 0; i < kSubsteps; ++i) s += limit_at(s) / (frame_rate_hz * kSubsteps);
  }
  return along;
}

EgoMotion::EgoMotion(const Route& route, std::shared_ptr<const GroundMap> ground,
                     std::vector<double> along_m, const EgoMotionOptions& options)
    : route_(route), ground_(std::move(ground)), along_m_(std::move(along_m)), options_(options) {}

double EgoMotion::TimeOf(size_t frame_idx) const {
  return static_cast<double>(frame_idx) / options_.frame_rate_hz;
}

/// Catmull-Rom: as smooth as the frames are.
double EgoMotion::AlongAt(double frame) const {
  if (along_m_.size() == 1) return along_m_.front();
  const double last = static_cast<double>(along_m_.size()) - 1;
  const double i = std::clamp(std::floor(frame), 0.0, last - 1), t = frame - i;
  const auto knot = [&](double n) {
    if (n < 0) return 2 * along_m_[0] - along_m_[1];
    if (n > last) return 2 * along_m_.back() - along_m_[along_m_.size() - 2];
    return along_m_[static_cast<size_t>(n)];
  };
  const double p0 = knot(i - 1), p1 = knot(i), p2 = knot(i + 1), p3 = knot(i + 2);
  return p1 +
         0.5 * t * (p2 - p0 + t * (2 * p0 - 5 * p1 + 4 * p2 - p3 + t * (3 * (p1 - p2) + p3 - p0)));
}

Rigid3 EgoMotion::PoseAt(double frame) const {
  const double along_m = AlongAt(frame);
  const RoutePoint point = route_.At(along_m, options_.left_m);
  const double heading_rad = point.heading_rad + (options_.reverse ? M_PI : 0);
  const Eigen::Vector2d forward(std::cos(heading_rad), std::sin(heading_rad));
  const Eigen::Vector2d left(-forward.y(), forward.x());
  const Eigen::Vector2d& here = point.position_in_enu;

  constexpr double kHalfWheelbaseM = 1.4, kHalfTrackM = 0.8;
  const auto slope = [&](const Eigen::Vector2d& half) {
    return std::atan2(ground_->HeightAt(here + half) - ground_->HeightAt(here - half),
                      2 * half.norm());
  };
  const double uneven = options_.unevenness;
  const uint64_t seed = options_.road_seed;
  const double nose_up_rad = slope(kHalfWheelbaseM * forward) + Bumps(along_m, seed, 3e-3 * uneven);
  const double lean_rad = slope(kHalfTrackM * left) + Bumps(along_m, seed + 1, 3e-3 * uneven);
  const double heave_m = Bumps(along_m, seed + 2, 6e-3 * uneven);

  // About the camera's own axes: x to the right lifts the nose, z forward lifts the left side.
  const Eigen::Quaterniond enu_from_camera(
      EnuFromLevelCamera(heading_rad) *
      Eigen::AngleAxisd(nose_up_rad, Eigen::Vector3d::UnitX()).toRotationMatrix() *
      Eigen::AngleAxisd(lean_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix());
  const double height_m = ground_->HeightAt(here) + options_.camera_height_m + heave_m;
  return {enu_from_camera.normalized(), {here.x(), here.y(), height_m}};
}

Rigid3 EgoMotion::EnuFromCamera(size_t frame_idx) const {
  return PoseAt(static_cast<double>(frame_idx));
}

ViewMotion EgoMotion::MotionAt(size_t frame_idx) const {
  constexpr double kStepFrames = 0.02;
  const double frame = static_cast<double>(frame_idx);
  const Rigid3 before_from_after =
      PoseAt(frame - kStepFrames).Inverse() * PoseAt(frame + kStepFrames);
  const double interval_s = 2 * kStepFrames / options_.frame_rate_hz;
  const Eigen::AngleAxisd turn(before_from_after.rotation);
  return {before_from_after.translation / interval_s, turn.angle() * turn.axis() / interval_s};
}

std::vector<EgoState> EgoMotion::States() const {
  std::vector<EgoState> states;
  for (size_t i = 0; i < along_m_.size(); ++i) {
    constexpr double kStepFrames = 0.02;
    const double frame = static_cast<double>(i);
    const double moved_m = AlongAt(frame + kStepFrames) - AlongAt(frame - kStepFrames);
    const double speed_mps = std::abs(moved_m) * options_.frame_rate_hz / (2 * kStepFrames);
    states.push_back({TimeOf(i), along_m_[i], options_.left_m, speed_mps});
  }
  return states;
}

}  // namespace carmap
