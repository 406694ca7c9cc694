#include "carmap/update/persistence.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/index/kd_tree.h"

namespace carmap {
namespace {

/// Nodes and weights of a normal distribution, for integrating over it (Gauss-Hermite, 5 points).
constexpr std::array<double, 5> kNodes = {-2.856970, -1.355626, 0, 1.355626, 2.856970};
constexpr std::array<double, 5> kWeights = {0.011257, 0.222076, 0.533333, 0.222076, 0.011257};

/// Likelihood of what a pass saw of a landmark that is there.
double IfThere(const PassSighting& pass, double recognised, double through) {
  const double seen = ProbabilityOf(pass.log_odds + recognised);
  if (pass.outcome == Sighting::kSeen) return seen;
  return (1 - seen) * (pass.outcome == Sighting::kSeenThrough ? through : 1 - through);
}

double IfGone(const PassSighting& pass, double through, const PersistenceOptions& options) {
  if (pass.outcome == Sighting::kSeen) return options.false_seen;
  return (1 - options.false_seen) *
         (pass.outcome == Sighting::kSeenThrough ? through : 1 - through);
}

/// Likelihood of the passes from `begin` to each of the following if it went before `begin`.
std::vector<double> LikelihoodsIfGone(const std::vector<PassSighting>& passes,
                                      const PersistenceOptions& options) {
  // Of the passes from each one on.
  std::vector<double> from(passes.size() + 1, 0);
  for (size_t k = 0; k < options.gone_through.size(); ++k) {
    double product = options.gone_through_weights[k];
    from[passes.size()] += product;
    for (size_t i = passes.size(); i-- > 0;) {
      product *= IfGone(passes[i], options.gone_through[k], options);
      from[i] += product;
    }
  }
  return from;
}

double HazardBetween(int64_t from_s, int64_t to_s, const PersistenceOptions& options) {
  constexpr double kDayS = 86400;
  const double days = static_cast<double>(to_s - from_s) / kDayS;
  return std::clamp(1 - std::exp(-days / options.lifetime_days), options.min_hazard,
                    options.max_hazard);
}

size_t LastSeen(const std::vector<PassSighting>& passes) {
  size_t after = 0;  // the pass after the last that saw it
  for (size_t i = 0; i < passes.size(); ++i) {
    if (passes[i].outcome == Sighting::kSeen) after = i + 1;
  }
  return after;
}

/// Passes that missed it since it was last seen, each of another drive.
size_t MissedSince(const WatchedLandmark& landmark) {
  return landmark.passes.size() - LastSeen(landmark.passes);
}

/// Whether what became of a neighbour may have become of the landmark too: it was not seen since.
bool MayHaveGoneWith(const WatchedLandmark& landmark, const WatchedLandmark& neighbour) {
  const size_t seen = LastSeen(landmark.passes);
  if (seen == 0) return true;
  const int64_t seen_s = landmark.passes[seen - 1].time_s;
  if (neighbour.vanished_s) return *neighbour.vanished_s > seen_s;
  return !neighbour.passes.empty() && neighbour.passes.back().time_s > seen_s;
}

/// Landmarks and those around them, as far as votes matter: around those that seem to be gone.
class Neighbourhood {
 public:
  Neighbourhood(const std::vector<WatchedLandmark>& landmarks, const std::vector<double>& alone,
                const PersistenceOptions& options)
      : of_(landmarks.size()) {
    constexpr double kReach = 3;        // of votes, from one to the next
    constexpr double kSuspicious = -2;  // log odds, by itself
    std::vector<uint32_t> suspects;
    for (uint32_t i = 0; i < landmarks.size(); ++i) {
      if (alone[i] > kSuspicious) suspects.push_back(i);
    }
    if (suspects.empty()) return;
    std::vector<Eigen::Vector3d> places;
    for (const WatchedLandmark& landmark : landmarks) places.push_back(landmark.position_in_map);
    const KdTree tree(std::move(places));
    std::vector<bool> is_voted_on(landmarks.size(), false);
    for (const uint32_t suspect : suspects) {
      for (const uint32_t i :
           tree.WithinRadius(landmarks[suspect].position_in_map, kReach * options.neighbour_m)) {
        is_voted_on[i] = true;
      }
    }
    for (uint32_t i = 0; i < landmarks.size(); ++i) {
      if (!is_voted_on[i]) continue;
      voted_on_.push_back(i);
      of_[i] = tree.WithinRadius(landmarks[i].position_in_map, options.neighbour_m,
                                 options.max_neighbours + 1);
      std::erase(of_[i], i);
    }
  }
  /// Ascending; others stay what they are by themselves.
  const std::vector<uint32_t>& voted_on() const { return voted_on_; }
  const std::vector<uint32_t>& Of(uint32_t idx) const { return of_[idx]; }

 private:
  std::vector<uint32_t> voted_on_;
  std::vector<std::vector<uint32_t>> of_;
};

/// What neighbours say, until it settles (mean field of an Ising model).
std::vector<double> Vote(const std::vector<WatchedLandmark>& landmarks,
                         const std::vector<double>& alone, const Neighbourhood& neighbourhood,
                         const PersistenceOptions& options) {
  constexpr int kRounds = 12;
  std::vector<double> log_odds = alone;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> next = alone;
    for (const uint32_t i : neighbourhood.voted_on()) {
      for (const uint32_t j : neighbourhood.Of(i)) {
        const double says = options.coupling * std::tanh(log_odds[j] / 2);
        if (says < 0 || MayHaveGoneWith(landmarks[i], landmarks[j])) next[i] += says;
      }
    }
    log_odds = std::move(next);
  }
  return log_odds;
}

}  // namespace

double ProbabilityOf(double log_odds) { return 1 / (1 + std::exp(-log_odds)); }

double LogOddsGone(const std::vector<PassSighting>& passes, int64_t now_s,
                   const PersistenceOptions& options) {
  if (passes.empty()) return std::log(options.min_hazard);
  const bool was_seen_through =
      std::any_of(passes.begin(), passes.end(),
                  [](const PassSighting& pass) { return pass.outcome == Sighting::kSeenThrough; });
  if (passes.back().outcome == Sighting::kSeen && !was_seen_through) {  // most of them
    const double hazard = HazardBetween(passes.back().time_s, now_s, options);
    return std::log(hazard / (1 - hazard));
  }
  const std::vector<double> if_gone_from = LikelihoodsIfGone(passes, options);
  std::vector<double> gone_before = {options.min_hazard};  // each pass, and now
  for (size_t i = 0; i < passes.size(); ++i) {
    const int64_t next_s = i + 1 < passes.size() ? passes[i + 1].time_s : now_s;
    gone_before.push_back(HazardBetween(passes[i].time_s, next_s, options));
  }
  double there = 0, gone = 0;
  for (size_t n = 0; n < kNodes.size(); ++n) {
    const double recognised = options.recognised_sigma * kNodes[n];
    for (size_t t = 0; t < options.through.size(); ++t) {
      double until = kWeights[n] * options.through_weights[t];  // there, and seen as it was
      for (size_t i = 0; i < passes.size(); ++i) {
        gone += until * gone_before[i] * if_gone_from[i];
        until *= (1 - gone_before[i]) * IfThere(passes[i], recognised, options.through[t]);
      }
      gone += until * gone_before.back();
      there += until * (1 - gone_before.back());
    }
  }
  constexpr double kLeast = 1e-300;
  const double log_odds = std::log(std::max(gone, kLeast)) - std::log(std::max(there, kLeast));
  return std::clamp(log_odds, -options.max_log_odds, options.max_log_odds);
}

std::vector<Vanishing> FindVanished(const std::vector<WatchedLandmark>& landmarks, int64_t now_s,
                                    const PersistenceOptions& options) {
  std::vector<double> alone;
  for (const WatchedLandmark& landmark : landmarks) {
    alone.push_back(landmark.vanished_s ? options.max_log_odds
                                        : LogOddsGone(landmark.passes, now_s, options));
  }
  const Neighbourhood neighbourhood(landmarks, alone, options);
  const std::vector<double> log_odds = Vote(landmarks, alone, neighbourhood, options);
  const auto is_gone = [&](uint32_t i) { return log_odds[i] >= options.min_log_odds; };
  const auto has_drives = [&](uint32_t i) {
    return landmarks[i].vanished_s || MissedSince(landmarks[i]) >= options.min_drives;
  };
  std::vector<Vanishing> vanished;
  for (const uint32_t i : neighbourhood.voted_on()) {
    if (!is_gone(i) || landmarks[i].vanished_s) continue;
    const std::vector<uint32_t>& around = neighbourhood.Of(i);
    const auto voting = std::count_if(around.begin(), around.end(),
                                      [&](uint32_t j) { return is_gone(j) && has_drives(j); });
    const bool neighbours_tell = 2 * static_cast<size_t>(voting) > around.size();
    if (has_drives(i) || neighbours_tell) vanished.push_back({i, log_odds[i]});
  }
  return vanished;
}

}  // namespace carmap
