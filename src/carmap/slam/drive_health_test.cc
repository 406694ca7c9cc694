#include "carmap/slam/drive_health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const StereoRig kRig{{700, 700, 620, 180, 1240, 376}, 0.5};
constexpr double kMaxBiasPx = 0.49;

DriveHealth JudgeBias(const DriveHealthMonitor& monitor, double constant_px) {
  return monitor.Judge({}, {}, 0, {{constant_px, 0.4, -0.49}}, kMaxBiasPx);
}

TEST(DriveHealth, CountsWhatIsNear) {
  DriveHealthMonitor monitor(kRig, kRig);
  std::vector<Feature> features(10);
  for (size_t i = 0; i < 6; ++i) features[i].disparity_px = i < 2 ? 20.0f : 5.0f;
  monitor.TakeFeatures(features);
  monitor.TakeTracked(features, {0, 1, 2, 3, 4});
  const DriveHealth health = JudgeBias(monitor, 0);
  EXPECT_DOUBLE_EQ(health.depth_share, 0.6);
  EXPECT_DOUBLE_EQ(health.near_share, 0.4);  // 17.5 px are 40 baselines
  EXPECT_THAT(health.suspicions, IsEmpty());
  EXPECT_TRUE(health.faults().none());
}

TEST(DriveHealth, ABiasThatGoesAsFarAsItMayIsACameraTurned) {
  const DriveHealthMonitor monitor(kRig, kRig);
  EXPECT_THAT(JudgeBias(monitor, -0.3).suspicions, IsEmpty());
  const DriveHealth together = JudgeBias(monitor, kMaxBiasPx);
  ASSERT_EQ(together.suspicions.size(), 1u);
  EXPECT_THAT(together.suspicions[0].finding, HasSubstr("too large"));
  EXPECT_TRUE(together.faults()[static_cast<size_t>(DriveFault::kMisaligned)]);
  EXPECT_THAT(JudgeBias(monitor, -kMaxBiasPx).suspicions[0].finding, HasSubstr("look apart"));
}

/// Images of two moments bend depths too; that is the cause to name.
TEST(DriveHealth, ABiasThatAnotherFaultExplainsIsNotNamed) {
  DriveHealthMonitor monitor(kRig, kRig);
  monitor.TakePair({0,
                    {.matches = 500,
                     .agreeing = 400,
                     .before = 1.5,
                     .place_px = 5,
                     .rows_px = 5,
                     .before_sigma = 0.03},
                    1});
  const DriveHealth health = JudgeBias(monitor, kMaxBiasPx);
  ASSERT_EQ(health.suspicions.size(), 1u);
  EXPECT_EQ(health.suspicions[0].fault, DriveFault::kUnsynchronised);
}

}  // namespace
}  // namespace carmap
