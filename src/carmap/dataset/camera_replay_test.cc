#include "carmap/dataset/camera_replay.h"

#include <gtest/gtest.h>

#include <thread>

#include "carmap/base/stopwatch.h"

namespace carmap {
namespace {

using std::chrono::milliseconds;

/// Frames without images.
class FakeSource : public FrameSource {
 public:
  const StereoRig& rig() const override { return rig_; }
  size_t frame_count() const override { return 20; }
  uint32_t first_index() const override { return 5; }
  Timestamp timestamp(size_t n) const override { return {static_cast<int64_t>(n)}; }
  absl::StatusOr<std::optional<StereoFrame>> Next() override {
    if (next_ == frame_count()) return std::nullopt;
    StereoFrame frame;
    frame.index = first_index() + next_++;
    return frame;
  }

 private:
  StereoRig rig_;
  uint32_t next_ = 0;
};

TEST(CameraReplay, GivesNoFrameBeforeItsTime) {
  FakeSource source;
  CameraReplay replay(source, {.rate_hz = 500, .waiting_frames = 1000});
  const Stopwatch watch;
  for (uint32_t n = 0; n < 20; ++n) {
    const auto frame = replay.Next();
    ASSERT_TRUE(frame.ok() && *frame);
    EXPECT_EQ((*frame)->index, 5 + n);
    EXPECT_GE(watch.ElapsedMs(), 2.0 * n);
  }
  const auto end = replay.Next();
  ASSERT_TRUE(end.ok());
  EXPECT_FALSE(*end);
  EXPECT_EQ(replay.dropped_count(), 0);
}

TEST(CameraReplay, NewerFramesDisplaceThoseThatNobodyTook) {
  FakeSource source;
  CameraReplay replay(source, {.rate_hz = 1000, .waiting_frames = 4});
  ASSERT_TRUE(replay.Next().ok());
  std::this_thread::sleep_for(milliseconds(10));  // frames 1 to 10 come; at most 4 of them wait
  for (uint32_t n = 1; n <= 6; ++n) {
    const auto frame = replay.Next();
    EXPECT_EQ(frame.status().code(), absl::StatusCode::kUnavailable) << n;
  }
  EXPECT_GE(replay.dropped_count(), 6);
  size_t given = 1;
  for (uint32_t n = 7; n < 20; ++n) given += replay.Next().ok();
  EXPECT_EQ(given + replay.dropped_count(), source.frame_count());
  EXPECT_GE(given, 5) << "the last ones wait for ever";
}

}  // namespace
}  // namespace carmap
