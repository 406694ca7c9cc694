#include "bundle_bench.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <fmt/format.h>

#include <array>
#include <vector>

#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/solve/bundle_adjustment.h"
#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

constexpr int kIterations = 8;

/// Parameters: angle-axis and translation of camera_from_map, and the point.
struct StereoError {
  const StereoRig& rig;
  const MeasurementNoise& noise;
  const BundleObservation& observation;

  template <typename T>
  bool operator()(const T* pose, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(pose, point, p);
    for (int i = 0; i < 3; ++i) p[i] += pose[3 + i];
    const double pixel_sigma = noise.pixel_px * observation.scale;
    residual[0] = (rig.camera.fx * p[0] / p[2] + rig.camera.cx - observation.px.x()) / pixel_sigma;
    residual[1] = (rig.camera.fy * p[1] / p[2] + rig.camera.cy - observation.px.y()) / pixel_sigma;
    residual[2] = T(0);
    if (observation.disparity_px > 0) {
      residual[2] = (rig.camera.fx * rig.baseline_m / p[2] - observation.disparity_px) /
                    (noise.disparity_px * observation.scale);
    }
    return true;
  }
};

double SolveWithCeres(Bundle bundle) {
  std::vector<std::array<double, 6>> poses;
  for (const Rigid3& pose : bundle.camera_from_map) {
    const Eigen::AngleAxisd turn(pose.rotation);
    const Eigen::Vector3d w = turn.angle() * turn.axis(), t = pose.translation;
    poses.push_back({w.x(), w.y(), w.z(), t.x(), t.y(), t.z()});
  }
  ceres::Problem problem;
  for (const BundleObservation& o : bundle.observations) {
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<StereoError, 3, 6, 3>(
            new StereoError{bundle.rig, bundle.noise, o}),
        new ceres::HuberLoss(std::sqrt(o.disparity_px > 0 ? kChiSquareBound3 : kChiSquareBound2)),
        poses[o.pose_idx].data(), bundle.points_in_map[o.point_idx].data());
  }
  for (size_t i = 0; i < poses.size(); ++i) {
    if (bundle.pose_is_fixed[i]) problem.SetParameterBlockConstant(poses[i].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = kIterations;
  options.function_tolerance = 0;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.final_cost;
}

}  // namespace

void BenchBundleAdjustment() {
  TestRandom random(1);
  Bundle bundle =
      MakeBundle(12, 2000, {.pixel_px = 1, .disparity_px = 0.7, .outlier_ratio = 0.05}, random);
  Disturb(bundle, 0.05, 0.003, random);
  std::vector<double> our_ms, ceres_ms;
  double our_cost = 0, ceres_cost = 0;
  for (int repeat = 0; repeat < 5; ++repeat) {
    Bundle ours = bundle;
    Stopwatch watch;
    our_cost = AdjustBundle(ours, {.robust_iterations = kIterations,
                                   .final_iterations = 0,
                                   .min_relative_decrease = 0})
                   .final_cost;
    our_ms.push_back(watch.ElapsedMs());
    watch = Stopwatch();
    ceres_cost = SolveWithCeres(bundle);
    ceres_ms.push_back(watch.ElapsedMs());
  }
  const double ours = Summarize(our_ms).median, theirs = Summarize(ceres_ms).median;
  fmt::print(
      "\nbundle adjustment, 12 poses, {} points, {} observations, {} iterations, one thread\n",
      bundle.points_in_map.size(), bundle.observations.size(), kIterations);
  fmt::print("{:<44} {:>8.2f} ms {:>8.3f} x  cost {:.1f}\n",
             "Ceres, DENSE_SCHUR, automatic derivatives", theirs, 1.0, ceres_cost);
  fmt::print("{:<44} {:>8.2f} ms {:>8.3f} x  cost {:.1f}\n", "carmap::AdjustBundle", ours,
             ours / theirs, our_cost);
}

}  // namespace carmap
