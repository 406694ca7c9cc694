#include "carmap/dataset/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "carmap/base/file.h"
#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class TrajectoryTest : public testing::Test {
 protected:
  TrajectoryTest() : folder_(fs::path(testing::TempDir()) / "carmap_trajectory_test") {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  fs::path Write(const std::string& text) const {
    std::ofstream(folder_ / "path.txt", std::ios::binary) << text;
    return folder_ / "path.txt";
  }
  std::string ErrorOf(const std::string& text) const {
    return std::string(ReadTrajectory(Write(text)).status().message());
  }
  const fs::path folder_;
};

Trajectory MakeTrajectory() {
  Trajectory trajectory;
  for (int i = 0; i < 4; ++i) {
    const Rigid3 pose{RotationExp({0.1 * i, -0.2 * i, 0.3}), {1.0 / 3 + i, -2e-5, 1e4 * i}};
    trajectory.push_back({Timestamp{1317042145964000001 + i * 100000000LL}, pose});
  }
  trajectory[2].world_from_camera.reset();
  return trajectory;
}

void ExpectNear(const Rigid3& a, const Rigid3& b) {
  EXPECT_LT((a.translation - b.translation).norm(), 1e-6);
  EXPECT_LT(RotationAngle(a.rotation.conjugate() * b.rotation), 1e-7);
}

TEST_F(TrajectoryTest, KittiFormKeepsPosesAndLostFrames) {
  const Trajectory written = MakeTrajectory();
  ASSERT_TRUE(WriteTrajectory(folder_ / "t.txt", written).ok());
  const absl::StatusOr<Trajectory> read = ReadTrajectory(folder_ / "t.txt");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), written.size());
  for (const size_t i : {0, 1, 3}) {
    EXPECT_FALSE((*read)[i].timestamp);
    ExpectNear(*(*read)[i].world_from_camera, *written[i].world_from_camera);
  }
  EXPECT_FALSE((*read)[2].world_from_camera);
}

TEST_F(TrajectoryTest, TumFormKeepsPosesAndExactTimes) {
  const Trajectory written = MakeTrajectory();
  ASSERT_TRUE(WriteTrajectory(folder_ / "t.tum", written).ok());
  const absl::StatusOr<Trajectory> read = ReadTrajectory(folder_ / "t.tum");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), 3u);
  EXPECT_EQ((*read)[0].timestamp, written[0].timestamp);
  EXPECT_EQ((*read)[2].timestamp, written[3].timestamp);
  ExpectNear(*(*read)[2].world_from_camera, *written[3].world_from_camera);
}

TEST_F(TrajectoryTest, TumFormNeedsTimes) {
  Trajectory trajectory = MakeTrajectory();
  trajectory[1].timestamp.reset();
  const absl::Status status = WriteTrajectory(folder_ / "t.tum", trajectory);
  EXPECT_THAT(std::string(status.message()), HasSubstr("t.tum"));
  EXPECT_FALSE(fs::exists(folder_ / "t.tum"));
}

TEST_F(TrajectoryTest, ReadsCommentsBlankAndWindowsLines) {
  const auto read =
      ReadTrajectory(Write("# t x y z q\r\n\r\n1.5 1 2 3 0 0 0 1\r\n2 1 2 4 0 0 0 1"));
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), 2u);
  EXPECT_EQ((*read)[0].timestamp, Timestamp{1'500'000'000});
  EXPECT_EQ((*read)[1].world_from_camera->translation.z(), 4);
}

TEST_F(TrajectoryTest, TurnsARoundedMatrixIntoARotation) {
  const auto read = ReadTrajectory(Write("0.8 -0.6002 0 1 0.6 0.8 0 2 0 0 1 3\n"));
  ASSERT_TRUE(read.ok()) << read.status();
  const Rigid3 pose = *(*read)[0].world_from_camera;
  EXPECT_NEAR(pose.rotation.norm(), 1, 1e-12);
  EXPECT_NEAR(RotationAngle(pose.rotation), std::atan2(0.6, 0.8), 2e-4);
}

TEST_F(TrajectoryTest, RefusesBadLinesByNumber) {
  const std::string kitti = "1 0 0 0 0 1 0 0 0 0 1 0\n", tum = "5 0 0 0 0 0 0 1\n";
  EXPECT_THAT(ErrorOf(kitti + "1 2 3\n"), HasSubstr("line 2: has 3 columns"));
  EXPECT_THAT(ErrorOf(kitti + tum), HasSubstr("line 2: has 8 columns but"));
  EXPECT_THAT(ErrorOf("1 0 0 x 0 1 0 0 0 0 1 0\n"), HasSubstr("not a number"));
  EXPECT_THAT(ErrorOf("1 0 0 0 0 1 0 0 0 0 2 0\n"), HasSubstr("not a rotation"));
  EXPECT_THAT(ErrorOf("1 0 0 0 0 1 0 0 0 0 -1 0\n"), HasSubstr("not a rotation"));
  EXPECT_THAT(ErrorOf("1 0 0 nan 0 1 0 0 0 0 1 0\n"), HasSubstr("not a position"));
  EXPECT_THAT(ErrorOf("nan 0 0 0 0 1 0 0 0 0 1 0\n"), HasSubstr("not a rotation"));
  EXPECT_THAT(ErrorOf("1 0 0 1e300 0 1 0 0 0 0 1 0\n"), HasSubstr("not a position"));
  EXPECT_THAT(ErrorOf(tum + tum), HasSubstr("line 2: its time is not after"));
  EXPECT_THAT(ErrorOf("5 0 0 0 0 0 0 0\n"), HasSubstr("unit quaternion"));
  EXPECT_THAT(ErrorOf("nan 0 0 0 0 0 0 1\n"), HasSubstr("time in seconds"));
  EXPECT_THAT(ErrorOf(""), HasSubstr("path.txt: holds no pose"));
  EXPECT_THAT(ErrorOf("nan nan nan nan nan nan nan nan nan nan nan nan\n"),
              HasSubstr("holds no pose"));
  EXPECT_THAT(ErrorOf(std::string("\0\xff\n\0", 4)), HasSubstr("line 1"));
}

TEST(TextTableTest, ParsesSecondsExactly) {
  EXPECT_EQ(ParseSeconds("1317042145.964000001"), Timestamp{1317042145964000001});
  EXPECT_EQ(ParseSeconds("-1.5"), Timestamp{-1'500'000'000});
  EXPECT_EQ(ParseSeconds("-0.25"), Timestamp{-250'000'000});
  EXPECT_EQ(ParseSeconds("0"), Timestamp{0});
  EXPECT_EQ(ParseSeconds(".5"), Timestamp{500'000'000});
  EXPECT_EQ(ParseSeconds("7."), Timestamp{7'000'000'000});
  EXPECT_EQ(ParseSeconds("1.099999e-01"), Timestamp{109'999'900});
  EXPECT_EQ(ParseSeconds("0.00000000049999"), Timestamp{0});
  EXPECT_EQ(ParseSeconds("-3e9"), Timestamp{-Timestamp::kMaxNs});
  for (const char* bad :
       {"nan", "inf", "1e300", "1,5", "", "-", ".", "1.5s", "3000000000.5", "-9.1e9"}) {
    EXPECT_FALSE(ParseSeconds(bad)) << bad;
  }
}

TEST(TextTableTest, ReadsLineByLine) {
  TextLines lines("\xef\xbb\xbf# none\n1 2\r\n\n 3 # 4\n5");
  const TextLine* line = lines.Next();
  ASSERT_NE(line, nullptr);
  EXPECT_EQ(line->number, 2u);
  EXPECT_THAT(line->tokens, ::testing::ElementsAre("1", "2"));
  line = lines.Next();
  EXPECT_EQ(line->number, 4u);
  EXPECT_THAT(line->tokens, ::testing::ElementsAre("3"));
  EXPECT_THAT(lines.Next()->tokens, ::testing::ElementsAre("5"));
  EXPECT_EQ(lines.Next(), nullptr);
}

TEST(TextTableTest, ALineHasSoManyTokens) {
  std::string text;
  for (int i = 0; i < 1000; ++i) text += "7 ";
  TextLines lines(text);
  const TextLine* line = lines.Next();
  ASSERT_EQ(line->tokens.size(), TextLines::kMaxTokens);
  EXPECT_FALSE(ParseNumbers(line->tokens)) << "the last is all that follows";
}

TEST(TextTableTest, BoundsItsLines) {
  EXPECT_EQ(TextLines::MaxCount("1 2\n3 4\n", 2), 2u);
  EXPECT_EQ(TextLines::MaxCount("1 2\n3 4", 2), 2u);
  EXPECT_EQ(TextLines::MaxCount(std::string(1000, '\n'), 4), 125u);
  EXPECT_EQ(TextLines::MaxCount("", 4), 0u);
}

}  // namespace
}  // namespace carmap
