#include "carmap/localize/map_neighbourhood.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/localize/motion_model.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::IsEmpty;

TEST(LandmarksAround, TakesKeyframesNearThatLookTheSameWay) {
  const Street street = MakeStreet(3, 160);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 110), Rigid3()));
  const Rigid3 pose{Eigen::Quaterniond::Identity(), {0, 0, 50}};
  const auto near = LandmarksAround(map, pose, {.radius_m = 5, .covisible_neighbours = 0});
  EXPECT_EQ(near, LandmarksSeenBy(map, {31, 32, 33, 34, 35, 36}));
  const Rigid3 back{RotationExp({0, M_PI, 0}), pose.translation};
  EXPECT_THAT(LandmarksAround(map, back), IsEmpty());
  EXPECT_THAT(LandmarksAround(map, {pose.rotation, {0, 0, 500}}), IsEmpty());
}

TEST(Extrapolate, ContinuesAMotion) {
  const Rigid3 motion{RotationExp({0.02, -0.1, 0.01}), {0.1, 0, -1}};
  const Rigid3 twice = Extrapolate(motion, 2);
  EXPECT_NEAR(RotationAngle(twice.rotation.conjugate() * (motion * motion).rotation), 0, 1e-12);
  EXPECT_EQ(twice.translation, Eigen::Vector3d(0.2, 0, -2));
  EXPECT_EQ(Extrapolate(Rigid3(), 7).translation, Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace carmap
