// The Levenberg-Marquardt loop that bundle adjustment and pose graphs share.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>

namespace carmap {

struct LevenbergOptions {
  int max_iterations = 10;
  double min_relative_decrease = 1e-4;  ///< of the cost; a smaller one ends the search
  /// When it becomes true the best state so far is kept. May be null.
  const std::atomic<bool>* stop = nullptr;
};

/// A problem has
///   double Linearize();              cost and normal equations at the present state
///   bool SolveDamped(double lambda); makes the trial state; false if the system is singular
///   double TrialCost();
///   void AcceptTrial();
/// Returns the number of linear systems solved.
template <typename Problem>
int MinimizeLevenberg(Problem& problem, const LevenbergOptions& options) {
  constexpr double kInitialLambda = 1e-4, kMinLambda = 1e-10, kMaxLambda = 1e10;
  const auto is_stopped = [&] {
    return options.stop != nullptr && options.stop->load(std::memory_order_relaxed);
  };
  double lambda = kInitialLambda;
  double cost = problem.Linearize();
  int iterations = 0;
  while (iterations < options.max_iterations && lambda < kMaxLambda && !is_stopped()) {
    ++iterations;
    if (!problem.SolveDamped(lambda)) {
      lambda *= 10;
      continue;
    }
    const double trial_cost = problem.TrialCost();
    const bool is_converged = std::abs(cost - trial_cost) <= options.min_relative_decrease * cost;
    if (trial_cost <= cost) {
      problem.AcceptTrial();
      lambda = std::max(lambda / 10, kMinLambda);
      if (is_converged || iterations == options.max_iterations) break;
      cost = problem.Linearize();
    } else {
      lambda *= 10;
      if (is_converged) break;
    }
  }
  return iterations;
}

}  // namespace carmap
