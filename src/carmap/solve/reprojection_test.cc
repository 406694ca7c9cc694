#include "carmap/solve/reprojection.h"

#include <gtest/gtest.h>

#include <limits>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

constexpr double kStep = 1e-6;

struct Sample {
  WhitenedMeasurement measurement;
  Eigen::Vector3d p_in_map;
  Rigid3 camera_from_map;

  Eigen::Vector3d ErrorAt(const Rigid3& pose, const Eigen::Vector3d& point) const {
    Eigen::Vector3d error;
    EXPECT_TRUE(WhitenedError(kTestRig, measurement, pose * point, error));
    return error;
  }
};

std::vector<Sample> MakeSamples() {
  TestRandom random(7);
  std::vector<Sample> samples;
  for (int i = 0; i < 20; ++i) {
    const Rigid3 pose = random.Pose(1, 0.5);
    const Eigen::Vector3d p = random.PointInCamera();
    const Eigen::Vector2d px = kTestRig.camera.Project(p) + Eigen::Vector2d(3, -2);
    const double disparity = i % 2 == 0 ? kTestRig.DisparityAt(p.z()) + 1 : -1;
    samples.push_back({Whiten({1.5, 0.6}, px, disparity, 1.2), pose.Inverse() * p, pose});
  }
  return samples;
}

/// Central differences of the error in the tangent of Perturb and in the point's position.
Eigen::Matrix<double, 3, 6> NumericPoseJacobian(const Sample& s) {
  Eigen::Matrix<double, 3, 6> jacobian;
  for (int c = 0; c < 6; ++c) {
    const Vector6d step = kStep * Vector6d::Unit(c);
    jacobian.col(c) = (s.ErrorAt(Perturb(s.camera_from_map, step), s.p_in_map) -
                       s.ErrorAt(Perturb(s.camera_from_map, -step), s.p_in_map)) /
                      (2 * kStep);
  }
  return jacobian;
}

Eigen::Matrix3d NumericPointJacobian(const Sample& s) {
  Eigen::Matrix3d jacobian;
  for (int c = 0; c < 3; ++c) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(c);
    jacobian.col(c) = (s.ErrorAt(s.camera_from_map, s.p_in_map + step) -
                       s.ErrorAt(s.camera_from_map, s.p_in_map - step)) /
                      (2 * kStep);
  }
  return jacobian;
}

TEST(ReprojectionTest, PointJacobianIsTheNumericOne) {
  for (const Sample& s : MakeSamples()) {
    const Eigen::Matrix3d analytic =
        WhitenedErrorJacobian(kTestRig, s.measurement, s.camera_from_map * s.p_in_map) *
        s.camera_from_map.rotation.toRotationMatrix();
    const Eigen::Matrix3d numeric = NumericPointJacobian(s);
    EXPECT_LT((analytic - numeric).norm(), 1e-6 * numeric.norm());
  }
}

TEST(ReprojectionTest, PoseJacobianIsTheNumericOne) {
  for (const Sample& s : MakeSamples()) {
    const Eigen::Vector3d p = s.camera_from_map * s.p_in_map;
    Eigen::Matrix<double, 3, 6> of_point;
    of_point << Eigen::Matrix3d::Identity(), -CrossMatrix(p);
    const Eigen::Matrix<double, 3, 6> analytic =
        WhitenedErrorJacobian(kTestRig, s.measurement, p) * of_point;
    const Eigen::Matrix<double, 3, 6> numeric = NumericPoseJacobian(s);
    EXPECT_LT((analytic - numeric).norm(), 1e-6 * numeric.norm());
  }
}

TEST(ReprojectionTest, NormalEquationsAreThoseOfTheNumericJacobians) {
  constexpr double kWeight = 0.7;
  for (const Sample& s : MakeSamples()) {
    const Eigen::Vector3d p = s.camera_from_map * s.p_in_map;
    const Eigen::Vector3d error = s.ErrorAt(s.camera_from_map, s.p_in_map);
    const PointTerm term = MakePointTerm(kTestRig, s.measurement, p, error, kWeight);
    const Eigen::Matrix3d rotation = s.camera_from_map.rotation.toRotationMatrix();
    const Eigen::Matrix3d by_point = NumericPointJacobian(s);
    const Eigen::Matrix3d point_hessian = kWeight * by_point.transpose() * by_point;
    EXPECT_LT((rotation.transpose() * term.hessian * rotation - point_hessian).norm(),
              1e-6 * point_hessian.norm());
    EXPECT_LT(
        (rotation.transpose() * term.gradient - kWeight * by_point.transpose() * error).norm(),
        1e-6 * by_point.norm() * error.norm());

    PoseNormal normal;
    normal.Add(term, p);
    const Eigen::Matrix<double, 3, 6> by_pose = NumericPoseJacobian(s);
    const Matrix6d pose_hessian = kWeight * by_pose.transpose() * by_pose;
    const Matrix6d filled = normal.hessian.selfadjointView<Eigen::Lower>();
    EXPECT_LT((filled - pose_hessian).norm(), 1e-6 * pose_hessian.norm());
    EXPECT_LT((normal.gradient - kWeight * by_pose.transpose() * error).norm(),
              1e-6 * by_pose.norm() * error.norm());
  }
}

TEST(ReprojectionTest, MissingDisparityCountsNothing) {
  const Eigen::Vector3d p(1, 2, 10);
  const WhitenedMeasurement mono = Whiten({1, 1}, kTestRig.camera.Project(p), -1, 1);
  Eigen::Vector3d error;
  ASSERT_TRUE(WhitenedError(kTestRig, mono, 2 * p, error));
  EXPECT_NEAR(error.norm(), 0, 1e-12);
  EXPECT_EQ(mono.chi_square_bound, kChiSquareBound2);
}

TEST(ReprojectionTest, WhatCannotBeProjectedHasNoError) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const WhitenedMeasurement good = Whiten({1, 1}, {100, 100}, 5, 1);
  Eigen::Vector3d error;
  EXPECT_TRUE(WhitenedError(kTestRig, good, {0, 0, 5}, error));
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(0, 0, -5), Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(nan, 0, 5),
        Eigen::Vector3d(0, 0, nan), Eigen::Vector3d(infinity, 0, infinity)}) {
    EXPECT_FALSE(WhitenedError(kTestRig, good, p, error));
    EXPECT_FALSE(IsInlier(kTestRig, good, p));
  }
  EXPECT_FALSE(WhitenedError(kTestRig, Whiten({1, 1}, {nan, 0}, 5, 1), {0, 0, 5}, error));
  EXPECT_FALSE(WhitenedError(kTestRig, Whiten({1, 1}, {0, 0}, 5, 0), {0, 0, 5}, error));
}

TEST(ReprojectionTest, HuberWeightIsTheSlopeOfItsCost) {
  for (const double chi_square : {0.1, 5.0, 6.5, 50.0, 1e4}) {
    const double slope =
        (HuberCost(chi_square + 1e-4, 5.991) - HuberCost(chi_square - 1e-4, 5.991)) / 2e-4;
    EXPECT_NEAR(slope, HuberWeight(chi_square, 5.991) / 2, 1e-6);
  }
}

}  // namespace
}  // namespace carmap
