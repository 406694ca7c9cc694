#include "carmap/dataset/read_ahead.h"

#include <gtest/gtest.h>

namespace carmap {
namespace {

/// Frames without images; every third cannot be read.
class FakeSource : public FrameSource {
 public:
  const StereoRig& rig() const override { return rig_; }
  size_t frame_count() const override { return 10; }
  uint32_t first_index() const override { return 5; }
  Timestamp timestamp(size_t n) const override { return {static_cast<int64_t>(n)}; }
  absl::StatusOr<std::optional<StereoFrame>> Next() override {
    if (next_ == frame_count()) return std::nullopt;
    const uint32_t n = next_++;
    if (n % 3 == 2) return absl::DataLossError("unreadable");
    StereoFrame frame;
    frame.index = first_index() + n;
    return frame;
  }

 private:
  StereoRig rig_;
  uint32_t next_ = 0;
};

class ReadAheadTest : public testing::TestWithParam<bool> {};

TEST_P(ReadAheadTest, GivesAllFramesInOrderAndThenNothing) {
  FakeSource source;
  ReadAhead reading(source, GetParam());
  for (uint32_t n = 0; n < 10; ++n) {
    const auto frame = reading.Next();
    ASSERT_EQ(frame.ok(), n % 3 != 2) << n;
    if (!frame.ok()) continue;
    ASSERT_TRUE(frame->has_value());
    EXPECT_EQ((*frame)->index, 5 + n);
  }
  for (int i = 0; i < 2; ++i) {
    const auto end = reading.Next();
    ASSERT_TRUE(end.ok());
    EXPECT_FALSE(end->has_value());
  }
  EXPECT_GE(reading.read_ms(), 0);
}

TEST_P(ReadAheadTest, EndsEarlyWithoutAHang) {
  FakeSource source;
  ReadAhead reading(source, GetParam());
  EXPECT_TRUE(reading.Next().ok());
}

INSTANTIATE_TEST_SUITE_P(Modes, ReadAheadTest, testing::Bool(),
                         [](const auto& mode) { return mode.param ? "Sequential" : "Ahead"; });

}  // namespace
}  // namespace carmap
