#include "carmap/solve/pose_graph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "carmap/solve/block_system.h"
#include "carmap/solve/levenberg_marquardt.h"

namespace carmap {
namespace {

constexpr double kMinDampedDiagonal = 1e-6;
constexpr double kScaleStep = 2;  // between rounds, of the squared scales
/// Ten standard deviations. A right edge must be dearer to drop than to obey, and errors of an edge
/// have six parts.
constexpr double kEdgeSquareScale = 100;

Eigen::Vector3d RotationLog(Eigen::Quaterniond q) {
  if (q.w() < 0) q.coeffs() *= -1;
  const double sine = q.vec().norm();
  if (sine < 1e-9) return 2 * q.vec();
  return 2 * std::atan2(sine, q.w()) / sine * q.vec();
}

/// d RotationLog(RotationExp(w) q) / d w at w = 0, where `log` is RotationLog(q).
Eigen::Matrix3d LogJacobian(const Eigen::Vector3d& log) {
  const double angle = log.norm();
  const Eigen::Matrix3d cross = CrossMatrix(log);
  const double factor =
      angle < 1e-4 ? 1.0 / 12 : 1 / (angle * angle) - 1 / (2 * angle * std::tan(angle / 2));
  return Eigen::Matrix3d::Identity() - cross / 2 + factor * cross * cross;
}

Rigid3 Residual(const PoseGraphEdge& edge, const Rigid3& from_from_map, const Rigid3& to_from_map) {
  return to_from_map * from_from_map.Inverse() * edge.to_from_from.Inverse();
}

void CheckIndices(const PoseGraph& graph) {
  const size_t count = graph.camera_from_map.size();
  bool fits = graph.pose_is_fixed.size() == count;
  for (const PoseGraphEdge& edge : graph.edges) {
    fits &= edge.from_idx < count && edge.to_idx < count && edge.from_idx != edge.to_idx;
  }
  for (const PositionPrior& prior : graph.priors) fits &= prior.pose_idx < count;
  if (!fits) throw std::invalid_argument("pose graph: an edge or prior names a pose not there");
}

class PoseGraphSolver {
 public:
  explicit PoseGraphSolver(PoseGraph& graph) : graph_(graph), poses_(graph.camera_from_map) {
    for (const bool is_fixed : graph.pose_is_fixed) {
      free_idx_.push_back(is_fixed ? kFixed : free_count_++);
    }
    BlockPattern pattern(free_count_);
    for (const PoseGraphEdge& edge : graph.edges) {
      const uint32_t a = free_idx_[edge.from_idx], b = free_idx_[edge.to_idx];
      if (a != kFixed && b != kFixed) pattern.Add(a, b);
    }
    system_ = BlockSystem(pattern);
  }

  PoseGraphSummary Run(const PoseGraphOptions& options) {
    PoseGraphSummary summary;
    summary.initial_cost = Cost(poses_);
    for (widening_ = kNotRobust; summary.iterations < options.max_iterations;) {
      summary.iterations +=
          MinimizeLevenberg(*this, {.max_iterations = options.max_iterations - summary.iterations,
                                    .min_relative_decrease = options.min_relative_decrease,
                                    .stop = options.stop});
      if (widening_ <= 1 || IsStopped(options)) break;
      widening_ = std::max(std::min(2 * WorstRobustError(), widening_ / kScaleStep), 1.0);
    }
    widening_ = 1;
    summary.final_cost = Cost(poses_);
    for (const PoseGraphEdge& edge : graph_.edges) {
      summary.edge_weights.push_back(WeightOf(edge, ChiSquare(edge, poses_)));
    }
    for (const PositionPrior& prior : graph_.priors) {
      summary.prior_weights.push_back(WeightOf(prior, ChiSquare(prior, poses_)));
    }
    graph_.camera_from_map = std::move(poses_);
    return summary;
  }

  double Linearize() {
    diagonal_.assign(free_count_, Matrix6d::Zero());
    gradient_.setZero(6 * static_cast<Eigen::Index>(free_count_));
    cross_.assign(graph_.edges.size(), Matrix6d::Zero());
    for (size_t i = 0; i < graph_.edges.size(); ++i) AddEdge(graph_.edges[i], cross_[i]);
    for (const PositionPrior& prior : graph_.priors) {
      const uint32_t idx = free_idx_[prior.pose_idx];
      if (idx == kFixed) continue;
      Vector6d gradient = Vector6d::Zero();
      AddPrior(prior, poses_[prior.pose_idx], WeightOf(prior, ChiSquare(prior, poses_)),
               diagonal_[idx], gradient);
      gradient_.segment<6>(6 * static_cast<Eigen::Index>(idx)) += gradient;
    }
    return Cost(poses_);
  }

  bool SolveDamped(double lambda) {
    system_.SetZero();
    for (uint32_t i = 0; i < free_count_; ++i) {
      Matrix6d& block = system_.Block(i, i);
      block = diagonal_[i];
      block.diagonal() += lambda * diagonal_[i].diagonal().cwiseMax(kMinDampedDiagonal);
    }
    for (size_t i = 0; i < graph_.edges.size(); ++i) {
      const uint32_t from = free_idx_[graph_.edges[i].from_idx];
      const uint32_t to = free_idx_[graph_.edges[i].to_idx];
      if (from == kFixed || to == kFixed) continue;
      if (to > from) {
        system_.Block(to, from) += cross_[i];
      } else {
        system_.Block(from, to) += cross_[i].transpose();
      }
    }
    Eigen::VectorXd step = -gradient_;
    if (!system_.Solve(step)) return false;
    trial_ = poses_;
    for (size_t i = 0; i < poses_.size(); ++i) {
      if (free_idx_[i] == kFixed) continue;
      trial_[i] = Perturb(poses_[i], step.segment<6>(6 * static_cast<Eigen::Index>(free_idx_[i])));
    }
    return true;
  }

  double TrialCost() const { return Cost(trial_); }
  void AcceptTrial() { std::swap(poses_, trial_); }

 private:
  static constexpr uint32_t kFixed = std::numeric_limits<uint32_t>::max();
  using Poses = std::vector<Rigid3>;

  static bool IsStopped(const PoseGraphOptions& options) {
    return options.stop != nullptr && options.stop->load(std::memory_order_relaxed);
  }

  static double ChiSquare(const PoseGraphEdge& edge, const Poses& poses) {
    const Rigid3 residual = Residual(edge, poses[edge.from_idx], poses[edge.to_idx]);
    return residual.translation.squaredNorm() / (edge.sigma_m * edge.sigma_m) +
           RotationLog(residual.rotation).squaredNorm() / (edge.sigma_rad * edge.sigma_rad);
  }
  static double ChiSquare(const PositionPrior& prior, const Poses& poses) {
    return PriorError(prior, poses[prior.pose_idx]).squaredNorm();
  }

  double Weight(double chi_square, double square_scale) const {
    return GemanMcClureWeight(chi_square, widening_ * square_scale);
  }
  double WeightOf(const PoseGraphEdge& edge, double chi_square) const {
    return edge.is_robust ? Weight(chi_square, kEdgeSquareScale) : 1;
  }
  double WeightOf(const PositionPrior&, double chi_square) const {
    return Weight(chi_square, kPriorSquareScale);
  }

  double RobustCost(double chi_square, double square_scale) const {
    return GemanMcClureCost(chi_square, widening_ * square_scale);
  }
  double Cost(const Poses& poses) const {
    double cost = 0;
    for (const PoseGraphEdge& edge : graph_.edges) {
      const double chi_square = ChiSquare(edge, poses);
      cost += edge.is_robust ? RobustCost(chi_square, kEdgeSquareScale) : chi_square / 2;
    }
    for (const PositionPrior& prior : graph_.priors) {
      cost += prior.weight * RobustCost(ChiSquare(prior, poses), kPriorSquareScale);
    }
    return cost;
  }

  /// The largest squared error of a robust term, as a multiple of its squared scale.
  double WorstRobustError() const {
    double worst = 0;
    for (const PoseGraphEdge& edge : graph_.edges) {
      if (edge.is_robust) worst = std::max(worst, ChiSquare(edge, poses_) / kEdgeSquareScale);
    }
    for (const PositionPrior& prior : graph_.priors) {
      worst = std::max(worst, ChiSquare(prior, poses_) / kPriorSquareScale);
    }
    return worst;
  }

  void AddEdge(const PoseGraphEdge& edge, Matrix6d& cross) {
    const EdgeError linear = LinearizeEdge(edge, poses_[edge.from_idx], poses_[edge.to_idx]);
    Vector6d information;
    information.head<3>().setConstant(1 / (edge.sigma_m * edge.sigma_m));
    information.tail<3>().setConstant(1 / (edge.sigma_rad * edge.sigma_rad));
    information *= WeightOf(edge, linear.error.dot(information.cwiseProduct(linear.error)));
    const Matrix6d weighted_to = information.asDiagonal() * linear.by_to;
    const Matrix6d weighted_from = information.asDiagonal() * linear.by_from;
    const Vector6d weighted_error = information.cwiseProduct(linear.error);
    const uint32_t from = free_idx_[edge.from_idx], to = free_idx_[edge.to_idx];
    if (from != kFixed) {
      diagonal_[from] += linear.by_from.transpose() * weighted_from;
      gradient_.segment<6>(6 * static_cast<Eigen::Index>(from)) +=
          linear.by_from.transpose() * weighted_error;
    }
    if (to != kFixed) {
      diagonal_[to] += linear.by_to.transpose() * weighted_to;
      gradient_.segment<6>(6 * static_cast<Eigen::Index>(to)) +=
          linear.by_to.transpose() * weighted_error;
    }
    cross = linear.by_to.transpose() * weighted_from;
  }

  PoseGraph& graph_;
  Poses poses_, trial_;
  std::vector<uint32_t> free_idx_;  ///< of a pose, or kFixed
  uint32_t free_count_ = 0;
  double widening_ = 1;  ///< of the squared scales of the robust terms, in this round
  BlockSystem system_;
  std::vector<Matrix6d> diagonal_, cross_;  ///< by free pose; by edge, rows of `to`
  Eigen::VectorXd gradient_;
};

}  // namespace

PoseGraphEdge StepEdge(uint32_t from_idx, uint32_t to_idx, const Rigid3& to_from_from,
                       const StepNoise& noise, bool is_lost) {
  const double distance_m = to_from_from.translation.norm();
  const double sigma_m =
      is_lost ? noise.lost_sigma_m : noise.sigma_m + noise.sigma_m_per_m * distance_m;
  const double sigma_rad =
      is_lost ? noise.lost_sigma_rad : noise.sigma_rad + noise.sigma_rad_per_m * distance_m;
  return {from_idx, to_idx, to_from_from, sigma_m, sigma_rad, /*is_robust=*/false};
}

EdgeError LinearizeEdge(const PoseGraphEdge& edge, const Rigid3& from_from_map,
                        const Rigid3& to_from_map) {
  const Rigid3 to_from_from = to_from_map * from_from_map.Inverse();
  const Rigid3 from_from_to = edge.to_from_from.Inverse();  // as measured
  const Rigid3 residual = to_from_from * from_from_to;
  const Eigen::Matrix3d turn = to_from_from.rotation.toRotationMatrix();
  EdgeError result;
  result.error << residual.translation, RotationLog(residual.rotation);
  const Eigen::Matrix3d log_jacobian = LogJacobian(result.error.tail<3>());
  result.by_to << Eigen::Matrix3d::Identity(), -CrossMatrix(residual.translation),
      Eigen::Matrix3d::Zero(), log_jacobian;
  result.by_from << -turn, turn * CrossMatrix(from_from_to.translation), Eigen::Matrix3d::Zero(),
      -log_jacobian * turn;
  return result;
}

PoseGraphSummary SolvePoseGraph(PoseGraph& graph, const PoseGraphOptions& options) {
  CheckIndices(graph);
  return PoseGraphSolver(graph).Run(options);
}

}  // namespace carmap
