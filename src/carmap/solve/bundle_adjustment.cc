#include "carmap/solve/bundle_adjustment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <stdexcept>
#include <utility>

#include "carmap/solve/block_system.h"
#include "carmap/solve/levenberg_marquardt.h"
#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

/// Below this a diagonal element is damped as if it were this large: directions without
/// information.
constexpr double kMinDampedDiagonal = 1e-6;
constexpr int kFixed = -1;

struct PointNormal {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
};

/// Hessian block between a pose (rows) and a point (columns).
using CrossBlock = Eigen::Matrix<double, 6, 3>;

struct State {
  std::vector<Rigid3> camera_from_map;
  std::vector<Eigen::Vector3d> points_in_map;
  Eigen::Vector3d disparity_bias_px;
};

struct Projection {
  uint32_t pose_idx = 0;
  int free_idx = kFixed;
  WhitenedMeasurement measurement;
  Eigen::Vector3d bias_basis;  ///< 1, x, x² of DisparityBias
};

void CheckIndices(const Bundle& bundle) {
  if (bundle.pose_is_fixed.size() != bundle.camera_from_map.size()) {
    throw std::invalid_argument("bundle: pose_is_fixed needs one entry a pose");
  }
  for (const BundleObservation& observation : bundle.observations) {
    if (observation.pose_idx >= bundle.camera_from_map.size() ||
        observation.point_idx >= bundle.points_in_map.size()) {
      throw std::invalid_argument("bundle: an observation names a pose or point that is not there");
    }
  }
  for (const PositionPrior& prior : bundle.priors) {
    if (prior.pose_idx >= bundle.camera_from_map.size()) {
      throw std::invalid_argument("bundle: a prior names a pose that is not there");
    }
  }
}

template <typename Matrix>
void DampDiagonal(double lambda, Matrix& hessian) {
  hessian.diagonal() += lambda * hessian.diagonal().cwiseMax(kMinDampedDiagonal);
}

/// Stable counting sort of `items` by key(item) < key_count; `begin` gets key_count + 1 offsets.
template <typename Key>
std::vector<uint32_t> SortByKey(const std::vector<uint32_t>& items, size_t key_count, Key key,
                                std::vector<uint32_t>& begin) {
  begin.assign(key_count + 1, 0);
  for (const uint32_t item : items) ++begin[key(item) + 1];
  for (size_t k = 0; k < key_count; ++k) begin[k + 1] += begin[k];
  std::vector<uint32_t> next(begin.begin(), begin.end() - 1), sorted(items.size());
  for (const uint32_t item : items) sorted[next[key(item)]++] = item;
  return sorted;
}

/// target -= row * column^T, a column at a time in registers: most of a step's time goes here.
void SubtractProduct(const CrossBlock& row, const CrossBlock& column, Matrix6d& target) {
  for (int c = 0; c < 6; ++c) {
    Vector6d sum = target.col(c);
    for (int k = 0; k < 3; ++k) sum -= row.col(k) * column(c, k);
    target.col(c) = sum;
  }
}

class BundleAdjuster {
 public:
  explicit BundleAdjuster(Bundle& bundle)
      : bundle_(bundle),
        state_{bundle.camera_from_map, bundle.points_in_map,
               bundle.rig.disparity_bias.coefficients_px} {
    free_idx_.reserve(bundle.camera_from_map.size());
    for (const bool is_fixed : bundle.pose_is_fixed) {
      free_idx_.push_back(is_fixed ? kFixed : free_count_++);
    }
    whitened_.reserve(bundle.observations.size());
    for (const BundleObservation& o : bundle.observations) {
      whitened_.push_back(Whiten(bundle.noise, o.px, o.disparity_px, o.scale));
    }
  }

  BundleSummary Run(const BundleOptions& options) {
    BundleSummary summary;
    estimates_bias_ = options.estimate_disparity_bias;
    MakeReducedSystem();
    bias_information_ = 1 / (options.bias_step_sigma_px * options.bias_step_sigma_px);
    max_bias_px_ = options.max_bias_px;
    summary.is_outlier.assign(bundle_.observations.size(), false);
    GroupByPoint(summary.is_outlier);
    summary.initial_cost = Cost(state_);
    summary.iterations += Minimize(options.robust_iterations, options);
    ClassifyOutliers(summary.is_outlier);
    if (options.final_iterations > 0) {
      GroupByPoint(summary.is_outlier);
      summary.iterations += Minimize(options.final_iterations, options);
      ClassifyOutliers(summary.is_outlier);
    }
    GroupByPoint(std::vector<bool>(bundle_.observations.size(), false));
    summary.final_cost = Cost(state_);
    bundle_.camera_from_map = std::move(state_.camera_from_map);
    bundle_.points_in_map = std::move(state_.points_in_map);
    bundle_.rig.disparity_bias.coefficients_px = state_.disparity_bias_px;
    return summary;
  }

  /// Normal equations at the state: pose blocks, point blocks and the blocks between them.
  double Linearize() {
    UpdateRotations(state_);
    pose_normals_.assign(free_count_, PoseNormal());
    point_normals_.assign(state_.points_in_map.size(), PointNormal());
    cross_blocks_.resize(projections_.size());
    bias_normal_ = PoseNormal();
    bias_normal_.hessian.diagonal() << bias_information_, bias_information_, bias_information_, 1,
        1, 1;
    bias_normal_.gradient.head<3>() = bias_information_ * BiasChange(state_);
    bias_pose_blocks_.assign(free_count_, Matrix6d::Zero());
    bias_point_blocks_.assign(state_.points_in_map.size(), CrossBlock::Zero());
    double cost = CostOfPriors(state_);
    for (const PositionPrior& prior : bundle_.priors) LinearizePrior(prior);
    for (size_t j = 0; j < state_.points_in_map.size(); ++j) {
      for (uint32_t k = point_begin_[j]; k < point_begin_[j + 1]; ++k) {
        cost += LinearizeProjection(j, k);
      }
    }
    return cost;
  }

  /// The damped step from state_ to trial_: eliminate the points, solve for the poses, then each
  /// point by itself. False when the system is singular.
  bool SolveDamped(double lambda) {
    FactorPoints(lambda);
    BuildReducedSystem(lambda);
    if (!reduced_.Solve(pose_step_)) return false;
    trial_ = state_;
    if (estimates_bias_) {
      trial_.disparity_bias_px = (state_.disparity_bias_px + pose_step_.segment<3>(6 * free_count_))
                                     .cwiseMax(-max_bias_px_)
                                     .cwiseMin(max_bias_px_);
    }
    for (size_t i = 0; i < free_idx_.size(); ++i) {
      if (free_idx_[i] == kFixed) continue;
      trial_.camera_from_map[i] =
          Perturb(state_.camera_from_map[i], pose_step_.segment<6>(6 * free_idx_[i]));
    }
    MovePoints();
    return true;
  }

  double TrialCost() { return Cost(trial_); }
  void AcceptTrial() { std::swap(state_, trial_); }

 private:
  struct Eliminated {
    int free_idx;      ///< block of the reduced system
    CrossBlock block;  ///< W L^-T
  };

  int Minimize(int max_iterations, const BundleOptions& options) {
    return MinimizeLevenberg(*this, {.max_iterations = max_iterations,
                                     .min_relative_decrease = options.min_relative_decrease,
                                     .stop = options.stop});
  }

  /// Blocks between poses that see a point in common, and all of the disparity bias.
  void MakeReducedSystem() {
    std::vector<std::vector<uint32_t>> viewers(bundle_.points_in_map.size());
    for (const BundleObservation& o : bundle_.observations) {
      if (free_idx_[o.pose_idx] != kFixed) viewers[o.point_idx].push_back(free_idx_[o.pose_idx]);
    }
    BlockPattern pattern(free_count_ + (estimates_bias_ ? 1 : 0));
    for (const std::vector<uint32_t>& poses : viewers) {
      for (size_t a = 0; a < poses.size(); ++a) {
        for (size_t b = 0; b < a; ++b) pattern.Add(poses[a], poses[b]);
      }
    }
    if (estimates_bias_) {
      for (int i = 0; i < free_count_; ++i) pattern.Add(free_count_, i);
    }
    reduced_ = BlockSystem(pattern);
  }

  /// Brings the observations that count into the order the solver runs through: by point, and of
  /// one point by pose, so that pairs fill the lower triangle of the reduced system.
  void GroupByPoint(const std::vector<bool>& is_outlier) {
    const std::vector<BundleObservation>& observations = bundle_.observations;
    std::vector<uint32_t> order;
    order.reserve(observations.size());
    for (uint32_t i = 0; i < observations.size(); ++i) {
      if (!is_outlier[i]) order.push_back(i);
    }
    order = SortByKey(
        order, state_.camera_from_map.size(), [&](uint32_t i) { return observations[i].pose_idx; },
        point_begin_);
    order = SortByKey(
        order, state_.points_in_map.size(), [&](uint32_t i) { return observations[i].point_idx; },
        point_begin_);
    projections_.clear();
    projections_.reserve(order.size());
    for (const uint32_t i : order) {
      const uint32_t pose_idx = observations[i].pose_idx;
      projections_.push_back(
          {pose_idx, free_idx_[pose_idx], whitened_[i], BiasBasis(observations[i])});
    }
  }

  void ClassifyOutliers(std::vector<bool>& is_outlier) const {
    for (size_t i = 0; i < whitened_.size(); ++i) {
      const BundleObservation& o = bundle_.observations[i];
      const Eigen::Vector3d p =
          state_.camera_from_map[o.pose_idx] * state_.points_in_map[o.point_idx];
      is_outlier[i] = !IsInlier(bundle_.rig, WithoutBias(whitened_[i], BiasBasis(o), state_), p);
    }
  }

  double Cost(const State& state) {
    UpdateRotations(state);
    double cost = CostOfPriors(state);
    Eigen::Vector3d error;
    for (size_t j = 0; j < state.points_in_map.size(); ++j) {
      for (uint32_t k = point_begin_[j]; k < point_begin_[j + 1]; ++k) {
        const Projection& projection = projections_[k];
        const bool visible = WhitenedError(
            bundle_.rig, WithoutBias(projection.measurement, projection.bias_basis, state),
            InCamera(state, projection.pose_idx, j), error);
        cost += HuberCost(visible ? error.squaredNorm() : kInvisibleChiSquare,
                          projection.measurement.chi_square_bound);
      }
    }
    return cost;
  }

  void LinearizePrior(const PositionPrior& prior) {
    const int free_idx = free_idx_[prior.pose_idx];
    if (free_idx == kFixed) return;
    const Rigid3& pose = state_.camera_from_map[prior.pose_idx];
    PoseNormal& normal = pose_normals_[free_idx];
    AddPrior(prior, pose,
             GemanMcClureWeight(PriorError(prior, pose).squaredNorm(), kPriorSquareScale),
             normal.hessian, normal.gradient);
  }

  double CostOfPriors(const State& state) const {
    double cost = bias_information_ / 2 * BiasChange(state).squaredNorm();
    for (const PositionPrior& prior : bundle_.priors) {
      cost +=
          prior.weight *
          GemanMcClureCost(PriorError(prior, state.camera_from_map[prior.pose_idx]).squaredNorm(),
                           kPriorSquareScale);
    }
    return cost;
  }

  double LinearizeProjection(size_t point_idx, uint32_t k) {
    const Projection& projection = projections_[k];
    const double bound = projection.measurement.chi_square_bound;
    const Eigen::Vector3d p = InCamera(state_, projection.pose_idx, point_idx);
    Eigen::Vector3d error;
    const WhitenedMeasurement measurement =
        WithoutBias(projection.measurement, projection.bias_basis, state_);
    if (!WhitenedError(bundle_.rig, measurement, p, error)) {
      cross_blocks_[k].setZero();
      return HuberCost(kInvisibleChiSquare, bound);
    }
    const double chi_square = error.squaredNorm();
    const double weight = HuberWeight(chi_square, bound);
    const PointTerm term = MakePointTerm(bundle_.rig, measurement, p, error, weight);
    const Eigen::Matrix3d& rotation = rotations_[projection.pose_idx];
    const Eigen::Matrix3d camera_by_map = term.hessian.lazyProduct(rotation);
    PointNormal& point = point_normals_[point_idx];
    point.hessian += rotation.transpose().lazyProduct(camera_by_map);
    point.gradient += rotation.transpose() * term.gradient;
    if (projection.free_idx != kFixed) {
      pose_normals_[projection.free_idx].Add(term, p);
      cross_blocks_[k].topRows<3>() = camera_by_map;
      cross_blocks_[k].bottomRows<3>() = CrossColumns(p, camera_by_map);
    }
    if (estimates_bias_) LinearizeBias(point_idx, projection, measurement, p, weight, error.z());
    return HuberCost(chi_square, bound);
  }

  /// The bias enters the disparity's error alone, which moves with the point's depth alone.
  void LinearizeBias(size_t point_idx, const Projection& projection,
                     const WhitenedMeasurement& measurement, const Eigen::Vector3d& p,
                     double weight, double error) {
    const double inverse_sigma = measurement.inverse_sigma.z();
    if (inverse_sigma == 0) return;
    const Eigen::Vector3d basis = inverse_sigma * projection.bias_basis;
    bias_normal_.hessian.topLeftCorner<3, 3>() += weight * basis * basis.transpose();
    bias_normal_.gradient.head<3>() += weight * error * basis;
    const double by_depth =
        -weight * inverse_sigma * bundle_.rig.camera.fx * bundle_.rig.baseline_m / (p.z() * p.z());
    bias_point_blocks_[point_idx].topRows<3>() +=
        by_depth * basis * rotations_[projection.pose_idx].row(2);
    if (projection.free_idx != kFixed) {
      Eigen::Matrix<double, 1, 6> depth_by_pose;
      depth_by_pose << 0, 0, 1, p.y(), -p.x(), 0;
      bias_pose_blocks_[projection.free_idx].topRows<3>() += by_depth * basis * depth_by_pose;
    }
  }

  /// Cholesky factors L of the damped point blocks. A point without information has none.
  void FactorPoints(double lambda) {
    point_factors_.resize(point_normals_.size());
    for (size_t j = 0; j < point_normals_.size(); ++j) {
      Eigen::Matrix3d damped = point_normals_[j].hessian;
      DampDiagonal(lambda, damped);
      point_factors_[j].compute(damped);
    }
  }

  bool IsMovable(size_t point_idx) const {
    return point_begin_[point_idx] < point_begin_[point_idx + 1] &&
           point_factors_[point_idx].info() == Eigen::Success;
  }

  /// S = U - W V^-1 W^T and its right side, from the factors W L^-T, whose products give W V^-1
  /// W^T.
  void BuildReducedSystem(double lambda) {
    reduced_.SetZero();
    pose_step_.resize(6 * static_cast<Eigen::Index>(reduced_.block_count()));
    for (int i = 0; i < free_count_; ++i) {
      Matrix6d& diagonal = reduced_.Block(i, i);
      diagonal = pose_normals_[i].hessian;
      DampDiagonal(lambda, diagonal);
      pose_step_.segment<6>(6 * i) = -pose_normals_[i].gradient;
    }
    if (estimates_bias_) {
      for (int i = 0; i < free_count_; ++i) reduced_.Block(free_count_, i) = bias_pose_blocks_[i];
      Matrix6d& diagonal = reduced_.Block(free_count_, free_count_);
      diagonal = bias_normal_.hessian;
      DampDiagonal(lambda, diagonal);
      pose_step_.segment<6>(6 * free_count_) = -bias_normal_.gradient;
    }
    for (size_t j = 0; j < point_normals_.size(); ++j) {
      if (IsMovable(j)) EliminatePoint(j);
    }
  }

  void EliminatePoint(size_t point_idx) {
    const Eigen::Matrix3d factor = point_factors_[point_idx].matrixL();
    const Eigen::Matrix3d inverse_factor =
        factor.triangularView<Eigen::Lower>().solve(Eigen::Matrix3d::Identity());
    const Eigen::Vector3d gradient = inverse_factor * point_normals_[point_idx].gradient;
    eliminated_.clear();
    for (uint32_t k = point_begin_[point_idx]; k < point_begin_[point_idx + 1]; ++k) {
      const int free_idx = projections_[k].free_idx;
      if (free_idx != kFixed)
        EliminateBlock({free_idx, cross_blocks_[k].lazyProduct(inverse_factor.transpose())},
                       gradient);
    }
    if (estimates_bias_) {
      EliminateBlock(
          {free_count_, bias_point_blocks_[point_idx].lazyProduct(inverse_factor.transpose())},
          gradient);
    }
  }

  void EliminateBlock(const Eliminated& added, const Eigen::Vector3d& gradient) {
    eliminated_.push_back(added);
    const Eliminated& row = eliminated_.back();
    pose_step_.segment<6>(6 * row.free_idx) += row.block.lazyProduct(gradient);
    for (const Eliminated& column : eliminated_) {
      Matrix6d& target = reduced_.Block(row.free_idx, column.free_idx);
      SubtractProduct(row.block, column.block, target);
      if (&row != &column && row.free_idx == column.free_idx) {
        SubtractProduct(column.block, row.block, target);
      }
    }
  }

  void MovePoints() {
    for (size_t j = 0; j < point_normals_.size(); ++j) {
      if (!IsMovable(j)) continue;
      Eigen::Vector3d gradient = point_normals_[j].gradient;
      for (uint32_t k = point_begin_[j]; k < point_begin_[j + 1]; ++k) {
        const int free_idx = projections_[k].free_idx;
        if (free_idx == kFixed) continue;
        gradient += cross_blocks_[k].transpose() * pose_step_.segment<6>(6 * free_idx);
      }
      if (estimates_bias_) {
        gradient += bias_point_blocks_[j].transpose() * pose_step_.segment<6>(6 * free_count_);
      }
      trial_.points_in_map[j] -= point_factors_[j].solve(gradient);
    }
  }

  void UpdateRotations(const State& state) {
    rotations_.clear();
    for (const Rigid3& pose : state.camera_from_map) {
      rotations_.push_back(pose.rotation.toRotationMatrix());
    }
  }

  /// Uses the rotations of the last UpdateRotations.
  Eigen::Vector3d InCamera(const State& state, uint32_t pose_idx, size_t point_idx) const {
    return rotations_[pose_idx] * state.points_in_map[point_idx] +
           state.camera_from_map[pose_idx].translation;
  }

  /// (1, x, x²) of DisparityBias at the observation.
  Eigen::Vector3d BiasBasis(const BundleObservation& o) const {
    const double x = (o.px.x() - bundle_.rig.camera.cx) / bundle_.rig.camera.fx;
    return {1, x, x * x};
  }
  static WhitenedMeasurement WithoutBias(WhitenedMeasurement measurement,
                                         const Eigen::Vector3d& basis, const State& state) {
    measurement.uvd.z() -= basis.dot(state.disparity_bias_px);
    return measurement;
  }
  Eigen::Vector3d BiasChange(const State& state) const {
    return state.disparity_bias_px - bundle_.rig.disparity_bias.coefficients_px;
  }

  Bundle& bundle_;
  State state_, trial_;
  std::vector<int> free_idx_;  ///< of a pose, or kFixed
  int free_count_ = 0;
  std::vector<WhitenedMeasurement> whitened_;  ///< of an observation

  std::vector<Projection> projections_;  ///< the observations that count
  std::vector<uint32_t> point_begin_;    ///< into projections_

  bool estimates_bias_ = false;
  double bias_information_ = 0, max_bias_px_ = 0;
  PoseNormal bias_normal_;                     ///< its first three rows count
  std::vector<Matrix6d> bias_pose_blocks_;     ///< Hessian between the bias and a free pose
  std::vector<CrossBlock> bias_point_blocks_;  ///< Hessian between the bias and a point

  std::vector<Eigen::Matrix3d> rotations_;

  std::vector<PoseNormal> pose_normals_;
  std::vector<PointNormal> point_normals_;
  std::vector<CrossBlock> cross_blocks_;  ///< of a projection; unset where the pose is fixed
  std::vector<Eigen::LLT<Eigen::Matrix3d>> point_factors_;
  std::vector<Eliminated> eliminated_;
  BlockSystem reduced_;        ///< the free poses, then the disparity bias if it is estimated
  Eigen::VectorXd pose_step_;  ///< right side of the reduced system, then its solution
};

}  // namespace

BundleSummary AdjustBundle(Bundle& bundle, const BundleOptions& options) {
  CheckIndices(bundle);
  return BundleAdjuster(bundle).Run(options);
}

}  // namespace carmap
