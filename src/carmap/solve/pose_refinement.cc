#include "carmap/solve/pose_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

/// Squares of the robust loss's width, in the chi-square bounds: each is so many times narrower
/// than the one before. Narrower than the last, fewer measurements would have a say.
constexpr double kNarrowing = 4, kFinalSquareWidth = 4;
constexpr int kStepsPerWidth = 4, kFinalSteps = 8;
constexpr int kMinMeasurements = 3;

class PoseRefiner {
 public:
  PoseRefiner(const StereoRig& rig, const MeasurementNoise& noise,
              const std::vector<PoseMeasurement>& measurements, const Rigid3& initial,
              const std::optional<PosePrior>& prior)
      : rig_(rig), measurements_(measurements), prior_(prior), pose_(initial) {
    whitened_.reserve(measurements.size());
    active_.reserve(measurements.size());
    for (size_t i = 0; i < measurements.size(); ++i) {
      whitened_.push_back(Whiten(noise, measurements[i]));
      active_.push_back(i);
    }
  }

  /// Minimises over the active measurements with a loss whose square is so many times wider
  /// than the chi-square bounds.
  void Minimize(double square_width, int steps) {
    double lambda = 1e-6;
    Linearization current = Linearize(pose_, square_width);
    for (int step = 0; step < steps; ++step) {
      Vector6d delta;
      if (!SolveDamped(current.normal, lambda, delta)) return;
      const Rigid3 trial_pose = Perturb(pose_, delta);
      Linearization trial = Linearize(trial_pose, square_width);
      const bool is_converged =
          delta.norm() < 1e-6 || std::abs(current.cost - trial.cost) <= 1e-6 * current.cost;
      if (trial.cost <= current.cost) {
        pose_ = trial_pose;
        current = std::move(trial);
        lambda /= 10;
      } else {
        lambda = std::max(lambda, 1e-6) * 100;
      }
      if (is_converged) return;
    }
  }

  /// Makes the inliers at the present pose the active measurements.
  size_t SelectInliers() {
    const Eigen::Matrix3d rotation = pose_.rotation.toRotationMatrix();
    active_.clear();
    for (size_t i = 0; i < measurements_.size(); ++i) {
      const Eigen::Vector3d p = rotation * measurements_[i].position_in_map + pose_.translation;
      if (IsInlier(rig_, whitened_[i], p)) active_.push_back(i);
    }
    return active_.size();
  }

  PoseEstimate Estimate() const {
    PoseEstimate estimate{pose_, std::vector<bool>(measurements_.size(), false)};
    for (const size_t i : active_) estimate.is_inlier[i] = true;
    estimate.inlier_count = static_cast<int>(active_.size());
    const Eigen::LLT<Matrix6d> cholesky(Linearize(pose_, kNotRobust).normal.hessian);
    if (cholesky.info() == Eigen::Success) {
      const Matrix6d covariance = cholesky.solve(Matrix6d::Identity());
      if (covariance.allFinite()) estimate.covariance = covariance;
    }
    return estimate;
  }

 private:
  struct Linearization {
    PoseNormal normal;
    double cost = 0;
  };

  Linearization Linearize(const Rigid3& pose, double square_width) const {
    Linearization result;
    if (prior_) AddPrior(pose, result);
    const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
    Eigen::Vector3d error;
    for (const size_t i : active_) {
      const WhitenedMeasurement& m = whitened_[i];
      const Eigen::Vector3d p = rotation * measurements_[i].position_in_map + pose.translation;
      const bool visible = WhitenedError(rig_, m, p, error);
      const double chi_square = visible ? error.squaredNorm() : kInvisibleChiSquare;
      const double square_scale = square_width * m.chi_square_bound;
      result.cost += GemanMcClureCost(chi_square, square_scale);
      if (!visible) continue;
      const double weight = GemanMcClureWeight(chi_square, square_scale);
      result.normal.Add(MakePointTerm(rig_, m, p, error, weight), p);
    }
    return result;
  }

  void AddPrior(const Rigid3& pose, Linearization& result) const {
    const Vector6d difference = PoseDifference(prior_->camera_from_map, pose);
    const Vector6d gradient = prior_->information * difference;
    result.normal.hessian += prior_->information;
    result.normal.gradient += gradient;
    result.cost += difference.dot(gradient) / 2;
  }

  static bool SolveDamped(const PoseNormal& normal, double lambda, Vector6d& delta) {
    Matrix6d damped = normal.hessian;
    damped.diagonal() *= 1 + lambda;
    const Eigen::LLT<Matrix6d> cholesky(damped);
    if (cholesky.info() != Eigen::Success) return false;
    delta = cholesky.solve(-normal.gradient);
    return delta.allFinite();
  }

  const StereoRig& rig_;
  const std::vector<PoseMeasurement>& measurements_;
  const std::optional<PosePrior>& prior_;
  std::vector<WhitenedMeasurement> whitened_;
  std::vector<size_t> active_;
  Rigid3 pose_;
};

}  // namespace

PoseEstimate RefinePose(const StereoRig& rig, const MeasurementNoise& noise,
                        const std::vector<PoseMeasurement>& measurements,
                        const Rigid3& initial_camera_from_map, double initial_error_px,
                        const std::optional<PosePrior>& prior) {
  const PoseEstimate none{initial_camera_from_map, std::vector<bool>(measurements.size(), false)};
  if (measurements.size() < kMinMeasurements) return none;
  PoseRefiner refiner(rig, noise, measurements, initial_camera_from_map, prior);
  const double initial_chi_square = std::pow(initial_error_px / noise.pixel_px, 2);
  for (double square_width = initial_chi_square / kChiSquareBound3;
       square_width > kFinalSquareWidth; square_width /= kNarrowing) {
    refiner.Minimize(square_width, kStepsPerWidth);
  }
  refiner.Minimize(kFinalSquareWidth, kFinalSteps);
  if (refiner.SelectInliers() < kMinMeasurements) return none;
  refiner.Minimize(kNotRobust, kFinalSteps);
  return refiner.SelectInliers() < kMinMeasurements ? none : refiner.Estimate();
}

}  // namespace carmap
