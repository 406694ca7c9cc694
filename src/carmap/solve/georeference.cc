#include "carmap/solve/georeference.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>

#include "carmap/solve/position_prior.h"

namespace carmap {
namespace {

constexpr int kSamples = 500, kRefinements = 10;
// Parts of the path's length, by which it may be bent: mostly less than at worst.
constexpr double kMaxDriftRatio = 0.02, kUsualDriftRatio = 0.005;
constexpr double kTiltSigmaRad = 0.03;  // between the cameras' mean up and the Earth's

/// Error bounds in standard deviations take the path's drift for a part of each fix's error.
class Alignment {
 public:
  Alignment(const std::vector<CameraFix>& fixes, uint64_t seed) : fixes_(fixes), random_(seed) {
    Eigen::Vector3d up = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < fixes.size(); ++i) {
      up -= fixes[i].map_from_camera.rotation * Eigen::Vector3d::UnitY();
      if (i > 0) length_m_ += (Center(i) - Center(i - 1)).norm();
    }
    up_in_map_ = up.normalized();
    level_from_map_ = Eigen::Quaterniond::FromTwoVectors(up_in_map_, Eigen::Vector3d::UnitZ());
    for (size_t i = 1; i < fixes.size(); ++i) {
      extent_m_ = std::max(extent_m_, (Center(i) - Center(0)).norm());
    }
  }

  std::optional<Rigid3> Run(double min_extent_m) {
    if (fixes_.size() < 2 || extent_m_ < min_extent_m) return std::nullopt;
    drift_m_ = kMaxDriftRatio * length_m_;
    std::optional<Rigid3> best;
    double best_cost = 0;
    for (int i = 0; i < kSamples; ++i) {
      const auto sample = Sample();
      if (!sample) continue;
      const double cost = Cost(*sample);
      if (best && cost >= best_cost) continue;
      best = sample;
      best_cost = cost;
    }
    if (!best) return std::nullopt;
    for (const double drift_ratio : {kMaxDriftRatio, kUsualDriftRatio}) {
      drift_m_ = drift_ratio * length_m_;
      for (int i = 0; i < kRefinements; ++i) Refine(*best);
    }
    if (!(ExtentOfInliers(*best) >= min_extent_m) || !MostAgree(*best)) return std::nullopt;
    return best;
  }

 private:
  Eigen::Vector3d Center(size_t i) const { return fixes_[i].map_from_camera.translation; }

  /// Not std::uniform_int_distribution, whose output differs between standard libraries.
  size_t DrawIndex() { return (random_() >> 32) * fixes_.size() >> 32; }

  /// Heading and place by two fixes that lie well apart.
  std::optional<Rigid3> Sample() {
    const size_t a = DrawIndex(), b = DrawIndex();
    const Eigen::Vector3d level_a = level_from_map_ * Center(a),
                          level_b = level_from_map_ * Center(b);
    const Eigen::Vector3d level = level_b - level_a, enu = fixes_[b].p_in_enu - fixes_[a].p_in_enu;
    if (level.head<2>().norm() < extent_m_ / 4) return std::nullopt;
    const double turn = std::atan2(enu.y(), enu.x()) - std::atan2(level.y(), level.x());
    const Eigen::Quaterniond rotation = RotationExp({0, 0, turn}) * level_from_map_;
    const Eigen::Vector3d middle = (fixes_[a].p_in_enu + fixes_[b].p_in_enu) / 2;
    return Rigid3{rotation.normalized(), middle - rotation * (Center(a) + Center(b)) / 2};
  }

  Eigen::Vector3d InverseSigma(size_t i) const {
    return (fixes_[i].sigma_m.array().square() + drift_m_ * drift_m_).rsqrt();
  }
  double ChiSquare(const Rigid3& enu_from_map, size_t i) const {
    return (enu_from_map * Center(i) - fixes_[i].p_in_enu)
        .cwiseProduct(InverseSigma(i))
        .squaredNorm();
  }
  double Cost(const Rigid3& enu_from_map) const {
    double cost = 0;
    for (size_t i = 0; i < fixes_.size(); ++i) {
      cost += GemanMcClureCost(ChiSquare(enu_from_map, i), kPriorSquareScale);
    }
    return cost;
  }

  /// A Gauss-Newton step about the place of the first fix: about the origin of `enu`, which may be
  /// far, turns and moves would be hard to tell apart.
  void Refine(Rigid3& enu_from_map) const {
    Matrix6d hessian = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    const Eigen::Vector3d origin = enu_from_map * Center(0);
    for (size_t i = 0; i < fixes_.size(); ++i) {
      const double weight = GemanMcClureWeight(ChiSquare(enu_from_map, i), kPriorSquareScale);
      const Eigen::Vector3d inverse_sigma = InverseSigma(i), p_in_enu = enu_from_map * Center(i);
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << Eigen::Matrix3d::Identity(), -CrossMatrix(p_in_enu - origin);
      jacobian = inverse_sigma.asDiagonal() * jacobian;
      hessian += weight * jacobian.transpose() * jacobian;
      gradient += weight * jacobian.transpose() *
                  (p_in_enu - fixes_[i].p_in_enu).cwiseProduct(inverse_sigma);
    }
    const Eigen::Vector3d up = enu_from_map.rotation * up_in_map_;
    const Eigen::Matrix<double, 2, 3> tilt = -CrossMatrix(up).topRows<2>() / kTiltSigmaRad;
    hessian.bottomRightCorner<3, 3>() += tilt.transpose() * tilt;
    gradient.tail<3>() += tilt.transpose() * up.head<2>() / kTiltSigmaRad;
    const Vector6d step = Eigen::LDLT<Matrix6d>(hessian).solve(-gradient);
    if (!step.allFinite()) return;
    const Rigid3 from_origin{Eigen::Quaterniond::Identity(), origin};
    enu_from_map = from_origin * Perturb(from_origin.Inverse() * enu_from_map, step);
  }

  /// By a bound that half of the fixes of another path would hardly keep, if it spans as much.
  bool MostAgree(const Rigid3& enu_from_map) const {
    constexpr double kMaxSigmas = 2;
    size_t agreeing = 0;
    for (size_t i = 0; i < fixes_.size(); ++i) {
      const Eigen::Vector3d error = enu_from_map * Center(i) - fixes_[i].p_in_enu;
      agreeing += error.cwiseProduct(InverseSigma(i)).head<2>().norm() <= kMaxSigmas;
    }
    return 2 * agreeing > fixes_.size();
  }

  double ExtentOfInliers(const Rigid3& enu_from_map) const {
    std::optional<Eigen::Vector3d> first;
    double extent_m = 0;
    for (size_t i = 0; i < fixes_.size(); ++i) {
      if (ChiSquare(enu_from_map, i) > kPriorSquareScale) continue;
      if (!first) first = Center(i);
      extent_m = std::max(extent_m, (Center(i) - *first).norm());
    }
    return extent_m;
  }

  const std::vector<CameraFix>& fixes_;
  std::mt19937_64 random_;
  Eigen::Vector3d up_in_map_;
  Eigen::Quaterniond level_from_map_;
  double length_m_ = 0, extent_m_ = 0, drift_m_ = 0;
};

}  // namespace

std::optional<Rigid3> AlignToFixes(const std::vector<CameraFix>& fixes, double min_extent_m,
                                   uint64_t seed) {
  return Alignment(fixes, seed).Run(min_extent_m);
}

}  // namespace carmap
