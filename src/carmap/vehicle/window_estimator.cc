#include "carmap/vehicle/window_estimator.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

namespace carmap {
namespace {

/// Square of the robust loss's width, in the chi-square bounds.
constexpr double kSquareWidth = 4;

}  // namespace

Matrix6d MotionCovariance(const Rigid3& camera_from_previous, const MotionNoise& noise) {
  const double distance_m = camera_from_previous.translation.norm();
  const double sigma_m = std::hypot(noise.step_m, noise.drift_ratio * distance_m);
  const double sigma_rad = std::hypot(noise.step_rad, noise.drift_rad_per_m * distance_m);
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(sigma_m * sigma_m);
  covariance.diagonal().tail<3>().setConstant(sigma_rad * sigma_rad);
  return covariance;
}

UncertainPose AfterMotion(const UncertainPose& before, const Rigid3& camera_from_previous,
                          const Matrix6d& motion_covariance) {
  const Matrix6d adjoint = AdjointOf(camera_from_previous);
  return {camera_from_previous * before.camera_from_base,
          adjoint * before.covariance * adjoint.transpose() + motion_covariance};
}

WindowEstimator::WindowEstimator(const StereoRig& rig, const WindowEstimatorOptions& options,
                                 const UncertainPose& start)
    : rig_(rig), options_(options), newest_(start) {
  prior_.camera_from_base = start.camera_from_base;
  prior_.information.topLeftCorner<6, 6>() = start.covariance.inverse();
  prior_.information(6, 6) = 1 / (options.motion.scale * options.motion.scale);
  frames_.push_back({.camera_from_base = start.camera_from_base});
}

void WindowEstimator::Add(const Rigid3& camera_from_previous, const Matrix6d& motion_covariance,
                          SeenLandmarks seen) {
  Frame frame{.camera_from_previous = camera_from_previous,
              .motion_covariance = motion_covariance,
              .seen = std::move(seen)};
  if (!IsKeyframe(frames_.back())) {
    const Matrix6d adjoint = AdjointOf(camera_from_previous);
    frame.camera_from_previous = camera_from_previous * frames_.back().camera_from_previous;
    frame.motion_covariance += adjoint * frames_.back().motion_covariance * adjoint.transpose();
    frames_.pop_back();
  }
  for (const PoseMeasurement& m : frame.seen.measurements) {
    frame.whitened.push_back(Whiten(options_.noise, m));
  }
  frame.camera_from_base = MotionOf(frame) * frames_.back().camera_from_base;
  frames_.push_back(std::move(frame));
  if (frames_.size() > options_.keyframes + 1) MarginalizeOldest();
  Solve();
}

/// Of frames side by side only the newest stays: a standing vehicle does not fill its window.
bool WindowEstimator::IsKeyframe(const Frame& frame) const {
  return frames_.size() == 1 ||
         frame.camera_from_previous.translation.norm() >= options_.keyframe_distance_m ||
         RotationAngle(frame.camera_from_previous.rotation) >= options_.keyframe_turn_rad;
}

/// Calls `visit(idx, p_in_camera, error, weight)` for each landmark in front of the frame.
template <typename Visit>
void WindowEstimator::VisitMeasurements(const Frame& frame, Visit&& visit) const {
  const Eigen::Matrix3d rotation = frame.camera_from_base.rotation.toRotationMatrix();
  const double observation_weight =
      options_.observation_weight * frame.seen.inlier_share * frame.seen.inlier_share;
  Eigen::Vector3d error;
  for (size_t i = 0; i < frame.whitened.size(); ++i) {
    const WhitenedMeasurement& m = frame.whitened[i];
    const Eigen::Vector3d p =
        rotation * frame.seen.measurements[i].position_in_map + frame.camera_from_base.translation;
    if (!WhitenedError(rig_, m, p, error)) continue;
    const double weight =
        observation_weight *
        GemanMcClureWeight(error.squaredNorm(), kSquareWidth * m.chi_square_bound);
    visit(i, p, error, weight);
  }
}

/// What the map's errors do to a pose by it: all its landmarks move by their common shift, and its
/// keyframes lie as uncertain as the frame does.
Matrix6d WindowEstimator::MapCovariance(const Frame& frame) const {
  constexpr size_t kMinLandmarks = 10;
  if (frame.whitened.size() < kMinLandmarks) return map_covariance_;
  PoseNormal normal;
  VisitMeasurements(
      frame, [&](size_t i, const Eigen::Vector3d& p, const Eigen::Vector3d&, double weight) {
        const WhitenedMeasurement& m = frame.whitened[i];
        const Eigen::Vector3d shift = frame.seen.common_shift_px[i].cwiseProduct(m.inverse_sigma);
        normal.Add(MakePointTerm(rig_, m, p, shift, weight), p);
      });
  const Matrix6d covariance = Matrix6d(normal.hessian.selfadjointView<Eigen::Lower>()).inverse();
  const Vector6d shift = covariance * normal.gradient;
  const Matrix6d result = shift * shift.transpose() + options_.map_jitter_ratio * covariance;
  return result.allFinite() ? result : map_covariance_;
}

/// Adds what depends on poses from frame `first` on and on the scale, its last variable.
void WindowEstimator::AddTerm(size_t first, const Eigen::MatrixXd& hessian,
                              const Eigen::VectorXd& gradient, Normal& normal) {
  const auto at = static_cast<Eigen::Index>(6 * first);
  const Eigen::Index scale = normal.gradient.size() - 1, poses = gradient.size() - 1;
  normal.hessian.block(at, at, poses, poses) += hessian.topLeftCorner(poses, poses);
  normal.hessian.block(at, scale, poses, 1) += hessian.topRightCorner(poses, 1);
  normal.hessian.block(scale, at, 1, poses) += hessian.bottomLeftCorner(1, poses);
  normal.hessian(scale, scale) += hessian(poses, poses);
  normal.gradient.segment(at, poses) += gradient.head(poses);
  normal.gradient(scale) += gradient(poses);
}

/// As long as it is in the map.
Rigid3 WindowEstimator::MotionOf(const Frame& frame) const {
  return {frame.camera_from_previous.rotation, scale_ * frame.camera_from_previous.translation};
}

void WindowEstimator::AddMotion(size_t idx, Normal& normal) const {
  const Frame& before = frames_[idx - 1];
  const Frame& frame = frames_[idx];
  const Rigid3 motion = MotionOf(frame);
  const Vector6d error = PoseDifference(motion * before.camera_from_base, frame.camera_from_base);
  // By the frame before, the frame itself, and the scale.
  Eigen::Matrix<double, 6, 13> jacobian;
  jacobian << -AdjointOf(motion), Matrix6d::Identity(), Vector6d::Zero();
  jacobian.topRightCorner<3, 1>() = -frame.camera_from_previous.translation;
  const Eigen::Matrix<double, 13, 6> weighted =
      jacobian.transpose() * frame.motion_covariance.inverse();
  AddTerm(idx - 1, weighted * jacobian, weighted * error, normal);
}

void WindowEstimator::AddPrior(Normal& normal) const {
  Vector7d moved;
  moved << PoseDifference(prior_.camera_from_base, frames_.front().camera_from_base),
      scale_ - prior_.scale;
  AddTerm(0, prior_.information, prior_.gradient + prior_.information * moved, normal);
}

/// Of the window's first frames and the motions between them, with what the first `measured` saw.
WindowEstimator::Normal WindowEstimator::Linearize(size_t frames, size_t measured) const {
  const auto size = static_cast<Eigen::Index>(6 * frames + 1);
  Normal normal{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
  AddPrior(normal);
  for (size_t i = 0; i < frames; ++i) {
    if (i > 0) AddMotion(i, normal);
    if (i >= measured) continue;
    PoseNormal seen;
    VisitMeasurements(frames_[i], [&](size_t k, const Eigen::Vector3d& p,
                                      const Eigen::Vector3d& error, double weight) {
      seen.Add(MakePointTerm(rig_, frames_[i].whitened[k], p, error, weight), p);
    });
    const auto at = static_cast<Eigen::Index>(6 * i);
    const Matrix6d hessian = seen.hessian.selfadjointView<Eigen::Lower>();
    normal.hessian.block<6, 6>(at, at) += hessian;
    normal.gradient.segment<6>(at) += seen.gradient;
  }
  return normal;
}

/// The scale wanders by a step meanwhile.
void WindowEstimator::MarginalizeOldest() {
  const Normal normal = Linearize(/*frames=*/2, /*measured=*/1);
  const Eigen::LDLT<Matrix6d> oldest(normal.hessian.topLeftCorner<6, 6>());
  const Eigen::Matrix<double, 7, 6> coupling = normal.hessian.bottomLeftCorner<7, 6>();
  const Matrix7d information =
      normal.hessian.bottomRightCorner<7, 7>() - coupling * oldest.solve(coupling.transpose());
  const Vector7d gradient =
      normal.gradient.tail<7>() - coupling * oldest.solve(normal.gradient.head<6>());
  Matrix7d covariance = information.inverse();
  const Vector7d mean = -covariance * gradient;
  covariance(6, 6) += options_.motion.scale_step * options_.motion.scale_step;
  prior_.camera_from_base = frames_[1].camera_from_base;
  prior_.scale = scale_;
  prior_.information = covariance.inverse();
  prior_.gradient = -prior_.information * mean;
  frames_.pop_front();
}

void WindowEstimator::Solve() {
  const size_t last = frames_.size() - 1;
  for (int i = 0;; ++i) {
    const Normal normal = Linearize(frames_.size(), frames_.size());
    const Eigen::LDLT<Eigen::MatrixXd> factors(normal.hessian);
    if (i == options_.iterations) {
      Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(normal.gradient.size(), 6);
      const auto at = static_cast<Eigen::Index>(6 * last);
      unit.middleRows<6>(at).setIdentity();
      const Eigen::MatrixXd columns = factors.solve(unit);
      map_covariance_ = MapCovariance(frames_[last]);
      newest_ = {frames_[last].camera_from_base, columns.middleRows<6>(at) + map_covariance_};
      return;
    }
    const Eigen::VectorXd step = factors.solve(-normal.gradient);
    for (size_t k = 0; k < frames_.size(); ++k) {
      frames_[k].camera_from_base =
          Perturb(frames_[k].camera_from_base, step.segment<6>(static_cast<Eigen::Index>(6 * k)));
    }
    scale_ += step.tail<1>().value();
    if (step.norm() < 1e-6) i = options_.iterations - 1;
  }
}

}  // namespace carmap
