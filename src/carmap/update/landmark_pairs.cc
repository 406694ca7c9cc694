#include "carmap/update/landmark_pairs.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <span>

#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

// What the views do not tell: a corner looks a little different from elsewhere, and the poses of
// the views err together.
constexpr double kPositionFloorM = 0.02;
// Views from one drive share their keyframes' errors, so more of them do not sharpen a position.
constexpr double kMaxViews = 3;
// So many views, evenly out of more, say how uncertain a position is.
constexpr size_t kViewsLookedAt = 64;
constexpr double kChiSquareBound = 11.345;  // 99 %, three degrees of freedom
constexpr int kMinPairs = 6;
constexpr double kMinRelativePivot = 1e-9;  // of normal equations that determine a transform
constexpr int kRounds = 4, kIterationsPerRound = 5;

double ChiSquare(const PointPair& pair, const Rigid3& base_from_segment,
                 const Eigen::Matrix3d& rotation, Eigen::Matrix3d& information,
                 Eigen::Vector3d& error) {
  information =
      (rotation * pair.segment_covariance * rotation.transpose() + pair.base_covariance).inverse();
  error = base_from_segment * pair.p_in_segment - pair.p_in_base;
  return error.dot(information * error);
}

/// Marks the inliers and returns their number.
int Classify(const std::vector<PointPair>& pairs, PairAlignment& alignment) {
  const Eigen::Matrix3d rotation = alignment.base_from_segment.rotation.toRotationMatrix();
  Eigen::Matrix3d information;
  Eigen::Vector3d error;
  alignment.inlier_count = 0;
  for (size_t i = 0; i < pairs.size(); ++i) {
    alignment.is_inlier[i] = ChiSquare(pairs[i], alignment.base_from_segment, rotation, information,
                                       error) <= kChiSquareBound;
    alignment.inlier_count += alignment.is_inlier[i];
  }
  return alignment.inlier_count;
}

/// One Gauss-Newton step, about the pairs' own centre: far from the map's origin a turn about that
/// would move them more than it turns them. False if the pairs leave a direction free.
bool Step(const std::vector<PointPair>& pairs, bool robust, PairAlignment& alignment) {
  Rigid3& base_from_segment = alignment.base_from_segment;
  const Eigen::Matrix3d rotation = base_from_segment.rotation.toRotationMatrix();
  const Eigen::Vector3d center = pairs.front().p_in_base;
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (!robust && !alignment.is_inlier[i]) continue;
    Eigen::Matrix3d information;
    Eigen::Vector3d error;
    const double chi_square = ChiSquare(pairs[i], base_from_segment, rotation, information, error);
    if (robust) information *= HuberWeight(chi_square, kChiSquareBound);
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian << Eigen::Matrix3d::Identity(), -CrossMatrix(pairs[i].p_in_base + error - center);
    hessian += jacobian.transpose() * information * jacobian;
    gradient += jacobian.transpose() * information * error;
  }
  const Eigen::LDLT<Matrix6d> solver(hessian);
  const Vector6d pivots = solver.vectorD();
  if (!(pivots.minCoeff() > kMinRelativePivot * pivots.maxCoeff())) return false;
  const Vector6d delta = solver.solve(-gradient);
  if (!delta.allFinite()) return false;
  const Rigid3 to_center{Eigen::Quaterniond::Identity(), -center};
  base_from_segment = to_center.Inverse() * Perturb(to_center * base_from_segment, delta);
  return true;
}

}  // namespace

Eigen::Matrix3d LandmarkCovariance(const ReconstructedMap& map, uint32_t landmark_idx,
                                   const MeasurementNoise& noise) {
  const SnapshotLandmark& landmark = map.snapshot.landmarks[landmark_idx];
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  double views = 0;
  const std::span<const uint32_t> viewers = map.keyframes_of_landmark[landmark_idx];
  const size_t looked_at = std::min(viewers.size(), kViewsLookedAt);
  for (size_t i = 0; i < looked_at; ++i) {
    const uint32_t keyframe_idx = viewers[i * viewers.size() / looked_at];
    const Rigid3& map_from_camera = map.snapshot.keyframes[keyframe_idx].map_from_camera;
    const Eigen::Vector3d p = map_from_camera.Inverse() * landmark.position_in_map;
    if (p.z() < 0.1) continue;
    const float level = std::clamp<float>(PredictLevel(landmark, p.norm()), 0, kLevelCount - 1);
    const WhitenedMeasurement view = Whiten(noise, {0, 0}, 1, std::pow(kLevelScale, level));
    const Eigen::Matrix3d jacobian = WhitenedErrorJacobian(RigOf(map, keyframe_idx), view, p) *
                                     map_from_camera.rotation.conjugate().toRotationMatrix();
    information += jacobian.transpose() * jacobian;
    ++views;
  }
  if (views > kMaxViews) information *= kMaxViews / views;
  constexpr double kLeastInformation = 1e-6;  // of a position known to a kilometre
  information.diagonal().array() += kLeastInformation;
  Eigen::Matrix3d covariance = information.inverse();
  covariance.diagonal().array() += kPositionFloorM * kPositionFloorM;
  return covariance;
}

std::vector<PointPair> PointsOf(const ReconstructedMap& base, const ReconstructedMap& segment,
                                const std::vector<LandmarkPair>& pairs,
                                const MeasurementNoise& noise) {
  std::vector<PointPair> points;
  points.reserve(pairs.size());
  for (const LandmarkPair& pair : pairs) {
    points.push_back({base.snapshot.landmarks[pair.base_idx].position_in_map,
                      segment.snapshot.landmarks[pair.segment_idx].position_in_map,
                      LandmarkCovariance(base, pair.base_idx, noise),
                      LandmarkCovariance(segment, pair.segment_idx, noise)});
  }
  return points;
}

std::optional<PairAlignment> AlignPairs(const std::vector<PointPair>& pairs,
                                        const Rigid3& initial_base_from_segment) {
  if (pairs.size() < kMinPairs) return std::nullopt;
  PairAlignment alignment{initial_base_from_segment, std::vector<bool>(pairs.size(), false), 0};
  for (int round = 0; round < kRounds; ++round) {
    const bool robust = round < kRounds / 2;
    for (int i = 0; i < kIterationsPerRound; ++i) {
      if (!Step(pairs, robust, alignment)) return std::nullopt;
    }
    if (Classify(pairs, alignment) < kMinPairs) return std::nullopt;
  }
  return alignment;
}

}  // namespace carmap
