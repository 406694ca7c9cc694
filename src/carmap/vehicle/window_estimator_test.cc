#include "carmap/vehicle/window_estimator.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

const StereoRig kRig{{700, 700, 620, 188, 1241, 376}, 0.54};

/// A vehicle that drives along z between landmarks, one metre a frame.
class Drive {
 public:
  explicit Drive(uint64_t seed, const WindowEstimatorOptions& options = {})
      : random_(seed), options_(options), scale_(1 + random_.Normal(options.motion.scale)) {}

  Rigid3 TruePose() const {
    return Rigid3{RotationExp({0, 0.02 * std::sin(0.1 * z_m_), 0}), {0, 0, z_m_}}.Inverse();
  }
  UncertainPose Start(double sigma_m, double sigma_rad) {
    UncertainPose start{Perturb(TruePose(), random_.Tangent(sigma_m, sigma_rad)), {}};
    start.covariance.setZero();
    start.covariance.diagonal().head<3>().setConstant(sigma_m * sigma_m);
    start.covariance.diagonal().tail<3>().setConstant(sigma_rad * sigma_rad);
    return start;
  }
  /// The next frame's motion as odometry measures it.
  Rigid3 Move(double step_m) {
    const Rigid3 before = TruePose();
    z_m_ += step_m;
    const Rigid3 motion = TruePose() * before.Inverse();
    const Matrix6d covariance = MotionCovariance(motion, options_.motion);
    return Perturb({motion.rotation, scale_ * motion.translation},
                   random_.Tangent(std::sqrt(covariance(0, 0)), std::sqrt(covariance(3, 3))));
  }
  /// What the frame sees of landmarks drawn anew, so that errors of measurements are independent.
  SeenLandmarks See(int count) {
    std::vector<PoseMeasurement> measurements;
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d p_in_camera(random_.Uniform(-8, 8), random_.Uniform(-3, 1.5),
                                        random_.Uniform(5, 40));
      const Eigen::Vector3d uvd = kRig.Project(p_in_camera);
      measurements.push_back({.position_in_map = TruePose().Inverse() * p_in_camera,
                              .px = {uvd.x() + random_.Normal(0.5), uvd.y() + random_.Normal(0.5)},
                              .disparity_px = uvd.z() + random_.Normal(0.5)});
    }
    return {measurements,
            std::vector<Eigen::Vector3d>(measurements.size(), Eigen::Vector3d::Zero())};
  }
  double SquaredMahalanobis(const UncertainPose& estimate) const {
    const Vector6d error = PoseDifference(estimate.camera_from_base, TruePose());
    return error.dot(estimate.covariance.ldlt().solve(error));
  }

 private:
  TestRandom random_;
  const WindowEstimatorOptions options_;
  const double scale_;  ///< of the odometry
  double z_m_ = 0;
};

WindowEstimatorOptions Independent() {
  WindowEstimatorOptions options;
  options.observation_weight = 1;
  options.map_jitter_ratio = 0;
  return options;
}

TEST(WindowEstimator, CovarianceIsTrueWhileItSeesTheBaseAndWhileItDoesNot) {
  constexpr double kBound95 = 12.592;  // of six degrees of freedom
  int frames[2] = {}, within[2] = {};
  for (uint64_t seed = 1; seed <= 40; ++seed) {
    Drive drive(seed, Independent());
    WindowEstimator window(kRig, Independent(), drive.Start(0.2, 0.01));
    for (int frame = 0; frame < 40; ++frame) {
      const bool sees = frame < 20;
      const Rigid3 motion = drive.Move(1);
      window.Add(motion, MotionCovariance(motion, Independent().motion),
                 sees ? drive.See(15) : SeenLandmarks());
      if (frame < 3) continue;
      ++frames[sees];
      within[sees] += drive.SquaredMahalanobis(window.newest()) < kBound95;
    }
  }
  for (const int sees : {0, 1}) {
    const double share = static_cast<double>(within[sees]) / frames[sees];
    EXPECT_GT(share, 0.91) << sees;
    EXPECT_LT(share, 0.99) << sees;
  }
}

TEST(WindowEstimator, IsBetterThanASingleFrameAndGrowsUncertainWithoutTheBase) {
  Drive drive(7, Independent());
  WindowEstimator window(kRig, Independent(), drive.Start(0.2, 0.01));
  const auto sigma_m = [&] { return std::sqrt(window.newest().covariance(0, 0)); };
  const auto step = [&](int seen) {
    const Rigid3 motion = drive.Move(1);
    window.Add(motion, MotionCovariance(motion, Independent().motion), drive.See(seen));
  };
  step(8);
  const double first_m = sigma_m();
  for (int i = 0; i < 15; ++i) step(8);
  const double settled_m = sigma_m();
  EXPECT_LT(settled_m, 0.7 * first_m);
  for (int i = 0; i < 30; ++i) step(0);
  EXPECT_GT(sigma_m(), 3 * settled_m);
}

TEST(WindowEstimator, AWrongMeasurementDoesNotDrawIt) {
  Drive drive(3, Independent());
  WindowEstimator window(kRig, Independent(), drive.Start(0.05, 0.002));
  for (int i = 0; i < 10; ++i) {
    const Rigid3 motion = drive.Move(1);
    auto seen = drive.See(20);
    for (int wrong = 0; wrong < 4; ++wrong) seen.measurements[wrong].px.x() += 25;
    window.Add(motion, MotionCovariance(motion, Independent().motion), seen);
  }
  const Vector6d error = PoseDifference(window.newest().camera_from_base, drive.TruePose());
  EXPECT_LT(error.head<3>().norm(), 0.06);
}

TEST(WindowEstimator, StandingKeepsWhatTheDriveBeforeTold) {
  Drive drive(5, Independent());
  WindowEstimator window(kRig, Independent(), drive.Start(0.2, 0.01));
  for (int i = 0; i < 12; ++i) {
    const Rigid3 motion = drive.Move(1);
    window.Add(motion, MotionCovariance(motion, Independent().motion), drive.See(30));
  }
  const double driven_m = std::sqrt(window.newest().covariance(0, 0));
  for (int i = 0; i < 200; ++i) {
    const Rigid3 motion = drive.Move(0);
    window.Add(motion, MotionCovariance(motion, Independent().motion), drive.See(30));
  }
  // One of the frames where it stands counts, not two hundred.
  EXPECT_GT(std::sqrt(window.newest().covariance(0, 0)), 0.5 * driven_m);
  EXPECT_LT(PoseDifference(window.newest().camera_from_base, drive.TruePose()).head<3>().norm(),
            0.1);
}

// All landmarks lie as much to the side: the vehicle seems turned, in each frame alike.
TEST(WindowEstimator, WhatTheMapsErrorsHaveInCommonIsNotAveragedOut) {
  const Eigen::Vector3d shift_px(1, 0, 0);
  for (const bool knows : {true, false}) {
    Drive drive(13, Independent());
    WindowEstimator window(kRig, Independent(), drive.Start(0.2, 0.01));
    for (int i = 0; i < 20; ++i) {
      const Rigid3 motion = drive.Move(1);
      SeenLandmarks seen = drive.See(40);
      for (size_t k = 0; k < seen.measurements.size(); ++k) {
        seen.measurements[k].px += shift_px.head<2>();
        if (knows) seen.common_shift_px[k] = shift_px;
      }
      window.Add(motion, MotionCovariance(motion, Independent().motion), seen);
    }
    EXPECT_EQ(drive.SquaredMahalanobis(window.newest()) < 12.6, knows);
  }
}

// What a frame sees lies where the map's keyframes saw it, whose own poses are off by as much as
// one frame's landmarks leave open.
TEST(WindowEstimator, IsNoSurerThanTheMapsOwnKeyframes) {
  constexpr double kBound95 = 12.592;
  TestRandom random(17);
  for (const double ratio : {0.0, 0.5}) {
    WindowEstimatorOptions options = Independent();
    options.map_jitter_ratio = ratio;
    int frames = 0, within = 0;
    for (uint64_t seed = 1; seed <= 20; ++seed) {
      Drive drive(seed, options);
      WindowEstimator window(kRig, options, drive.Start(0.2, 0.01));
      for (int frame = 0; frame < 20; ++frame) {
        const Rigid3 motion = drive.Move(1);
        const SeenLandmarks seen = drive.See(15);
        window.Add(motion, MotionCovariance(motion, options.motion), seen);
        if (frame < 3) continue;
        const PoseEstimate alone =
            RefinePose(kRig, options.noise, seen.measurements, drive.TruePose());
        Vector6d jitter = Vector6d::Zero();
        for (int i = 0; i < 6; ++i) jitter(i) = random.Normal(std::sqrt(0.5));
        jitter = alone.covariance.llt().matrixL() * jitter;
        const Vector6d error =
            PoseDifference(window.newest().camera_from_base, Perturb(drive.TruePose(), jitter));
        ++frames;
        within += error.dot(window.newest().covariance.ldlt().solve(error)) < kBound95;
      }
    }
    const double share = static_cast<double>(within) / frames;
    if (ratio > 0) {
      EXPECT_GT(share, 0.91);
      EXPECT_LT(share, 0.99);
    } else {
      EXPECT_LT(share, 0.8);
    }
  }
}

TEST(PoseDifference, UndoesPerturbAndItsAdjointCarriesItAlong) {
  TestRandom random(11);
  for (int i = 0; i < 20; ++i) {
    const Rigid3 a{RotationExp(random.Normal3(1)), random.Normal3(5)};
    const Rigid3 motion{RotationExp(random.Normal3(0.3)), random.Normal3(3)};
    const Vector6d delta = random.Tangent(0.5, 0.3);
    EXPECT_LT((PoseDifference(a, Perturb(a, delta)) - delta).norm(), 1e-9);
    const Vector6d small = 1e-6 * delta;
    const Vector6d carried = PoseDifference(motion * a, motion * Perturb(a, small));
    EXPECT_LT((carried - AdjointOf(motion) * small).norm(), 1e-10);
  }
}

}  // namespace
}  // namespace carmap
