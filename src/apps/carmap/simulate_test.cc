// `carmap simulate` as its users meet it: what it writes, continues, and refuses.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <regex>
#include <string>
#include <vector>

#include "apps/carmap/program_runner.h"
#include "carmap/dataset/image_file.h"
#include "carmap/dataset/kitti_drive.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr size_t kFrames = 4;

class SimulateTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    root_ = fs::path(testing::TempDir()) / "carmap_simulate_test";
    fs::remove_all(root_);
    fs::create_directories(root_);
    const Result result = Simulate(WithTruth("drive"));
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  static void TearDownTestSuite() { fs::remove_all(root_); }

  static Result Simulate(const std::vector<std::string>& arguments) {
    std::vector<std::string> all = {"simulate"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return RunProgram(root_, all, root_);
  }
  static std::vector<std::string> Small(const std::string& out) {
    return {"--out",    out,      "--scene",   "suburb",
            "--length", "100",    "--frames",  std::to_string(kFrames),
            "--size",   "320x96", "--traffic", "moving"};
  }
  static std::vector<std::string> WithTruth(const std::string& out) {
    std::vector<std::string> arguments = Small(out);
    arguments.insert(arguments.end(), {"--labels", "--instances", "--depth"});
    return arguments;
  }
  static std::vector<std::string> With(std::vector<std::string> arguments,
                                       const std::vector<std::string>& more) {
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  /// Contents of all files of a drive by their names in it.
  static std::map<std::string, std::string> FilesOf(const std::string& drive) {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(root_ / drive)) {
      if (!entry.is_regular_file()) continue;
      files[fs::relative(entry.path(), root_ / drive).string()] = Read(entry.path());
    }
    return files;
  }

  static void ExpectRefused(const std::vector<std::string>& arguments, const std::string& what,
                            int exit_code = 1) {
    SCOPED_TRACE(fmt::format("{}", fmt::join(arguments, " ")));
    const Result result = Simulate(arguments);
    EXPECT_EQ(result.exit_code, exit_code);
    EXPECT_THAT(result.problems(), ElementsAre(AllOf(HasSubstr(what), HasSubstr("; "))))
        << result.err;
  }

  static void WriteText(const std::string& name, const std::string& text) {
    std::ofstream(root_ / name) << text;
  }

  static fs::path root_;
};

fs::path SimulateTest::root_;

TEST_F(SimulateTest, WritesADriveThatIsReadLikeARealOne) {
  const auto drive = KittiDrive::Open(root_ / "drive");
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_EQ((*drive)->frame_count(), kFrames);
  EXPECT_NEAR((*drive)->rig().baseline_m, 0.54, 1e-6);
  EXPECT_NEAR((*drive)->rig().camera.fx, 718.856 * 320 / 1241, 1e-3);
  ASSERT_EQ((*drive)->truth().size(), kFrames);
  for (size_t i = 0; i < kFrames; ++i) {
    const auto frame = (*drive)->Next();
    ASSERT_TRUE(frame->status.ok()) << frame->status;
    EXPECT_TRUE(frame->gps) << i;
    EXPECT_FALSE(HaveSamePixels(frame->left, frame->right));
  }
}

TEST_F(SimulateTest, TellsTheTruthOfEachPixel) {
  for (const std::string side : {"", "_right"}) {
    const auto read = [&](const std::string& folder) {
      return cv::imread((root_ / "drive" / (folder + side) / "000001.png").string(),
                        cv::IMREAD_UNCHANGED);
    };
    const cv::Mat labels = read("labels"), instances = read("instances"), depth = read("depth");
    EXPECT_EQ(labels.type(), CV_8UC1);
    EXPECT_EQ(instances.type(), CV_16UC1);
    EXPECT_EQ(depth.type(), CV_16UC1);
    ASSERT_EQ(depth.size(), cv::Size(320, 96));
    const auto share = [&](const cv::Mat& mask) {
      return cv::countNonZero(mask) / static_cast<double>(mask.total());
    };
    EXPECT_GT(share(labels == 0), 0.1) << "road";
    EXPECT_EQ(cv::countNonZero((labels == 10) & (depth > 0)), 0) << "the sky has no depth";
    // The middle of the lowest row is road 1.65 m below the camera, give or take the road's bumps.
    EXPECT_EQ(labels.at<uint8_t>(95, 160), 0);
    const double focal_px = 718.856 * 320 / 1241, row_px = 95 - 0.485 * 96;
    EXPECT_NEAR(depth.at<uint16_t>(95, 160) / 256.0, 1.65 * focal_px / row_px, 0.5);
    EXPECT_EQ(cv::countNonZero((instances > 0) & (instances < 10'000)), 0);
  }
}

TEST_F(SimulateTest, SameOptionsGiveTheSameBytes) {
  const Result again = Simulate(WithTruth("again"));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_EQ(FilesOf("again"), FilesOf("drive"));
}

TEST_F(SimulateTest, GoesOnWhereItWasInterrupted) {
  const auto whole = FilesOf("drive");
  fs::copy(root_ / "drive", root_ / "interrupted", fs::copy_options::recursive);
  for (const char* lost : {"image_0/000002.png", "image_1/000002.png", "depth/000003.png"}) {
    fs::remove(root_ / "interrupted" / lost);
  }
  const Result result = Simulate(WithTruth("interrupted"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("2 of them were there already"));
  EXPECT_EQ(FilesOf("interrupted"), whole);
}

TEST_F(SimulateTest, LeavesOtherFoldersAsTheyAre) {
  const auto before = FilesOf("drive");
  ExpectRefused(With(WithTruth("drive"), {"--seed", "2"}), "seed is 1 there and 2 here");
  EXPECT_EQ(FilesOf("drive"), before);
  fs::create_directories(root_ / "photos");
  WriteText("photos/cat.png", "a cat");
  ExpectRefused(Small("photos"), "holds files but no simulated drive");
  EXPECT_EQ(FilesOf("photos").size(), 1u);
  ExpectRefused(Small("photos/cat.png"), "is a file");
  ExpectRefused(Small("/proc/nowhere"), "/proc/nowhere");
}

TEST_F(SimulateTest, RefusesWhatCannotBe) {
  ExpectRefused({"--out", "x", "--scene", "village"}, "village", 2);
  ExpectRefused(With(Small("x"), {"--light", "moon"}), "moon", 2);
  ExpectRefused({"--out", "x", "--scene", "suburb", "--size", "big"}, "--size big");
  ExpectRefused({"--out", "x", "--scene", "suburb", "--size", "9x9"}, "width 9 is not between");
  ExpectRefused({"--out", "x", "--scene", "suburb", "--length", "1e9"}, "length");
  ExpectRefused(With(Small("x"), {"--lane", "9"}), "lane 9 is not between");
  ExpectRefused({"--out", "x", "--scene", "freeway", "--lane", "3"},
                "lane 3 is not between -1 and 2");
  ExpectRefused({"--out", "x", "--scene", "freeway", "--reverse", "--lane", "-1"},
                "lane -1 is not between 0 and 3");
  ExpectRefused(With(Small("x"), {"--speed", "-3"}), "speed -3 is not between");
  ExpectRefused(With(Small("x"), {"--path", "nowhere.txt"}), "nowhere.txt: no such file");
  ExpectRefused(With(Small("x"), {"--change", "nothing.json"}), "nothing.json: no such file");
  WriteText("broken.json", "{\"changes\": [{\"what\": \"eaten\"}]}");
  ExpectRefused(With(Small("x"), {"--change", "broken.json"}), "broken.json");
  EXPECT_FALSE(fs::exists(root_ / "x"));
}

TEST_F(SimulateTest, HelpSaysWhichLanesThereAre) {
  const Result result = Simulate({"--help"});
  EXPECT_EQ(result.exit_code, 0);
  const std::string help = std::regex_replace(result.out, std::regex("\\s+"), " ");
  EXPECT_THAT(help, AllOf(HasSubstr("suburb 0 to 1, in reverse 0 to 1"),
                          HasSubstr("downtown 0 to 1, in reverse 0 to 1"),
                          HasSubstr("freeway -1 to 2, in reverse 0 to 3")));
}

TEST_F(SimulateTest, RefusesPathsThatNoCarCanDrive) {
  const auto path = [](const std::function<Eigen::Vector3d(int)>& place) {
    std::string text;
    for (int i = 0; i < 50; ++i) {
      const Eigen::Vector3d p = place(i);
      text += fmt::format("1 0 0 {} 0 1 0 {} 0 0 1 {}\n", p.x(), p.y(), p.z());
    }
    return text;
  };
  WriteText("jump.txt", path([](int i) { return Eigen::Vector3d(i == 25 ? 300 : 0, 0, i); }));
  WriteText("vertical.txt", path([](int i) { return Eigen::Vector3d(0, -i, 0.05 * i); }));
  WriteText("standing.txt", path([](int) { return Eigen::Vector3d(0, 0, 0); }));
  for (const std::string name : {"jump.txt", "vertical.txt", "standing.txt"}) {
    ExpectRefused(With(Small("y"), {"--path", name}), name);
  }
  EXPECT_FALSE(fs::exists(root_ / "y"));
}

TEST_F(SimulateTest, ChangesOfADriveCanBeUsedAgain) {
  ASSERT_EQ(Simulate(With(Small("drawn"), {"--change-seed", "3"})).exit_code, 0);
  const auto world = nlohmann::json::parse(Read(root_ / "drawn" / "world.json"));
  ASSERT_FALSE(world.at("changes").empty());
  ASSERT_EQ(Simulate(With(Small("read"), {"--change", "drawn/world.json"})).exit_code, 0);
  EXPECT_EQ(FilesOf("read"), FilesOf("drawn"));
  EXPECT_NE(FilesOf("drawn").at("image_0/000000.png"), FilesOf("drive").at("image_0/000000.png"));
}

}  // namespace
}  // namespace carmap
