#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <new>
#include <stdexcept>
#include <thread>
#include <vector>

#include "carmap/base/bounded_queue.h"
#include "carmap/base/exceptions.h"
#include "carmap/base/file.h"
#include "carmap/base/run_ahead.h"
#include "carmap/base/summary.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class FileTest : public testing::Test {
 protected:
  FileTest() : folder_(fs::path(testing::TempDir()) / "carmap_file_test") {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  const fs::path folder_;
};

TEST_F(FileTest, WritesWhatItReads) {
  const std::string bytes("a\0b\n", 4);
  ASSERT_TRUE(WriteFileAtomically(folder_ / "x", bytes).ok());
  EXPECT_EQ(*ReadFile(folder_ / "x", 100), bytes);
}

TEST_F(FileTest, LeavesNoTemporaryFileBehind) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / "x", "new").ok());
  fs::create_directory(folder_ / "taken");
  EXPECT_FALSE(WriteFileAtomically(folder_ / "taken", "cannot replace a folder").ok());
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_))
    names.push_back(entry.path().filename());
  EXPECT_THAT(names, testing::UnorderedElementsAre("x", "taken"));
}

TEST_F(FileTest, NamesTheFileInErrors) {
  EXPECT_THAT(std::string(ReadFile(folder_ / "absent", 9).status().message()), HasSubstr("absent"));
  EXPECT_FALSE(ReadFile(folder_, 9).ok());
  ASSERT_TRUE(WriteFileAtomically(folder_ / "x", "0123456789").ok());
  EXPECT_THAT(std::string(ReadFile(folder_ / "x", 9).status().message()), HasSubstr("limit of 9"));
  EXPECT_TRUE(ReadFile(folder_ / "x", 10).ok());
  EXPECT_FALSE(CheckWritable(folder_ / "no" / "such").ok());
  EXPECT_FALSE(CheckWritable(folder_).ok());
  EXPECT_TRUE(CheckWritable(folder_ / "fine").ok());
}

TEST_F(FileTest, WritesThroughSymbolicLinks) {
  fs::create_directories(folder_ / "elsewhere");
  fs::create_symlink("elsewhere/file", folder_ / "link");
  fs::create_symlink(folder_ / "link", folder_ / "link_to_link");
  for (const std::string bytes : {"new", "replaced"}) {
    ASSERT_TRUE(WriteFileAtomically(folder_ / "link_to_link", bytes).ok());
    EXPECT_EQ(*ReadFile(folder_ / "elsewhere" / "file", 100), bytes);
  }
  EXPECT_TRUE(fs::is_symlink(folder_ / "link"));
  EXPECT_TRUE(fs::is_symlink(folder_ / "link_to_link"));
  fs::create_symlink("no/such/folder", folder_ / "astray");
  fs::create_symlink("loop", folder_ / "loop");
  fs::create_symlink("/dev/null", folder_ / "device");
  for (const char* name : {"astray", "loop", "device"}) {
    EXPECT_FALSE(CheckWritable(folder_ / name).ok()) << name;
    EXPECT_FALSE(WriteFileAtomically(folder_ / name, "x").ok()) << name;
    EXPECT_TRUE(fs::is_symlink(folder_ / name)) << name;
  }
}

TEST_F(FileTest, ObeysTheUmaskAndKeepsPermissions) {
  const auto permissions = [&](const char* name) {
    return static_cast<unsigned>(fs::status(folder_ / name).permissions());
  };
  const mode_t umask_before = ::umask(0027);
  ASSERT_TRUE(WriteFileAtomically(folder_ / "new", "x").ok());
  ASSERT_TRUE(WriteFileAtomically(folder_ / "old", "x").ok());
  fs::permissions(folder_ / "old", fs::perms(0604));
  ASSERT_TRUE(WriteFileAtomically(folder_ / "old", "y").ok());
  ::umask(umask_before);
  EXPECT_EQ(permissions("new"), 0640u);
  EXPECT_EQ(permissions("old"), 0604u);
}

TEST_F(FileTest, WritesFilesOfTheLongestName) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / std::string(255, 'x'), "x").ok());
}

TEST_F(FileTest, KnowsAFileByAllItsNames) {
  ASSERT_TRUE(WriteFileAtomically(folder_ / "file", "x").ok());
  ASSERT_TRUE(WriteFileAtomically(folder_ / "other", "x").ok());
  fs::create_hard_link(folder_ / "file", folder_ / "hard");
  fs::create_symlink("hard", folder_ / "link");
  fs::create_directory_symlink(".", folder_ / "here");
  for (const char* name : {"file", "hard", "link", "here/file", "./file", "here/link"}) {
    EXPECT_TRUE(IsSameFile(folder_ / "file", folder_ / name)) << name;
    EXPECT_FALSE(IsSameFile(folder_ / "other", folder_ / name)) << name;
    EXPECT_FALSE(IsSameFile(folder_ / "absent", folder_ / name)) << name;
  }
  fs::create_symlink("absent", folder_ / "to_absent");
  for (const char* name : {"absent", "here/absent", "to_absent"}) {
    EXPECT_TRUE(IsSameFile(folder_ / "absent", folder_ / name)) << name;
    EXPECT_FALSE(IsSameFile(folder_ / "absent_too", folder_ / name)) << name;
    EXPECT_TRUE(IsInFolder(folder_ / name, folder_)) << name;
  }
  EXPECT_FALSE(IsInFolder(folder_ / "file", folder_.parent_path()));
}

TEST(ExceptionsTest, BecomeOneLine) {
  EXPECT_TRUE(CatchExceptions([] {}).ok());
  EXPECT_EQ(CatchExceptions([] { throw std::bad_alloc(); }).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(CatchExceptions([] { throw std::runtime_error("why"); }).message()),
              HasSubstr("why; "));
  EXPECT_EQ(CatchExceptions([] { throw 7; }).code(), absl::StatusCode::kInternal);
}

class RunAheadTest : public testing::TestWithParam<bool> {};

TEST_P(RunAheadTest, ThrowsWhatItsStageThrewAfterTheResultsBefore) {
  int count = 0;
  RunAhead<int> stage(GetParam(), [&]() -> std::optional<int> {
    if (++count == 4) throw std::runtime_error("thrown");
    return count;
  });
  for (int i = 1; i < 4; ++i) EXPECT_EQ(stage.Next(), i);
  EXPECT_THROW(stage.Next(), std::runtime_error);
  EXPECT_FALSE(stage.Next());
}

TEST_P(RunAheadTest, MayEndBeforeItThrows) {
  RunAhead<int> stage(GetParam(), []() -> std::optional<int> { throw 7; });
}

INSTANTIATE_TEST_SUITE_P(Modes, RunAheadTest, testing::Bool(),
                         [](const auto& mode) { return mode.param ? "Sequential" : "Ahead"; });

TEST(SummaryTest, GivesNearestRanks) {
  const Summary summary = Summarize({4, 1, 3, 2});
  EXPECT_EQ(summary.median, 2);
  EXPECT_EQ(summary.mean, 2.5);
  EXPECT_EQ(summary.p95, 4);
  EXPECT_EQ(summary.p99, 4);
  EXPECT_EQ(summary.max, 4);
  EXPECT_EQ(Summarize({}).max, 0);
}

TEST(BoundedQueueTest, PassesValuesInOrderThenEnds) {
  BoundedQueue<int> queue(2);
  std::thread producer([&] {
    for (int i = 0; i < 5; ++i) queue.Push(i);
    queue.Close();
  });
  std::vector<int> received;
  while (auto value = queue.Pop()) received.push_back(*value);
  producer.join();
  EXPECT_THAT(received, ElementsAre(0, 1, 2, 3, 4));
  EXPECT_FALSE(queue.Push(5));
}

TEST(BoundedQueueTest, CloseWakesABlockedProducer) {
  BoundedQueue<int> queue(1);
  queue.Push(0);
  std::thread producer([&] { EXPECT_FALSE(queue.Push(1)); });
  queue.Close();
  producer.join();
}

}  // namespace
}  // namespace carmap
