#include "carmap/slam/motion_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <numeric>

namespace carmap {
namespace {

using ::testing::HasSubstr;

/// Frames ten times a second at these places along z.
Trajectory Along(size_t frames, const std::function<double(size_t)>& z_of_frame) {
  Trajectory trajectory;
  for (size_t i = 0; i < frames; ++i) {
    const Rigid3 pose{Eigen::Quaterniond::Identity(), {0, 0, z_of_frame(i)}};
    trajectory.push_back({Timestamp::FromSeconds(0.1 * static_cast<double>(i)), pose});
  }
  return trajectory;
}

std::vector<uint32_t> Numbers(size_t frames, uint32_t first = 0) {
  std::vector<uint32_t> numbers(frames);
  std::iota(numbers.begin(), numbers.end(), first);
  return numbers;
}

TEST(MotionCheck, SteadyDriving) {
  const auto motion =
      MeasureMotion(Along(40, [](size_t i) { return 1.4 * static_cast<double>(i); }), Numbers(40));
  EXPECT_NEAR(motion.max_speed_mps, 14, 1e-9);
  EXPECT_NEAR(motion.max_acceleration_mps2, 0, 1e-9);
  EXPECT_NEAR(motion.max_jump_m, 0, 1e-9);
  EXPECT_FALSE(JudgeMotion(motion));
}

TEST(MotionCheck, EmergencyBrakingIsMotionOfAVehicle) {
  const auto braking = [](size_t i) {
    const double time_s = std::min(0.1 * static_cast<double>(i), 20.0 / 9);
    return 20 * time_s - 4.5 * time_s * time_s;
  };
  const auto motion = MeasureMotion(Along(40, braking), Numbers(40));
  EXPECT_NEAR(motion.max_acceleration_mps2, 9, 0.1);
  EXPECT_FALSE(JudgeMotion(motion));
}

/// A drive at 14 m/s of which only what is far away was seen.
TEST(MotionCheck, AStallWithALeapIsNone) {
  const auto stalled = [](size_t i) {
    return 0.21 * static_cast<double>(i) + (i >= 41 ? 16.0 : 0.0);
  };
  const auto motion = MeasureMotion(Along(60, stalled), Numbers(60, 100));
  EXPECT_NEAR(motion.max_jump_m, 16, 1e-9);
  EXPECT_EQ(motion.jump_index, 141u);
  const auto suspicion = JudgeMotion(motion);
  ASSERT_TRUE(suspicion);
  EXPECT_EQ(suspicion->fault, DriveFault::kImpossibleMotion);
  EXPECT_EQ(suspicion->first_index, 141u);
  EXPECT_THAT(suspicion->finding, HasSubstr("16.0 m in one step at frame 141"));
}

TEST(MotionCheck, NoSpeedIsSaidAcrossFramesWithoutPoses) {
  Trajectory trajectory = Along(60, [](size_t i) { return static_cast<double>(i); });
  for (size_t i = 20; i < 30; ++i) trajectory[i].world_from_camera.reset();
  for (size_t i = 30; i < 60; ++i) trajectory[i].world_from_camera->translation.x() += 8;
  EXPECT_FALSE(JudgeMotion(MeasureMotion(trajectory, Numbers(60))));
}

TEST(MotionCheck, ASpeedThatNoRoadAllows) {
  EXPECT_TRUE(JudgeMotion(MeasureMotion(
      Along(40, [](size_t i) { return 12.0 * static_cast<double>(i); }), Numbers(40))));
}

TEST(MotionCheck, OfFewFramesNothingIsSaid) {
  EXPECT_FALSE(JudgeMotion(MeasureMotion({}, {})));
  EXPECT_FALSE(JudgeMotion(MeasureMotion(Along(2, [](size_t) { return 0.0; }), Numbers(2))));
}

}  // namespace
}  // namespace carmap
