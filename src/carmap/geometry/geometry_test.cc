#include <gtest/gtest.h>

#include <numbers>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/median_place.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {
namespace {

using Eigen::Vector3d;

const StereoRig kRig{{700, 710, 600, 180, 1226, 370}, 0.54};

TEST(Rigid3Test, ComposesAndInverts) {
  const Rigid3 b_from_a{RotationExp({0.1, -0.4, 0.3}), {1, 2, 3}};
  const Rigid3 c_from_b{RotationExp({-0.7, 0.2, 0.5}), {-4, 0, 1}};
  const Vector3d p_in_a(0.3, -2, 9);
  EXPECT_LT(((c_from_b * b_from_a) * p_in_a - c_from_b * (b_from_a * p_in_a)).norm(), 1e-12);
  EXPECT_LT((b_from_a.Inverse() * (b_from_a * p_in_a) - p_in_a).norm(), 1e-12);
}

TEST(Rigid3Test, AngleOfAnExponential) {
  EXPECT_NEAR(RotationAngle(RotationExp({0, 0.25, 0})), 0.25, 1e-12);
  EXPECT_NEAR(RotationAngle(RotationExp({0, 0, 1e-14})), 0, 1e-13);
  EXPECT_NEAR(RotationAngle(RotationExp({std::numbers::pi, 0, 0})), std::numbers::pi, 1e-9);
}

TEST(Rigid3Test, PerturbTurnsThenMovesInTheTargetFrame) {
  const Rigid3 b_from_a{RotationExp({0.1, -0.4, 0.3}), {1, 2, 3}};
  Eigen::Matrix<double, 6, 1> delta;
  delta << 0.1, 0.2, 0.3, 0.01, -0.02, 0.03;
  const Vector3d p_in_a(0.3, -2, 9);
  const Vector3d expected = RotationExp(delta.tail<3>()) * (b_from_a * p_in_a) + delta.head<3>();
  EXPECT_LT((Perturb(b_from_a, delta) * p_in_a - expected).norm(), 1e-12);
}

TEST(StereoRigTest, TriangulatesWhatItProjects) {
  const Vector3d p(2, -1, 12);
  const Vector3d uvd = kRig.Project(p);
  EXPECT_LT((kRig.Triangulate(uvd.head<2>(), uvd.z()) - p).norm(), 1e-12);
}

TEST(StereoRigTest, JacobianAgreesWithDifferences) {
  const Vector3d p(2, -1, 12);
  const Eigen::Matrix3d jacobian = StereoProjectionJacobian(kRig, p);
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d step = 1e-6 * Vector3d::Unit(axis);
    const Vector3d numeric = (kRig.Project(p + step) - kRig.Project(p - step)) / 2e-6;
    EXPECT_LT((jacobian.col(axis) - numeric).norm(), 1e-5) << "axis " << axis;
  }
}

TEST(MedianPlaceTest, LiesAmongMostFixesWhereverTheOthersAre) {
  const GpsFix place{49.015, 8.4343, 116};
  EXPECT_LT(LocalEnu(place).FromGps(MedianPlace({place})).norm(), 1e-6);
  EXPECT_LT(LocalEnu(place)
                .FromGps(MedianPlace({{52.5, 13.4, 30}, place, {-33, 151, 9}, place, place}))
                .norm(),
            1e-6);
  // At the date line, where a mean of longitudes would lie on the other side of the Earth.
  const GpsFix middle = MedianPlace({{-17, 179.9999, 5}, {-17, 180, 5}, {-17, -179.9999, 5}});
  EXPECT_LT(LocalEnu({-17, 180, 5}).FromGps(middle).norm(), 0.01);
}

TEST(LocalEnuTest, EastIsXAndRoundTrips) {
  const GpsFix karlsruhe{49.015, 8.4343, 116};
  const LocalEnu enu(karlsruhe);
  const Vector3d east = enu.FromGps({49.015, 8.4353, 116});
  EXPECT_NEAR(east.x(), 73.15, 0.1);  // 0.001 degrees of longitude at this latitude
  EXPECT_NEAR(east.y(), 0, 0.01);
  const GpsFix back = enu.ToGps(east);
  EXPECT_NEAR(back.longitude_deg, 8.4353, 1e-9);
  EXPECT_TRUE(IsValid(back));
  EXPECT_FALSE(IsValid({91, 0, 0}));
  EXPECT_FALSE(IsValid({0, 0, std::nan("")}));
}

}  // namespace
}  // namespace carmap
