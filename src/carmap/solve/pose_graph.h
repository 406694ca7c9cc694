// Poses from what is known about pairs of them: drift is spread over a drive once a loop closes.
//
// Stereo measures lengths, so poses are rigid: no scale (paper §5.4).
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/solve/position_prior.h"
#include "carmap/solve/reprojection.h"

namespace carmap {

/// A measured pose between two others.
struct PoseGraphEdge {
  uint32_t from_idx = 0, to_idx = 0;
  Rigid3 to_from_from;
  double sigma_m = 1, sigma_rad = 1;  ///< standard deviations of each axis
  /// An edge that may be altogether wrong, as a loop may: it loses its weight where it contradicts
  /// the others.
  bool is_robust = false;
};

/// How far off the pose of a keyframe relative to another of its drive is, as tracked: standard
/// deviations of each axis, so much and so much for each metre between them.
struct StepNoise {
  double sigma_m = 0.01, sigma_m_per_m = 0.01;
  double sigma_rad = 5e-4, sigma_rad_per_m = 3e-4;
  /// Where the two see nothing in common.
  double lost_sigma_m = 10, lost_sigma_rad = 0.2;
};

PoseGraphEdge StepEdge(uint32_t from_idx, uint32_t to_idx, const Rigid3& to_from_from,
                       const StepNoise& noise, bool is_lost);

/// The problem, and after SolvePoseGraph its solution. Priors are always robust. They are in the
/// map's frame: GPS fixes are brought there first (AlignToFixes).
struct PoseGraph {
  std::vector<Rigid3> camera_from_map;
  std::vector<bool> pose_is_fixed;  ///< one a pose; at least one should be, unless there are priors
  std::vector<PoseGraphEdge> edges;
  std::vector<PositionPrior> priors;
};

struct PoseGraphOptions {
  int max_iterations = 100;             ///< linear systems solved at most
  double min_relative_decrease = 1e-5;  ///< of the cost; ends a round
  const std::atomic<bool>* stop = nullptr;
};

struct PoseGraphSummary {
  double initial_cost = 0, final_cost = 0;  ///< half the sum of squared errors in sigmas, robust
  int iterations = 0;
  std::vector<double> edge_weights, prior_weights;  ///< at the solution, 0 … 1
};

/// Error of the edge in the tangent of Perturb (metres, radians), zero where the poses agree with
/// the measurement; and its derivatives by the two poses' tangents.
struct EdgeError {
  Vector6d error;
  Matrix6d by_from, by_to;
};
EdgeError LinearizeEdge(const PoseGraphEdge& edge, const Rigid3& from_from_map,
                        const Rigid3& to_from_map);

/// Levenberg-Marquardt on the sparse normal equations. Robust terms begin as plain squares and come
/// to their loss in rounds (graduated non-convexity; Yang, Antonante, Tzoumas and Carlone 2020), so
/// that the start need not be near: what agrees with the rest finds together, however far it was.
/// Throws std::invalid_argument when an index does not fit: a bug of the caller. Deterministic.
PoseGraphSummary SolvePoseGraph(PoseGraph& graph, const PoseGraphOptions& options = {});

}  // namespace carmap
