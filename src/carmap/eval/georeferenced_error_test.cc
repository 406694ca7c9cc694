#include "carmap/eval/georeferenced_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace carmap {
namespace {

using ::testing::Each;
using ::testing::SizeIs;

constexpr GpsFix kOrigin{49.01, 8.43, 115};

TimedPose At(double x, double y, double z) {
  Rigid3 pose;
  pose.translation = {x, y, z};
  return {.world_from_camera = pose};
}

TEST(GeoreferencedError, IsHorizontalAndNotAligned) {
  const Trajectory truth = {At(0, 0, 0), At(200, 100, 0), At(400, -100, 5), At(500, 0, 5)};
  // The estimate's frame is turned by 90 degrees about up, and about another origin.
  const LocalEnu truth_enu(kOrigin);
  const GpsFix origin = truth_enu.ToGps({30, -20, 7});
  Rigid3 enu_from_estimate;
  enu_from_estimate.rotation = Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ());
  const LocalEnu enu(origin);
  Trajectory estimate;
  for (const TimedPose& pose : truth) {
    const Eigen::Vector3d& p = pose.world_from_camera->translation;
    const Eigen::Vector3d off = p + Eigen::Vector3d(3, -4, 12);
    const Eigen::Vector3d in_estimate =
        enu_from_estimate.Inverse() * enu.FromGps(truth_enu.ToGps(off));
    estimate.push_back(At(in_estimate.x(), in_estimate.y(), in_estimate.z()));
  }
  estimate[2].world_from_camera.reset();
  const auto errors = GeoreferencedErrorsM(estimate, enu_from_estimate, origin, truth, kOrigin);
  ASSERT_TRUE(errors.ok()) << errors.status();
  EXPECT_THAT(*errors, SizeIs(3));
  EXPECT_THAT(*errors, Each(testing::DoubleNear(5, 1e-6)));
}

TEST(GeoreferencedError, NeedsFramesInCommon) {
  EXPECT_FALSE(GeoreferencedErrorsM({At(0, 0, 0)}, {}, kOrigin, {}, kOrigin).ok());
}

}  // namespace
}  // namespace carmap
