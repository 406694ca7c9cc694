#include "carmap/dataset/camera_replay.h"

#include <gtest/gtest.h>

#include <thread>

#include "carmap/base/stopwatch.h"
#include "carmap/dataset/test_source.h"

namespace carmap {
namespace {

using std::chrono::milliseconds;

TEST(CameraReplay, GivesNoFrameBeforeItsTime) {
  EmptyFrames source(20);
  CameraReplay replay(source, {.rate_hz = 500, .waiting_frames = 1000});
  const Stopwatch watch;
  for (uint32_t n = 0; n < 20; ++n) {
    const auto frame = replay.Next();
    ASSERT_TRUE(frame && frame->status.ok());
    EXPECT_EQ(frame->index, 5 + n);
    EXPECT_GE(watch.ElapsedMs(), 2.0 * n);
  }
  EXPECT_FALSE(replay.Next());
  EXPECT_EQ(replay.dropped_count(), 0);
}

TEST(CameraReplay, NewerFramesDisplaceThoseThatNobodyTook) {
  EmptyFrames source(20);
  CameraReplay replay(source, {.rate_hz = 1000, .waiting_frames = 4});
  ASSERT_TRUE(replay.Next()->status.ok());
  std::this_thread::sleep_for(milliseconds(10));  // frames 1 to 10 come; at most 4 of them wait
  for (uint32_t n = 1; n <= 6; ++n) {
    const auto frame = replay.Next();
    EXPECT_EQ(frame->status.code(), absl::StatusCode::kUnavailable) << n;
  }
  EXPECT_GE(replay.dropped_count(), 6);
  size_t given = 1;
  for (uint32_t n = 7; n < 20; ++n) given += replay.Next()->status.ok();
  EXPECT_EQ(given + replay.dropped_count(), source.frame_count());
  EXPECT_GE(given, 5) << "the last ones wait for ever";
}

}  // namespace
}  // namespace carmap
