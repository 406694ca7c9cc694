#include "carmap/slam/repeated_frames.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

namespace carmap {
namespace {

/// Along z, ten frames a second; frames without a place have no pose.
Trajectory Along(const std::vector<std::optional<double>>& z_m) {
  Trajectory trajectory;
  for (size_t i = 0; i < z_m.size(); ++i) {
    TimedPose& pose = trajectory.emplace_back();
    pose.timestamp = Timestamp::FromSeconds(0.1 * static_cast<double>(i));
    if (z_m[i]) pose.world_from_camera = Rigid3{Eigen::Quaterniond::Identity(), {0, 0, *z_m[i]}};
  }
  return trajectory;
}

std::optional<double> PlaceOf(const TimedPose& pose) {
  if (!pose.world_from_camera) return std::nullopt;
  return pose.world_from_camera->translation.z();
}

TEST(RepeatedFrames, LieBetweenTheFramesAround) {
  Trajectory trajectory = Along({0, {}, {}, 3, {}, 6});
  PlaceRepeatedFrames({1, 2, 4}, trajectory);
  EXPECT_NEAR(*PlaceOf(trajectory[1]), 1, 1e-9);
  EXPECT_NEAR(*PlaceOf(trajectory[2]), 2, 1e-9);
  EXPECT_NEAR(*PlaceOf(trajectory[4]), 4.5, 1e-9);
}

TEST(RepeatedFrames, KeepTheLastSpeedAtTheEnd) {
  Trajectory trajectory = Along({0, {}, 4, {}, {}});
  PlaceRepeatedFrames({3, 4}, trajectory);
  EXPECT_FALSE(trajectory[1].world_from_camera) << "it was lost";
  EXPECT_NEAR(*PlaceOf(trajectory[3]), 6, 1e-9);
  EXPECT_NEAR(*PlaceOf(trajectory[4]), 8, 1e-9);
}

TEST(RepeatedFrames, StandWhereNothingTellsTheirSpeed) {
  Trajectory trajectory = Along({5, {}});
  PlaceRepeatedFrames({1}, trajectory);
  EXPECT_EQ(PlaceOf(trajectory[1]), 5);
}

TEST(RepeatedFrames, OfALostFrameAreLost) {
  Trajectory trajectory = Along({0, {}, {}, 3});
  PlaceRepeatedFrames({2}, trajectory);
  EXPECT_FALSE(trajectory[2].world_from_camera);
}

}  // namespace
}  // namespace carmap
