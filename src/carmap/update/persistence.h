// Which landmarks of the base have vanished from the street (the paper leaves it open, §3.4).
//
// A persistence filter per landmark (Rosen, Mason, Leonard, ICRA 2016): of the passes that should
// have seen it, how likely is what they saw if it is still there, and if it went at any time since
// it was last seen. How well a landmark is recognised while it is there, and how often something
// is measured behind it all the same, as with twigs, are not known: both are integrated over, so
// that one that was never recognised does not count as gone for that. Then neighbours vote:
// billboards go as a whole. Pure, deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/map/map_diff.h"

namespace carmap {

struct PersistenceOptions {
  // What is there.
  double recognised_sigma = 1.5;  ///< of how well landmarks are recognised, in log odds
  double false_seen = 0.02;       ///< of one that is gone
  /// That it is seen through if it is there and was not recognised: of most landmarks, of some, and
  /// of the few that have gaps.
  std::vector<double> through = {0.005, 0.05, 0.4};
  std::vector<double> through_weights = {0.92, 0.04, 0.04};
  /// And of one that is gone: what stands behind is farther, or something else stands there.
  std::vector<double> gone_through = {0.8, 0.1};
  std::vector<double> gone_through_weights = {0.7, 0.3};

  // How long it stays.
  double lifetime_days = 700;
  double min_hazard = 0.003, max_hazard = 0.05;  ///< of going from one pass to the next

  // Neighbours.
  double neighbour_m = 1.2;
  size_t max_neighbours = 6;
  double coupling = 1.5;    ///< log odds that a neighbour adds at most
  double max_log_odds = 8;  ///< of one landmark by itself

  double min_log_odds = 2;  ///< of being gone, to go
  size_t min_drives = 2;    ///< that must have missed it, or most of its neighbours that go
};

/// 0 to 1.
double ProbabilityOf(double log_odds);

/// What one pass of a drive says of a landmark that it should have seen.
struct PassSighting {
  int64_t time_s = 0;  ///< Unix time
  Sighting outcome = Sighting::kNone;
  /// Of landmarks around to be recognised in this pass, whose light, lane and traffic are its own.
  double log_odds = 0;
};

/// A landmark by itself: log odds that it is gone at this Unix time, by its passes in the order of
/// time, each of another drive.
double LogOddsGone(const std::vector<PassSighting>& passes, int64_t now_s,
                   const PersistenceOptions& options);

/// A landmark with what is known of it.
struct WatchedLandmark {
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  std::vector<PassSighting> passes;  ///< as of LogOddsGone; may be none
  /// It is gone since before this Unix time, and only tells its neighbours.
  std::optional<int64_t> vanished_s = std::nullopt;
};

struct Vanishing {
  uint32_t idx = 0;
  double log_odds = 0;  ///< that it is gone, with what its neighbours say
  auto operator<=>(const Vanishing&) const = default;
};

/// Those that are gone at this Unix time, ascending.
std::vector<Vanishing> FindVanished(const std::vector<WatchedLandmark>& landmarks, int64_t now_s,
                                    const PersistenceOptions& options = {});

}  // namespace carmap
