#include "carmap/sim/traffic/ego_track.h"

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

/// Along the route without jumps where a lap ends.
std::vector<double> Unwrapped(const Route& route, const std::vector<EgoState>& ego) {
  std::vector<double> along;
  for (const EgoState& state : ego) {
    double next_m = state.along_m;
    if (route.closed() && !along.empty()) {
      next_m = along.back() + std::remainder(next_m - along.back(), route.length_m());
    }
    along.push_back(next_m);
  }
  return along;
}

double Median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

EgoTrack::EgoTrack(const Route& route, const std::vector<EgoState>& ego)
    : start_s_(ego.front().time_s) {
  std::vector<double> progress = Unwrapped(route, ego);
  direction_ = progress.back() < progress.front() ? -1 : 1;
  for (double& p : progress) p *= direction_;
  // Recorded ones that stand shiver.
  for (size_t i = 1; i < progress.size(); ++i) progress[i] = std::max(progress[i], progress[i - 1]);

  const auto steps = static_cast<size_t>(StepAt(ego.back().time_s) + 1e-9) + 2;
  for (size_t step = 0, i = 0; step < steps; ++step) {
    const double time_s = start_s_ + static_cast<double>(step) * kStepS;
    while (i + 2 < ego.size() && ego[i + 1].time_s <= time_s) ++i;
    if (ego.size() == 1) {
      instants_.push_back({progress[0] + (time_s - start_s_) * ego[0].speed_mps, ego[0].left_m});
      continue;
    }
    const double t = (time_s - ego[i].time_s) / (ego[i + 1].time_s - ego[i].time_s);
    instants_.push_back({std::lerp(progress[i], progress[i + 1], t),
                         std::lerp(ego[i].left_m, ego[i + 1].left_m, std::min(t, 1.0))});
  }
  constexpr size_t kReach = 3;
  std::vector<double> moving;
  for (size_t step = 0; step < steps; ++step) {
    const size_t before = step - std::min(step, kReach), after = std::min(step + kReach, steps - 1);
    instants_[step].speed_mps = (instants_[after].progress_m - instants_[before].progress_m) /
                                (static_cast<double>(after - before) * kStepS);
    if (instants_[step].speed_mps > 1) moving.push_back(instants_[step].speed_mps);
  }
  if (!moving.empty()) cruise_mps_ = std::max(3.0, Median(std::move(moving)));
}

size_t EgoTrack::StepNear(double progress_m) const {
  const auto at = std::lower_bound(
      instants_.begin(), instants_.end(), progress_m,
      [](const Instant& instant, double progress) { return instant.progress_m < progress; });
  return std::min(static_cast<size_t>(at - instants_.begin()), instants_.size() - 1);
}

double EgoTrack::LeftAt(double progress_m) const {
  const size_t after = StepNear(progress_m), before = after - std::min<size_t>(after, 1);
  const Instant &a = instants_[before], &b = instants_[after];
  if (progress_m <= a.progress_m) return a.left_m;
  if (progress_m >= b.progress_m) return b.left_m;
  const double t = (progress_m - a.progress_m) / (b.progress_m - a.progress_m);
  return std::lerp(a.left_m, b.left_m, t);
}

}  // namespace carmap
