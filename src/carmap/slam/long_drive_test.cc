// What happens on long drives: the vehicle stands, is blinded, turns round. Nothing of it may cost
// more than the frames that show nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numbers>

#include "carmap/slam/map_drive.h"
#include "carmap/slam/test_world.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr DriveId kDrive{7};

MappedDrive MapOrFail(const TestDrive& drive) {
  MemorySource source(drive);
  auto mapped = MapDrive(source, kDrive, {.sequential = true});
  EXPECT_TRUE(mapped.ok()) << mapped.status();
  EXPECT_TRUE(CheckConsistency(mapped->map).ok()) << CheckConsistency(mapped->map);
  return *std::move(mapped);
}

std::vector<uint32_t> LostIndices(const MappedDrive& mapped) {
  std::vector<uint32_t> indices;
  for (const LostFrame& frame : mapped.lost_frames) indices.push_back(frame.index);
  return indices;
}

/// Distance of a frame from where the truth puts it, seen from the first frame.
double ErrorAt(const MappedDrive& mapped, const TestDrive& drive, size_t n) {
  const auto& pose = mapped.trajectory.at(n).world_from_camera;
  if (!pose) return std::numeric_limits<double>::infinity();
  const Rigid3 truth = drive.world_from_camera.front().Inverse() * drive.world_from_camera.at(n);
  return (pose->translation - truth.translation).norm();
}

/// Error of the way from one frame to another.
double StepError(const MappedDrive& mapped, const TestDrive& drive, size_t from, size_t to) {
  const auto step = [&](const auto& pose) { return (pose(from).Inverse() * pose(to)).translation; };
  const Eigen::Vector3d estimate =
      step([&](size_t n) { return *mapped.trajectory.at(n).world_from_camera; });
  const Eigen::Vector3d truth = step([&](size_t n) { return drive.world_from_camera.at(n); });
  return (estimate - truth).norm();
}

void Blacken(TestDrive& drive, size_t first, size_t count) {
  for (size_t i = first; i < first + count; ++i) {
    StereoFrame& frame = drive.frames.at(i);
    // Each differs a little from the one before, as those of a real camera do.
    frame.left = cv::Mat(frame.left.size(), CV_8UC1, cv::Scalar(static_cast<double>(i % 2)));
    frame.right = frame.left.clone();
  }
}

Rigid3 Turned(const Rigid3& pose, double yaw_rad) {
  return {pose.rotation * RotationExp({0, yaw_rad, 0}), pose.translation};
}

size_t KeyframesFrom(const Map& map, uint32_t first, uint32_t last) {
  return static_cast<size_t>(std::count_if(
      map.keyframes().begin(), map.keyframes().end(),
      [&](const auto& entry) { return entry.first.index >= first && entry.first.index <= last; }));
}

TEST(LongDrive, StandingAddsNothing) {
  std::vector<Rigid3> poses;
  for (int i = 0; i < 8; ++i) poses.push_back(WeavingPose(0.6 * i));
  for (int i = 0; i < 20; ++i) poses.push_back(WeavingPose(0.6 * 8));
  for (int i = 9; i < 14; ++i) poses.push_back(WeavingPose(0.6 * i));
  const TestDrive drive = RenderAlong(poses);
  const MappedDrive mapped = MapOrFail(drive);
  EXPECT_THAT(LostIndices(mapped), IsEmpty());
  EXPECT_LE(KeyframesFrom(mapped.map, 8, 27), 1u);
  EXPECT_GE(KeyframesFrom(mapped.map, 28, 32), 1u);
  for (size_t i = 9; i < 28; ++i) EXPECT_LT(ErrorAt(mapped, drive, i), 0.08) << i;
  EXPECT_LT(ErrorAt(mapped, drive, 32), 0.1);
}

TEST(LongDrive, GoesOnAfterATunnel) {
  TestDrive drive = RenderTestDrive(40);
  Blacken(drive, 10, 20);
  const MappedDrive mapped = MapOrFail(drive);
  ASSERT_FALSE(mapped.lost_frames.empty());
  EXPECT_EQ(mapped.lost_frames.front().index, 10u);
  EXPECT_LE(mapped.lost_frames.back().index, 31u) << "the third frame after it begins a part";
  // After 12 m in the dark it sees again only what was 20 m and more away, at 5 px of disparity:
  // too little to join the map before, so that the vehicle's speed alone puts the part where it
  // lies.
  for (size_t i = 32; i < 40; ++i) EXPECT_LT(ErrorAt(mapped, drive, i), 2) << i;
  EXPECT_LT(StepError(mapped, drive, 32, 39), 0.08);
}

TEST(LongDrive, GoesOnAfterDroppedFrames) {
  TestDrive drive = RenderTestDrive(24);
  for (const size_t dropped : {15, 14, 8}) {
    drive.frames.erase(drive.frames.begin() + dropped);
    drive.world_from_camera.erase(drive.world_from_camera.begin() + dropped);
  }
  for (uint32_t i = 0; i < drive.frames.size(); ++i) drive.frames[i].index = i;
  const MappedDrive mapped = MapOrFail(drive);
  EXPECT_THAT(LostIndices(mapped), IsEmpty());
  for (size_t i = 0; i < drive.frames.size(); ++i) EXPECT_LT(ErrorAt(mapped, drive, i), 0.1) << i;
}

TEST(LongDrive, BearsJumpsOfTheExposure) {
  TestDrive drive = RenderTestDrive(24);
  for (size_t i = 0; i < drive.frames.size(); ++i) {
    const double gain = i < 8 ? 1 : i < 16 ? 0.45 : 1.5;
    for (cv::Mat* image : {&drive.frames[i].left, &drive.frames[i].right}) {
      image->convertTo(*image, CV_8UC1, gain, i < 8 ? 0 : 20);
    }
  }
  const MappedDrive mapped = MapOrFail(drive);
  EXPECT_THAT(LostIndices(mapped), IsEmpty());
  EXPECT_THAT(mapped.parts, SizeIs(1));
  for (size_t i = 0; i < 24; ++i) EXPECT_LT(ErrorAt(mapped, drive, i), 0.12) << i;
}

TEST(LongDrive, FollowsAUTurn) {
  std::vector<Rigid3> poses;
  for (int i = 0; i < 6; ++i) poses.push_back(WeavingPose(20 + 0.4 * i));
  constexpr int kSteps = 40;
  for (int i = 1; i <= kSteps; ++i) {  // round a circle of 3 m
    const double yaw = std::numbers::pi * i / kSteps;
    poses.push_back(
        {RotationExp({0, yaw, 0}), {3 * std::cos(yaw) - 3, 0, 22.4 + 3 * std::sin(yaw)}});
    poses.back().translation.x() *= -1;
  }
  const TestDrive drive = RenderAlong(poses);
  const MappedDrive mapped = MapOrFail(drive);
  EXPECT_THAT(LostIndices(mapped), IsEmpty());
  EXPECT_THAT(mapped.parts, SizeIs(1));
  EXPECT_LT(ErrorAt(mapped, drive, drive.frames.size() - 1), 0.2);
}

/// Drives on, is blind while it turns round, and drives on looking backwards.
std::vector<Rigid3> TurningRoundInTheDark() {
  std::vector<Rigid3> poses;
  for (int i = 0; i < 30; ++i) {
    poses.push_back(Turned({RotationExp({0, 0, 0}), {0, 0, 15 + 0.6 * i}},
                           std::numbers::pi * std::clamp(i - 9, 0, 4) / 4));
  }
  return poses;
}

TEST(LongDrive, BeginsANewPartWhereNothingIsKnown) {
  TestDrive drive = RenderAlong(TurningRoundInTheDark());
  Blacken(drive, 10, 3);
  const MappedDrive mapped = MapOrFail(drive);
  EXPECT_THAT(LostIndices(mapped), ElementsAre(10, 11, 12, 13, 14));
  EXPECT_THAT(mapped.lost_frames.back().reason, HasSubstr("do not agree with the map"));
  ASSERT_THAT(mapped.parts, SizeIs(2));
  EXPECT_EQ(mapped.parts[0].first_index, 0u);
  EXPECT_EQ(mapped.parts[1].first_index, 15u);
  // The part is consistent in itself, and begins where the speed led to.
  EXPECT_LT(StepError(mapped, drive, 15, 25), 0.08);
  EXPECT_LT(ErrorAt(mapped, drive, 15), 6.0);
}

}  // namespace
}  // namespace carmap
