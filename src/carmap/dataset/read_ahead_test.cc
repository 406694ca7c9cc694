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
  EmptyFrames source(10, /*unreadable_every=*/3);
  ReadAhead reading(source, GetParam());
  EXPECT_TRUE(reading.Next().ok());
}

INSTANTIATE_TEST_SUITE_P(Modes, ReadAheadTest, testing::Bool(),
                         [](const auto& mode) { return mode.param ? "Sequential" : "Ahead"; });

}  // namespace
}  // namespace carmap
