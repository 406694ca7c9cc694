#include "carmap/dataset/read_ahead.h"

#include <gtest/gtest.h>

#include "carmap/dataset/test_source.h"

namespace carmap {
namespace {

class ReadAheadTest : public testing::TestWithParam<bool> {};

TEST_P(ReadAheadTest, GivesAllFramesInOrderAndThenNothing) {
  EmptyFrames source(10, /*unreadable_every=*/3);
  ReadAhead reading(source, GetParam());
  for (uint32_t n = 0; n < 10; ++n) {
    const auto frame = reading.Next();
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->status.ok(), n % 3 != 2) << n;
    EXPECT_EQ(frame->index, 5 + n);
  }
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(reading.Next());
  EXPECT_GE(reading.read_ms(), 0);
}

TEST_P(ReadAheadTest, EndsEarlyWithoutAHang) {
  EmptyFrames source(10, /*unreadable_every=*/3);
  ReadAhead reading(source, GetParam());
  EXPECT_TRUE(reading.Next());
}

INSTANTIATE_TEST_SUITE_P(Modes, ReadAheadTest, testing::Bool(),
                         [](const auto& mode) { return mode.param ? "Sequential" : "Ahead"; });

}  // namespace
}  // namespace carmap
