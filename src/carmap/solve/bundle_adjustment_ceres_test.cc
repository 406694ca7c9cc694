// The same least-squares problem solved by Ceres: its optimum is the one that AdjustBundle must
// reach.
#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <numbers>

#include "carmap/solve/bundle_adjustment.h"
#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

/// Parameters: the tangent of Perturb at the initial pose, and the point. Written from the camera
/// model alone, derivatives by differences: nothing is shared with the code under test.
struct StereoError {
  StereoRig rig;
  MeasurementNoise noise;
  BundleObservation observation;
  Rigid3 initial_pose;

  bool operator()(const double* tangent, const double* point, double* residual) const {
    const Eigen::Map<const Vector6d> delta(tangent);
    const Eigen::Vector3d p =
        Perturb(initial_pose, delta) * Eigen::Map<const Eigen::Vector3d>(point);
    const double pixel_sigma = noise.pixel_px * observation.scale;
    residual[0] =
        (rig.camera.fx * p.x() / p.z() + rig.camera.cx - observation.px.x()) / pixel_sigma;
    residual[1] =
        (rig.camera.fy * p.y() / p.z() + rig.camera.cy - observation.px.y()) / pixel_sigma;
    residual[2] = 0;
    if (observation.disparity_px > 0) {
      const double disparity = rig.camera.fx * rig.baseline_m / p.z();
      residual[2] =
          (disparity - observation.disparity_px) / (noise.disparity_px * observation.scale);
    }
    return true;
  }
};

struct PriorErrorOfPose {
  PositionPrior prior;
  Rigid3 initial_pose;

  bool operator()(const double* tangent, double* residual) const {
    const Eigen::Map<const Vector6d> delta(tangent);
    const Eigen::Vector3d center = Perturb(initial_pose, delta).Inverse().translation;
    Eigen::Map<Eigen::Vector3d>(residual, 3) =
        prior.sqrt_information * (center - prior.position_in_map);
    return true;
  }
};

/// Geman and McClure's, from its formula.
class RobustLoss : public ceres::LossFunction {
 public:
  void Evaluate(double s, double* rho) const override {
    const double c = kPriorSquareScale;
    rho[0] = c * s / (c + s);
    rho[1] = c * c / ((c + s) * (c + s));
    rho[2] = -2 * c * c / ((c + s) * (c + s) * (c + s));
  }
};

double SolveWithCeres(Bundle& bundle) {
  std::vector<Vector6d> tangents(bundle.camera_from_map.size(), Vector6d::Zero());
  ceres::Problem problem;
  for (const BundleObservation& o : bundle.observations) {
    auto* error = new StereoError{bundle.rig, bundle.noise, o, bundle.camera_from_map[o.pose_idx]};
    problem.AddResidualBlock(
        new ceres::NumericDiffCostFunction<StereoError, ceres::CENTRAL, 3, 6, 3>(error),
        new ceres::HuberLoss(std::sqrt(o.disparity_px > 0 ? 7.815 : 5.991)),
        tangents[o.pose_idx].data(), bundle.points_in_map[o.point_idx].data());
  }
  for (const PositionPrior& prior : bundle.priors) {
    problem.AddResidualBlock(
        new ceres::NumericDiffCostFunction<PriorErrorOfPose, ceres::CENTRAL, 3, 6>(
            new PriorErrorOfPose{prior, bundle.camera_from_map[prior.pose_idx]}),
        new ceres::ScaledLoss(new RobustLoss, prior.weight, ceres::TAKE_OWNERSHIP),
        tangents[prior.pose_idx].data());
  }
  for (size_t i = 0; i < tangents.size(); ++i) {
    if (bundle.pose_is_fixed[i]) problem.SetParameterBlockConstant(tangents[i].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (size_t i = 0; i < tangents.size(); ++i) {
    bundle.camera_from_map[i] = Perturb(bundle.camera_from_map[i], tangents[i]);
  }
  return summary.final_cost;
}

void ExpectTheSameOptimum(Bundle ours, double max_distance_m, double max_rotation_rad) {
  Bundle theirs = ours;
  const BundleSummary summary = AdjustBundle(
      ours, {.robust_iterations = 60, .final_iterations = 0, .min_relative_decrease = 1e-13});
  const double their_cost = SolveWithCeres(theirs);
  EXPECT_NEAR(summary.final_cost, their_cost, 1e-6 * their_cost);
  for (size_t i = 0; i < ours.camera_from_map.size(); ++i) {
    EXPECT_LT(DistanceBetween(ours.camera_from_map[i], theirs.camera_from_map[i]), max_distance_m);
    EXPECT_LT(RotationBetween(ours.camera_from_map[i], theirs.camera_from_map[i]),
              max_rotation_rad);
  }
}

TEST(BundleAdjustmentCeresTest, ReachesTheSameOptimum) {
  TestRandom random(12);
  Bundle ours = MakeBundle(5, 100, {1, 0.7, 0.05, 0.2}, random);
  Disturb(ours, 0.05, 0.003, random);
  ExpectTheSameOptimum(ours, 1e-4, 1e-5);
}

/// A drive of which each point is seen from a stretch only, so that most blocks of the reduced
/// system are zero, that ends where it began. Fixes give its place instead of fixed poses; some are
/// wrong.
Bundle MakeRound(TestRandom& random) {
  constexpr int kPoses = 40, kPoints = 300;
  constexpr double kTurn = 2 * std::numbers::pi / (kPoses - 10);
  Bundle bundle{.rig = kTestRig, .noise = kTestNoise};
  Rigid3 map_from_camera;
  for (int i = 0; i < kPoses; ++i) {
    bundle.camera_from_map.push_back(map_from_camera.Inverse());
    bundle.pose_is_fixed.push_back(false);
    PositionPrior prior{static_cast<uint32_t>(i), map_from_camera.translation + random.Normal3(1)};
    prior.weight = 0.5;
    prior.sqrt_information(0, 2) = 0.4;
    if (i % 20 < 2) prior.position_in_map.x() += 50;
    bundle.priors.push_back(prior);
    map_from_camera = map_from_camera * Rigid3{RotationExp({0, kTurn, 0}), {0, 0, 1}};
  }
  for (uint32_t j = 0; j < kPoints; ++j) {
    const Rigid3& seen_from = bundle.camera_from_map[j % kPoses];
    const Eigen::Vector3d point =
        seen_from.Inverse() *
        kTestRig.camera.Unproject({random.Uniform(0, 1225), random.Uniform(0, 369)},
                                  random.Uniform(4, 12));
    bundle.points_in_map.push_back(point);
    for (uint32_t i = 0; i < kPoses; ++i) {
      const Eigen::Vector3d p = bundle.camera_from_map[i] * point;
      if (p.z() < 2 || p.z() > 12 || !kTestRig.camera.Contains(kTestRig.camera.Project(p)))
        continue;
      BundleObservation& o = bundle.observations.emplace_back();
      o.pose_idx = i;
      o.point_idx = j;
      Measure(p, {1, 0.7, 0.05, 0.2}, random, o);
    }
  }
  return bundle;
}

TEST(BundleAdjustmentCeresTest, ReachesTheSameOptimumOfALongDriveWithFixes) {
  TestRandom random(4);
  Bundle ours = MakeRound(random);
  Disturb(ours, 0.05, 0.003, random);
  ExpectTheSameOptimum(ours, 1e-3, 1e-4);
}

}  // namespace
}  // namespace carmap
