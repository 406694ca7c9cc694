#include "carmap/solve/alignment.h"

#include <Eigen/SVD>

namespace carmap {
namespace {

using Positions = std::vector<Eigen::Vector3d>;

Eigen::Vector3d Mean(const Positions& positions) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& position : positions) sum += position;
  return sum / static_cast<double>(positions.size());
}

/// Mean of (b - mean of b)(a - mean of a)^T.
Eigen::Matrix3d CrossCovariance(const Positions& a, const Positions& b) {
  const Eigen::Vector3d mean_a = Mean(a), mean_b = Mean(b);
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < a.size(); ++i) sum += (b[i] - mean_b) * (a[i] - mean_a).transpose();
  return sum / static_cast<double>(a.size());
}

/// Points within a micrometre of each other stand still; what they tell of rotations is rounding.
constexpr double kSquaredStandstillM2 = 1e-12;

/// The rotation R with the largest trace(R^T covariance) (Umeyama 1991).
Eigen::Quaterniond BestRotation(const Eigen::Matrix3d& covariance) {
  // Singular values go with squared spreads: this is a width of 3 cm on a kilometre.
  constexpr double kOnOneLine = 1e-9;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d& values = svd.singularValues();
  if (values[0] <= kSquaredStandstillM2) return Eigen::Quaterniond::Identity();
  if (values[1] <= kOnOneLine * values[0]) {
    return Eigen::Quaterniond::FromTwoVectors(svd.matrixV().col(0), svd.matrixU().col(0))
        .normalized();
  }
  const double handedness = svd.matrixU().determinant() * svd.matrixV().determinant();
  const Eigen::Matrix3d rotation = svd.matrixU() *
                                   Eigen::Vector3d(1, 1, handedness < 0 ? -1 : 1).asDiagonal() *
                                   svd.matrixV().transpose();
  return Eigen::Quaterniond(rotation).normalized();
}

std::optional<Rigid3> Align(const Eigen::Matrix3d& covariance, const Positions& a,
                            const Positions& b) {
  if (!covariance.allFinite()) return std::nullopt;
  const Eigen::Quaterniond rotation = BestRotation(covariance);
  return Rigid3{rotation, Mean(b) - rotation * Mean(a)};
}

Positions PositionsOf(const std::vector<Rigid3>& poses) {
  Positions positions;
  positions.reserve(poses.size());
  for (const Rigid3& pose : poses) positions.push_back(pose.translation);
  return positions;
}

}  // namespace

std::optional<Rigid3> AlignRigidly(const Positions& a, const Positions& b) {
  if (a.size() < 3 || a.size() != b.size()) return std::nullopt;
  return Align(CrossCovariance(a, b), a, b);
}

std::optional<Rigid3> AlignTrajectories(const std::vector<Rigid3>& a_from_camera,
                                        const std::vector<Rigid3>& b_from_camera) {
  if (a_from_camera.size() < 3 || a_from_camera.size() != b_from_camera.size()) {
    return std::nullopt;
  }
  const Positions a = PositionsOf(a_from_camera), b = PositionsOf(b_from_camera);
  Eigen::Matrix3d orientations = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < a.size(); ++i) {
    orientations += b_from_camera[i].rotation.toRotationMatrix() *
                    a_from_camera[i].rotation.toRotationMatrix().transpose();
  }
  orientations /= static_cast<double>(a.size());
  constexpr double kSquaredAxisLengthM2 = 25;
  return Align(CrossCovariance(a, b) + kSquaredAxisLengthM2 * orientations, a, b);
}

}  // namespace carmap
