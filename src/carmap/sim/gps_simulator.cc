#include "carmap/sim/gps_simulator.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "carmap/base/random.h"

namespace carmap {
namespace {

enum Stream : uint64_t { kBias, kExcursions, kPeaks, kOutages, kNoise };

/// Where the camera truly was, and how far it had come.
struct Waypoint {
  double time_s = 0, travelled_m = 0;
  Eigen::Vector3d position_in_enu = Eigen::Vector3d::Zero();
};

std::vector<Waypoint> Waypoints(const Trajectory& enu_from_camera) {
  std::vector<Waypoint> waypoints;
  for (const TimedPose& pose : enu_from_camera) {
    const Eigen::Vector3d& position = pose.world_from_camera->translation;
    const double travelled_m =
        waypoints.empty()
            ? 0
            : waypoints.back().travelled_m + (position - waypoints.back().position_in_enu).norm();
    waypoints.push_back({pose.timestamp->seconds(), travelled_m, position});
  }
  return waypoints;
}

Eigen::Vector3d PositionAt(const std::vector<Waypoint>& waypoints, double time_s) {
  const auto after =
      std::lower_bound(waypoints.begin(), waypoints.end(), time_s,
                       [](const Waypoint& waypoint, double t) { return waypoint.time_s < t; });
  if (after == waypoints.begin()) return waypoints.front().position_in_enu;
  if (after == waypoints.end()) return waypoints.back().position_in_enu;
  const Waypoint& before = *std::prev(after);
  const double fraction = (time_s - before.time_s) / (after->time_s - before.time_s);
  return before.position_in_enu + fraction * (after->position_in_enu - before.position_in_enu);
}

/// First-order Gauss-Markov process on a grid of its own.
class WanderingBias {
 public:
  WanderingBias(const GpsModel& model, double duration_s, uint64_t seed) {
    HashSequence random(seed, kBias);
    const double kept = std::exp(-kStepS / model.bias_time_s);
    const auto draw = [&](double sigma) -> Eigen::Vector3d {
      const double east = random.Normal(), north = random.Normal(), up = random.Normal();
      return sigma * Eigen::Vector3d(east, north, model.vertical_factor * up);
    };
    values_.push_back(draw(model.bias_m));
    for (double t = 0; t <= duration_s; t += kStepS) {
      values_.push_back(kept * values_.back() + draw(model.bias_m * std::sqrt(1 - kept * kept)));
    }
  }
  Eigen::Vector3d At(double since_start_s) const {
    const auto i = std::min(static_cast<size_t>(since_start_s / kStepS), values_.size() - 2);
    const double fraction = since_start_s / kStepS - static_cast<double>(i);
    return values_[i] + fraction * (values_[i + 1] - values_[i]);
  }

 private:
  static constexpr double kStepS = 0.1;
  std::vector<Eigen::Vector3d> values_;
};

/// What happens at a place of the road and lasts for a time.
struct Event {
  double start_s = 0, duration_s = 0;
  Eigen::Vector3d peak_in_enu = Eigen::Vector3d::Zero();  ///< of an excursion's error
};

std::vector<Event> DrawEvents(const std::vector<Waypoint>& waypoints, double per_km,
                              double mean_duration_s, HashSequence random) {
  std::vector<Event> events;
  if (per_km <= 0) return events;
  double end_s = waypoints.front().time_s;
  for (double stretch = 0;; ++stretch) {
    const double place_m = (stretch + random.Unit()) * 1000 / per_km;
    const double duration_s = mean_duration_s * random.Between(0.5, 1.5);
    const auto there = std::lower_bound(
        waypoints.begin(), waypoints.end(), place_m,
        [](const Waypoint& waypoint, double metres) { return waypoint.travelled_m < metres; });
    if (there == waypoints.end()) return events;
    if (there->time_s < end_s) continue;
    events.push_back({.start_s = there->time_s, .duration_s = duration_s});
    end_s = there->time_s + duration_s;
  }
}

std::vector<Event> DrawExcursions(const std::vector<Waypoint>& waypoints, const GpsModel& model,
                                  uint64_t seed) {
  std::vector<Event> excursions = DrawEvents(waypoints, model.excursions_per_km, model.excursion_s,
                                             HashSequence(seed, kExcursions));
  HashSequence random(seed, kPeaks);
  for (Event& excursion : excursions) {
    const double size_m = random.Between(model.excursion_min_m, model.excursion_max_m);
    const double direction_rad = random.Between(0, 2 * M_PI);
    excursion.peak_in_enu =
        size_m * Eigen::Vector3d(std::cos(direction_rad), std::sin(direction_rad),
                                 random.Between(-0.5, 0.5));
  }
  return excursions;
}

const Event* EventAt(const std::vector<Event>& events, double time_s) {
  const auto event = std::find_if(events.begin(), events.end(), [&](const Event& e) {
    return e.start_s <= time_s && time_s < e.start_s + e.duration_s;
  });
  return event == events.end() ? nullptr : &*event;
}

/// Rises and falls smoothly.
Eigen::Vector3d ErrorOf(const Event& excursion, double time_s) {
  const double phase = (time_s - excursion.start_s) / excursion.duration_s;
  return std::pow(std::sin(M_PI * phase), 2) * excursion.peak_in_enu;
}

}  // namespace

GpsModel ModelOf(GpsQuality quality) {
  if (quality == GpsQuality::kOpen) return {};
  return {.noise_m = 1.5, .bias_m = 3, .excursions_per_km = 4, .outages_per_km = 1.5};
}

std::vector<SimulatedFix> SimulateGps(const Trajectory& enu_from_camera, const GpsFix& origin,
                                      const GpsModel& model, uint64_t seed) {
  std::vector<SimulatedFix> fixes;
  if (enu_from_camera.empty()) return fixes;
  const std::vector<Waypoint> waypoints = Waypoints(enu_from_camera);
  const double start_s = waypoints.front().time_s;
  const double duration_s = waypoints.back().time_s - start_s;
  const WanderingBias bias(model, duration_s, seed);
  const std::vector<Event> excursions = DrawExcursions(waypoints, model, seed);
  const std::vector<Event> outages =
      DrawEvents(waypoints, model.outages_per_km, model.outage_s, HashSequence(seed, kOutages));
  const LocalEnu enu(origin);
  constexpr double kToleranceS = 1e-6;  // the last frame has a fix
  for (uint64_t i = 0;; ++i) {
    const double since_start_s = static_cast<double>(i) / model.rate_hz;
    if (since_start_s > duration_s + kToleranceS) return fixes;
    const double time_s = start_s + since_start_s;
    if (EventAt(outages, time_s) != nullptr) continue;
    HashSequence noise(HashKeys(seed, kNoise), i);
    const double east = noise.Normal(), north = noise.Normal(), up = noise.Normal();
    Eigen::Vector3d measured =
        PositionAt(waypoints, time_s) + bias.At(since_start_s) +
        model.noise_m * Eigen::Vector3d(east, north, model.vertical_factor * up);
    const Event* const excursion = EventAt(excursions, time_s);
    if (excursion != nullptr) measured += ErrorOf(*excursion, time_s);
    fixes.push_back({Timestamp::FromSeconds(time_s), enu.ToGps(measured)});
  }
}

std::string GpsText(const std::vector<SimulatedFix>& fixes, const GpsModel& model) {
  std::string text = fmt::format(
      "# time latitude longitude altitude; simulated at {} Hz: white noise {} m, bias {} m "
      "wandering in {} s,\n# heights {} times as much; {} excursions a km to {}-{} m for about "
      "{} s, {} outages a km of about {} s\n",
      model.rate_hz, model.noise_m, model.bias_m, model.bias_time_s, model.vertical_factor,
      model.excursions_per_km, model.excursion_min_m, model.excursion_max_m, model.excursion_s,
      model.outages_per_km, model.outage_s);
  for (const SimulatedFix& row : fixes) {
    fmt::format_to(std::back_inserter(text), "{:.9f} {:.9f} {:.9f} {:.4f}\n", row.time.seconds(),
                   row.fix.latitude_deg, row.fix.longitude_deg, row.fix.altitude_m);
  }
  return text;
}

}  // namespace carmap
