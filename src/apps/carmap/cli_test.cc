// The program as its users meet it: what it writes, what it says, and what it exits with.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/program_runner.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/format/container.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr int kFrames = 16;

void Write(const fs::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

std::string Replace(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

std::string Image(const char* side, int frame) { return fmt::format("{}/{:06}.png", side, frame); }

/// Copies frames of a small simulated drive, without GPS, as a drive that begins with frame `first`
/// at time 0. Those of one town are the same.
void CopyTestDrive(int town, int frames, const fs::path& to, int first = 0) {
  const fs::path from = fs::path(CARMAP_TEST_DRIVES) / fmt::format("town_{}", town);
  fs::remove_all(to);
  fs::create_directories(to / "image_0");
  fs::create_directories(to / "image_1");
  fs::copy(from / "calib.txt", to);
  for (int frame = 0; frame < frames; ++frame) {
    for (const char* side : {"image_0", "image_1"}) {
      fs::copy(from / Image(side, first + frame), to / Image(side, frame));
    }
  }
  for (const auto& [name, begin] : {std::pair("times.txt", 0), std::pair("poses.txt", first)}) {
    std::ifstream lines(from / name);
    std::ofstream copied(to / name);
    std::string line;
    for (int i = 0; i < begin + frames && std::getline(lines, line); ++i) {
      if (i >= begin) copied << line << "\n";
    }
  }
}

/// Labels of some frames: road, and a car of 80 columns from column `car_px` on. Frame 0 has none.
void WriteLabels(const fs::path& folder, int frames, int car_px) {
  fs::create_directories(folder);
  for (int frame = 1; frame < frames; ++frame) {
    cv::Mat labels(160, 320, CV_8UC1, cv::Scalar(0));
    labels.colRange(car_px, car_px + 80).setTo(13);
    cv::imwrite((folder / fmt::format("{:06}.png", frame)).string(), labels);
  }
}

class CliTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    root_ = fs::path(testing::TempDir()) / "carmap_cli_test";
    fs::remove_all(root_);
    fs::create_directories(root_ / "work");
    CopyTestDrive(1, kFrames, root_ / "drive");
    const Result base = RunIn(root_, {"map", "drive", "--last", "10", "--out", "base.cmap"});
    const Result segment = RunIn(root_, {"map", "drive", "--first", "4", "--out", "segment.cmap"});
    ASSERT_EQ(base.exit_code, 0) << base.err;
    ASSERT_EQ(segment.exit_code, 0) << segment.err;
  }
  static void TearDownTestSuite() { fs::remove_all(root_); }

  /// Each test works in an empty folder beside drive/, base.cmap and segment.cmap.
  void SetUp() override {
    fs::remove_all(work());
    fs::create_directories(work());
  }

  static fs::path work() { return root_ / "work"; }

  static Result RunIn(const fs::path& folder, const std::vector<std::string>& arguments) {
    return RunProgram(folder, arguments, root_);
  }
  static Result Run(const std::vector<std::string>& arguments) { return RunIn(work(), arguments); }
  static Result RunTo(const std::string& redirection, const std::vector<std::string>& arguments) {
    return RunProgram(work(), arguments, root_, redirection);
  }

  static std::vector<std::string> FilesInWork() {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(work())) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }

  /// The command fails with one line that says `what`, and writes nothing.
  static void ExpectRefused(const std::vector<std::string>& arguments, const std::string& what,
                            int exit_code = 1) {
    SCOPED_TRACE(fmt::format("{}", fmt::join(arguments, " ")));
    const std::vector<std::string> files_before = FilesInWork();
    const Result result = Run(arguments);
    EXPECT_EQ(result.exit_code, exit_code);
    EXPECT_THAT(result.out, IsEmpty());
    EXPECT_THAT(result.problems(), testing::ElementsAre(AllOf(HasSubstr(what), HasSubstr("; "))))
        << result.err;
    EXPECT_THAT(FilesInWork(), testing::UnorderedElementsAreArray(files_before));
  }

  /// As ExpectRefused, before any work has begun: nothing else is printed either.
  static void ExpectRefusedAtOnce(const std::vector<std::string>& arguments,
                                  const std::string& what, int exit_code = 1) {
    ExpectRefused(arguments, what, exit_code);
    EXPECT_THAT(Read(root_ / "stderr"), StartsWith("carmap: ")) << what;
  }

  /// A copy of the drive for a test to damage.
  static fs::path CopyOfDrive() {
    CopyTestDrive(1, kFrames, root_ / "damaged");
    return root_ / "damaged";
  }

  static nlohmann::json ReadJson(const std::string& name) {
    return nlohmann::json::parse(Read(work() / name));
  }

  static fs::path root_;
};

fs::path CliTest::root_;

// What works.

TEST_F(CliTest, TeachesItself) {
  const Result help = Run({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const char* command : {"map", "localize", "stitch", "info", "evaluate", "vocabulary"}) {
    EXPECT_THAT(help.out, HasSubstr(fmt::format("\n  {} ", command)));
    const Result of_command = Run({command, "--help"});
    EXPECT_EQ(of_command.exit_code, 0);
    EXPECT_THAT(of_command.out, AllOf(HasSubstr("Example"), HasSubstr("Exit codes")));
  }
  EXPECT_THAT(Run({"map", "--help"}).out,
              HasSubstr("carmap map DRIVE --out SEGMENT.cmap [--first N] [--last M]"));
  EXPECT_THAT(Run({"--version"}).out, StartsWith("carmap "));
}

TEST_F(CliTest, MapsADrive) {
  const Result result = Run({"map", "../drive", "--out", "m.cmap", "--trajectory", "t.tum",
                             "--report", "r.json", "--picture", "p.png"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, AllOf(HasSubstr("16 of 16 frames"), HasSubstr("m.cmap")));
  EXPECT_THAT(result.problems(), IsEmpty());

  const nlohmann::json report = ReadJson("r.json");
  EXPECT_EQ(report["frames"], kFrames);
  EXPECT_EQ(report["tracked_frames"], kFrames);
  EXPECT_EQ(report["lean_bytes"], fs::file_size(work() / "m.cmap"));
  EXPECT_NEAR(report["path_length_m"].get<double>(), 12, 0.3);
  EXPECT_LE(report["ate_rmse_m"].get<double>(), 0.1);
  EXPECT_TRUE(report["lost_frames"].empty());
  EXPECT_EQ(report["parts"].size(), 1u);
  for (const char* key :
       {"keyframes", "landmarks", "observations", "wall_s", "peak_rss_mb", "bytes_per_landmark",
        "lean_mb_per_km", "t_rel_percent", "r_rel_deg_per_100m", "t_rel_5_50_percent"}) {
    EXPECT_GT(report[key].get<double>(), 0) << key;
  }
  for (const char* key : {"median", "mean", "p95", "p99", "max"})
    EXPECT_GT(report["frame_ms"][key], 0);
  for (const char* stage : {"read", "extract", "stereo", "track"}) {
    EXPECT_GT(report["stage_ms"][stage], 0) << stage;
  }
  const nlohmann::json& composition = report["composition_bytes"];
  EXPECT_GT(composition["full"], composition["no_index"]);
  EXPECT_GT(composition["no_index"], composition["no_keyframe_features"]);
  EXPECT_GT(composition["no_keyframe_features"], composition["lean"]);
  EXPECT_EQ(composition["lean"], report["lean_bytes"]);

  const auto trajectory = ReadTrajectory(work() / "t.tum");
  ASSERT_TRUE(trajectory.ok()) << trajectory.status();
  EXPECT_EQ(trajectory->size(), kFrames);
  EXPECT_TRUE(trajectory->front().timestamp.has_value());
  EXPECT_GE(cv::imread((work() / "p.png").string()).cols, 1000);
}

TEST_F(CliTest, MapsSequentiallyTheSameEachTime) {
  ASSERT_EQ(Run({"map", "../drive", "--sequential", "--out", "a.cmap"}).exit_code, 0);
  ASSERT_EQ(Run({"map", "../drive", "--sequential", "--out", "b.cmap"}).exit_code, 0);
  EXPECT_EQ(Read(work() / "a.cmap"), Read(work() / "b.cmap"));
}

TEST_F(CliTest, MapsAtTheRateOfACamera) {
  const Result result = Run(
      {"map", "../drive", "--last", "7", "--replay", "5", "--out", "m.cmap", "--report", "r.json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("at 5 Hz, 0 frames dropped"));
  const nlohmann::json report = ReadJson("r.json");
  EXPECT_EQ(report["replay"]["dropped_frames"], 0);
  EXPECT_GE(report["wall_s"].get<double>(), 7 / 5.0);
  ExpectRefusedAtOnce({"map", "../drive", "--replay", "0", "--out", "m2.cmap"}, "--replay", 2);
}

TEST_F(CliTest, StitchesAndLocalizesInTheResult) {
  const Result stitch = Run({"stitch", "../base.cmap", "../segment.cmap", "--out", "road.cmap",
                             "--report", "stitch.json"});
  ASSERT_EQ(stitch.exit_code, 0) << stitch.err;
  const nlohmann::json stitched = ReadJson("stitch.json");
  EXPECT_GT(stitched["inliers"], 50);
  EXPECT_EQ(stitched["result"]["bytes"], fs::file_size(work() / "road.cmap"));
  EXPECT_EQ(
      stitched["result"]["keyframes"].get<int>(),
      stitched["base"]["keyframes"].get<int>() + stitched["segment_keyframes_added"].get<int>());

  const Result localize =
      Run({"localize", "../drive", "--map", "road.cmap", "--map-truth", "../drive", "--trajectory",
           "t.txt", "--report", "r.json", "--picture", "p.png"});
  ASSERT_EQ(localize.exit_code, 0) << localize.err;
  const nlohmann::json report = ReadJson("r.json");
  EXPECT_EQ(report["frames"], kFrames);
  EXPECT_EQ(report["localized_frames"], kFrames);
  EXPECT_LE(report["position_error_m"]["median"].get<double>(), 0.1);
  EXPECT_LE(report["rotation_error_deg"]["median"].get<double>(), 0.5);
  EXPECT_EQ(report["map_bytes"], fs::file_size(work() / "road.cmap"));
  const nlohmann::json& last = report["frames_detail"].back();
  EXPECT_EQ(last["known_by"], "map");
  EXPECT_LE(last["position_error_m"].get<double>(), 0.2);
  EXPECT_LE(last["map_position_error_m"].get<double>(), 0.1);
  EXPECT_GT(last["squared_mahalanobis"].get<double>(), 0);
  EXPECT_GT(last["sigma_m"].get<double>(), 0);
  for (const char* key : {"read", "decode", "rebuild", "total"})
    EXPECT_GT(report["load_ms"][key], 0);
  EXPECT_GT(report["frame_ms"]["p95"], 0);
  EXPECT_GE(cv::imread((work() / "p.png").string()).cols, 1000);

  const Result evaluate = Run({"evaluate", "trajectory", "t.txt", "../drive/poses.txt", "--json"});
  ASSERT_EQ(evaluate.exit_code, 0) << evaluate.err;
  EXPECT_LE(nlohmann::json::parse(evaluate.out)["ate_rmse_m"].get<double>(), 0.1);
  EXPECT_THAT(Run({"evaluate", "trajectory", "t.txt", "../drive/poses.txt"}).out,
              HasSubstr("absolute error"));
}

TEST_F(CliTest, AlignsAMapByTheKeyframesOfTheDriveThatTheTruthIsOf) {
  // Two drives with the same numbers and times of frames, the second some metres further on.
  constexpr int kFirst = 6;
  CopyTestDrive(1, kFrames - kFirst, work() / "later", kFirst);
  ASSERT_EQ(Run({"map", "later", "--out", "later.cmap"}).exit_code, 0);
  struct Order {
    const char *base, *segment, *drive_of_base;
  };
  for (const auto& [base, segment, drive] :
       {Order{"../base.cmap", "later.cmap", "../drive"}, {"later.cmap", "../base.cmap", "later"}}) {
    ASSERT_EQ(Run({"stitch", base, segment, "--out", "road.cmap"}).exit_code, 0);
    const Result localize =
        Run({"localize", drive, "--map", "road.cmap", "--map-truth", drive, "--report", "r.json"});
    ASSERT_EQ(localize.exit_code, 0) << localize.err;
    EXPECT_LE(ReadJson("r.json")["position_error_m"]["max"].get<double>(), 0.3) << base;
  }
  CopyTestDrive(1, kFrames - kFirst, work() / "other", kFirst - 1);
  ExpectRefused({"localize", "other", "--map", "road.cmap", "--map-truth", "other"},
                "none of its 2 drives is other");
}

// The base's keyframes stand for those of a drive that saw the same, with the same times.
TEST_F(CliTest, DoesNotAlignAMapByADriveOfWhichItHasNoKeyframes) {
  constexpr int kFirst = 4;
  CopyTestDrive(1, kFrames - kFirst, work() / "later", kFirst);
  ASSERT_EQ(Run({"map", "later", "--last", "5", "--out", "later.cmap"}).exit_code, 0);
  ASSERT_EQ(
      Run({"stitch", "../base.cmap", "later.cmap", "--out", "road.cmap", "--report", "s.json"})
          .exit_code,
      0);
  ASSERT_EQ(ReadJson("s.json")["segment_keyframes_added"], 0);
  ExpectRefused({"localize", "later", "--map", "road.cmap", "--map-truth", "later"},
                "none of its 2 drives is later");
}

TEST_F(CliTest, StitchesByAppearanceAlone) {
  const Result stitch = Run({"stitch", "../base.cmap", "../segment.cmap", "--out", "road.cmap",
                             "--matching", "appearance", "--report", "stitch.json"});
  ASSERT_EQ(stitch.exit_code, 0) << stitch.err;
  EXPECT_GT(ReadJson("stitch.json")["inliers"], 50);
  ExpectRefused(
      {"stitch", "../base.cmap", "../segment.cmap", "--out", "x.cmap", "--matching", "luck"},
      "--matching", 2);
}

TEST_F(CliTest, FindsEachFrameByItself) {
  const Result found = Run({"evaluate", "frames", "../drive", "--map", "../base.cmap",
                            "--map-truth", "../drive", "--report", "frames.json"});
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const auto report = nlohmann::json::parse(Read(work() / "frames.json"));
  size_t right = 0;
  for (const auto& frame : report["frames_detail"]) {
    right += frame.contains("map_position_error_m") && frame["map_position_error_m"] < 0.5;
  }
  EXPECT_GE(right, kFrames - 1);
  EXPECT_THAT(found.out, HasSubstr(fmt::format("{} within 0.5 m, 0 wrong", right)));
}

TEST_F(CliTest, FindsFramesByAppearanceAndEvaluatesThem) {
  ASSERT_EQ(Run({"map", "../drive", "--out", "m.cmap", "--full-map", "m.cfull"}).exit_code, 0);
  EXPECT_GT(fs::file_size(work() / "m.cfull"), 5 * fs::file_size(work() / "m.cmap"));
  const std::string cell = "suburb-s1-320x160-map_none-to-lane0-none-sunny";
  const auto find = [&](const std::string& map, const std::string& method) {
    return std::vector<std::string>{"evaluate",
                                    "frames",
                                    "../drive",
                                    "--by",
                                    "appearance",
                                    "--map",
                                    map,
                                    "--map-truth",
                                    "../drive",
                                    "--report",
                                    cell + "-by_" + method + ".json"};
  };
  auto trace = find("m.cfull", "quicksketch");
  trace.insert(trace.end(), {"--trace", "m.cfull"});
  for (const auto& arguments : {find("m.cmap", "lean"), find("m.cfull", "appearance"), trace}) {
    const Result found = Run(arguments);
    ASSERT_EQ(found.exit_code, 0) << found.err;
    EXPECT_THAT(found.out, HasSubstr("found         "));
  }
  const Result evaluate =
      Run({"evaluate", "localization", cell + "-by_lean.json", cell + "-by_appearance.json",
           cell + "-by_quicksketch.json", "--out", ".", "--json"});
  ASSERT_EQ(evaluate.exit_code, 0) << evaluate.err;
  const auto groups = nlohmann::json::parse(evaluate.out);
  ASSERT_EQ(groups.size(), 3u);
  const auto& in_full_map = groups[0];
  EXPECT_EQ(in_full_map["method"], "appearance");
  EXPECT_EQ(in_full_map["all"]["frames"], kFrames - 10) << "without the first second";
  EXPECT_EQ(in_full_map["all"]["map_bytes"], fs::file_size(work() / "m.cfull"));
  EXPECT_GE(in_full_map["all"]["well_known"]["value"].get<double>(), 0.9);
  EXPECT_LE(in_full_map["all"]["median_map_error_m"]["value"].get<double>(), 0.05);
  EXPECT_GE(cv::imread((work() / "errors_320x160.png").string()).cols, 500);
  EXPECT_GE(cv::imread((work() / "cells_320x160.png").string()).cols, 500);
  EXPECT_THAT(Run({"evaluate", "localization", cell + "-by_lean.json"}).out,
              HasSubstr("| suburb, map none, drive none, lane 0, sunny | 1 | 6 |"));
}

TEST_F(CliTest, MeasuresWhatIsMatchedOfTheLandmarksInSight) {
  const Result matching = Run({"evaluate", "matching", "../drive", "--map", "../base.cmap",
                               "--map-truth", "../drive", "--json"});
  ASSERT_EQ(matching.exit_code, 0) << matching.err;
  const auto ratios = nlohmann::json::parse(matching.out);
  EXPECT_EQ(ratios["frames"], kFrames);
  EXPECT_GT(ratios["landmarks_in_sight"], 20);
  EXPECT_GT(ratios["matched_by_position"], 0.3);
  EXPECT_GT(ratios["matched_by_position"], ratios["matched_by_appearance"]);
}

TEST_F(CliTest, RefusesReportsAndMapsThatItCannotEvaluate) {
  const std::string name = "suburb-s1-320x160-map_none-to-lane0-none-sunny.json";
  Write(work() / name, "{}");
  Write(work() / "r.json", "{}");
  ExpectRefused({"evaluate", "localization", name}, name);
  ExpectRefused({"evaluate", "localization", "r.json"}, "r.json");
  ExpectRefused({"evaluate", "localization", "none.json"}, "none.json");
  ExpectRefused({"evaluate", "localization", name, "--out", "nowhere"}, "nowhere");
  Write(work() / "m.cfull", "no map");
  for (const char* command : {"frames", "matching"}) {
    ExpectRefused({"evaluate", command, "../drive", "--map", "m.cfull", "--map-truth", "../drive"},
                  "m.cfull");
    ExpectRefused(
        {"evaluate", command, "../drive", "--map", "../base.cmap", "--map-truth", "nowhere"},
        "nowhere");
  }
  ExpectRefused({"evaluate", "frames", "../drive", "--map", "../base.cmap", "--map-truth",
                 "../drive", "--trace", "m.cfull"},
                "m.cfull");
}

TEST_F(CliTest, LocalizesAPartOfADrive) {
  const Result result = Run({"localize", "../drive", "--map", "../base.cmap", "--first", "3",
                             "--last", "7", "--trajectory", "t.tum", "--report", "r.json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(ReadJson("r.json")["frames"], 5);
  EXPECT_FALSE(ReadJson("r.json").contains("position_error_m")) << "there was no --map-truth";
  EXPECT_EQ(ReadTrajectory(work() / "t.tum")->front().timestamp, Timestamp::FromSeconds(0.3));
}

TEST_F(CliTest, MayReplaceTheBaseMapByTheStitchedOne) {
  fs::copy(root_ / "base.cmap", work() / "base.cmap");
  ASSERT_EQ(Run({"stitch", "base.cmap", "../segment.cmap", "--out", "base.cmap"}).exit_code, 0);
  const auto map = ReadLeanMap(work() / "base.cmap");
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->drives.size(), 2u);
}

TEST_F(CliTest, SaysWhatAMapHolds) {
  const Result table = Run({"info", "../base.cmap"});
  EXPECT_EQ(table.exit_code, 0);
  EXPECT_THAT(table.out, AllOf(HasSubstr("landmarks"), HasSubstr("features at 640x320 px")));
  const Result json = Run({"info", "../base.cmap", "--json"});
  ASSERT_EQ(json.exit_code, 0);
  const nlohmann::json info = nlohmann::json::parse(json.out);
  EXPECT_EQ(info["bytes"], fs::file_size(root_ / "base.cmap"));
  EXPECT_EQ(info["drives"], 1);
  EXPECT_EQ(info["gps"], false);
  EXPECT_GT(info["mean_observations"], 3);
  EXPECT_NEAR(info["path_length_m"].get<double>(), 8, 1);
  EXPECT_GT(info["bounding_box_m"]["max"][2], 8);
  for (const char* key : {"keyframes", "landmarks", "observations", "bytes_per_landmark"}) {
    EXPECT_GT(info[key], 0) << key;
  }
}

TEST_F(CliTest, TrainsAVocabularyTheSameEachTime) {
  const std::vector<std::string> train = {"vocabulary", "train",   "../drive", "--branching",
                                          "6",          "--depth", "3",        "--step",
                                          "3",          "--out"};
  const auto to = [&](const std::string& out, const std::string& seed) {
    std::vector<std::string> arguments = train;
    arguments.insert(arguments.end(), {out, "--seed", seed});
    return arguments;
  };
  const Result result = Run(to("a.cmvoc", "7"));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  ASSERT_EQ(Run(to("b.cmvoc", "7")).exit_code, 0);
  ASSERT_EQ(Run(to("c.cmvoc", "8")).exit_code, 0);
  EXPECT_EQ(Read(work() / "a.cmvoc"), Read(work() / "b.cmvoc"));
  EXPECT_NE(Read(work() / "a.cmvoc"), Read(work() / "c.cmvoc"));

  EXPECT_THAT(Run({"vocabulary", "info", "a.cmvoc"}).out, HasSubstr("3 levels"));
  const Result json = Run({"vocabulary", "info", "a.cmvoc", "--json"});
  ASSERT_EQ(json.exit_code, 0) << json.err;
  const nlohmann::json info = nlohmann::json::parse(json.out);
  EXPECT_EQ(info["training_images"], (kFrames + 2) / 3);
  EXPECT_EQ(info["bytes"], fs::file_size(work() / "a.cmvoc"));
  EXPECT_GT(info["words"], 100);
  EXPECT_LE(info["words"], 6 * 6 * 6);

  const Result places =
      Run({"evaluate", "places", "../drive", "--vocabulary", "a.cmvoc", "--json"});
  ASSERT_EQ(places.exit_code, 0) << places.err;
  EXPECT_EQ(nlohmann::json::parse(places.out)["keyframes"], 6) << "2.4 m apart";
  EXPECT_EQ(nlohmann::json::parse(places.out)["revisits"], 0);
}

TEST_F(CliTest, RefusesVocabulariesThatItCannotTrainOrRead) {
  const auto train = [](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"vocabulary", "train", "../drive"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  ExpectRefusedAtOnce(train({"--out", "v.cmvoc", "--branching", "1"}), "branching 1");
  ExpectRefusedAtOnce(train({"--out", "v.cmvoc", "--depth", "9"}), "nodes");
  ExpectRefusedAtOnce(train({"--out", "v.cmvoc", "--step", "0"}), "step 0");
  ExpectRefusedAtOnce(train({"--out", "no/v.cmvoc"}), "no/v.cmvoc: cannot be written");
  ExpectRefusedAtOnce(train({"--out", "../drive/calib.txt"}), "would change ");
  ExpectRefusedAtOnce({"vocabulary", "train", "../absent", "--out", "v.cmvoc"}, "../absent");
  ExpectRefused(train({"--out", "v.cmvoc", "--step", "100"}), "1 of at least two images");
  ExpectRefusedAtOnce({"vocabulary"}, "command is required", 2);
  ExpectRefusedAtOnce({"vocabulary", "info", "absent.cmvoc"}, "absent.cmvoc: no such file");
  ExpectRefusedAtOnce({"vocabulary", "info", "../base.cmap"}, "not a carmap vocabulary");
  ExpectRefusedAtOnce({"evaluate", "places", "../drive", "--vocabulary", "../base.cmap"},
                      "not a carmap vocabulary");
  fs::remove(CopyOfDrive() / "poses.txt");
  ASSERT_EQ(Run(train({"--out", "v.cmvoc", "--branching", "5", "--depth", "2"})).exit_code, 0);
  ExpectRefusedAtOnce({"evaluate", "places", "../drive", "../damaged", "--vocabulary", "v.cmvoc"},
                      "../damaged: has no poses.txt");
}

TEST_F(CliTest, ComparesDrivesAsTheFrontEndSeesThem) {
  const Result same = Run({"evaluate", "realism", "../drive", "../drive", "--json"});
  ASSERT_EQ(same.exit_code, 0) << same.err;
  const nlohmann::json json = nlohmann::json::parse(same.out);
  EXPECT_GE(json["bounded"], 29);
  EXPECT_EQ(json["within"], json["bounded"]);
  EXPECT_EQ(json["simulated"]["lost_pairs"], 0);
  for (const auto& measure : json["measures"]) {
    EXPECT_EQ(measure["distance"], 0) << measure["key"];
    EXPECT_GT(measure["simulated"]["count"], 0) << measure["key"];
    if (measure["key"] == "m_per_frame") {
      EXPECT_NEAR(measure["real"]["median"].get<double>(), 0.8, 0.02);
    }
  }

  CopyTestDrive(1, kFrames, work() / "dim");
  for (const char* side : {"image_0", "image_1"}) {
    for (const auto& entry : fs::directory_iterator(work() / "dim" / side)) {
      const std::string path = entry.path().string();
      cv::imwrite(path, cv::imread(path, cv::IMREAD_GRAYSCALE) / 2);
    }
  }
  const Result dim =
      Run({"evaluate", "realism", "dim", "../drive", "--frames", "12", "--picture", "p.png"});
  ASSERT_EQ(dim.exit_code, 0) << dim.err;
  EXPECT_THAT(dim.out, HasSubstr("12 frames, 11 pairs"));
  EXPECT_THAT(dim.out, testing::ContainsRegex("grey level, mean .* 0.5[0-9]  .* NO"));
  EXPECT_FALSE(cv::imread((work() / "p.png").string()).empty());
}

TEST_F(CliTest, RefusesDrivesThatItCannotCompare) {
  ExpectRefusedAtOnce({"evaluate", "realism", "../drive"}, "REAL_DRIVE", 2);
  ExpectRefusedAtOnce({"evaluate", "realism", "../drive", "../drive", "--frames", "3"}, "--frames",
                      2);
  ExpectRefusedAtOnce({"evaluate", "realism", "absent", "../drive"}, "absent: ");
  ExpectRefusedAtOnce({"evaluate", "realism", "../drive", "absent"}, "absent: ");
  ExpectRefusedAtOnce(
      {"evaluate", "realism", "../drive", "../drive", "--picture", "../drive/poses.txt"},
      "would change ");
  CopyTestDrive(1, 5, work() / "short");
  ExpectRefusedAtOnce({"evaluate", "realism", "short", "../drive"}, "short: has 5 frames");
  CopyTestDrive(1, 12, work() / "black");
  for (const char* side : {"image_0", "image_1"}) {
    for (const auto& entry : fs::directory_iterator(work() / "black" / side)) {
      cv::imwrite(entry.path().string(), cv::Mat(160, 320, CV_8UC1, cv::Scalar(0)));
    }
  }
  ExpectRefused({"evaluate", "realism", "black", "../drive"}, "black: between none of its frames");
}

// Wrong usage.

TEST_F(CliTest, MeasuresHowWellSegmentersTellStaticFromNonStatic) {
  CopyTestDrive(1, 4, work() / "drive");
  WriteLabels(work() / "drive/labels", 4, 120);
  WriteLabels(work() / "shifted", 4, 140);
  const Result result = Run({"evaluate", "segmentation", "drive", "--segmenter", "labels",
                             "--segmenter", "shifted", "--report", "r.json", "--picture", "p.png"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, AllOf(testing::ContainsRegex("labels +100.0 +100.0 +100.0 +100.0"),
                                testing::ContainsRegex("shifted +87.5 +84.6 +60.0"),
                                HasSubstr("3 frames with labels")));
  const nlohmann::json json = ReadJson("r.json");
  EXPECT_EQ(json["frames"], 3);
  ASSERT_EQ(json["segmenters"].size(), 2u);
  const nlohmann::json &truth = json["segmenters"][0], &shifted = json["segmenters"][1];
  EXPECT_EQ(truth["segmenter"], "labels");
  EXPECT_EQ(truth["features"]["non_static_found"], 1);
  EXPECT_EQ(truth["features"]["static_called_non_static"], 0);
  EXPECT_EQ(shifted["pixels"]["accuracy"], 0.875);
  EXPECT_EQ(shifted["pixels"]["non_static_iou"], 0.6);
  EXPECT_EQ(shifted["features"]["static"], truth["features"]["static"]);
  EXPECT_NEAR(shifted["features"]["non_static_found"].get<double>(), 0.75, 0.2);
  EXPECT_NEAR(shifted["features"]["static_called_non_static"].get<double>(), 20. / 240, 0.06);
  const cv::Mat picture = cv::imread((work() / "p.png").string());
  EXPECT_GT(picture.rows, 2 * 4 * 160) << "one above the other";

  const Result landmarks = Run({"evaluate", "segmentation", "drive", "--segmenter", "labels",
                                "--segmenter", "shifted", "--landmarks", "--report", "l.json"});
  ASSERT_EQ(landmarks.exit_code, 0) << landmarks.err;
  const nlohmann::json votes = ReadJson("l.json")["landmarks"];
  ASSERT_EQ(votes.size(), 6u) << "three cycles each";
  EXPECT_GT(votes[0]["non_static"], 0);
  EXPECT_EQ(votes[0]["non_static_found"], votes[0]["non_static"]);
  EXPECT_EQ(votes[0]["static_lost"], 0);
  EXPECT_GT(votes[3]["static_lost"], 0);

  const Result every =
      Run({"evaluate", "segmentation", "drive", "--segmenter", "labels", "--every", "3"});
  EXPECT_THAT(every.out, HasSubstr("1 frame with labels"));
}

TEST_F(CliTest, LeavesWhatIsNonStaticOutOfItsMap) {
  CopyTestDrive(1, 8, work() / "drive");
  const auto map = [&](const std::string& segmenter, const std::string& name) {
    const Result result = Run({"map", "drive", "--out", name + ".cmap", "--segmenter", segmenter,
                               "--report", name + ".json"});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return ReadJson(name + ".json");
  };
  WriteLabels(work() / "drive/labels", 8, 120);
  fs::copy(work() / "drive/labels/000001.png", work() / "drive/labels/000000.png");
  const nlohmann::json none = map("none", "none"), labels = map("labels", "labels");
  EXPECT_FALSE(none.contains("labelling"));
  EXPECT_EQ(labels["labelling"]["labelled"], labels["labelling"]["keyframes"]);
  EXPECT_GT(labels["labelling"]["non_static_landmarks"], 0);
  EXPECT_LT(labels["landmarks"], none["landmarks"]);
  EXPECT_EQ(map("default", "default")["labelling"]["failure"], "");

  const Result localized =
      Run({"localize", "drive", "--map", "labels.cmap", "--segmenter", "labels"});
  EXPECT_EQ(localized.exit_code, 0) << localized.err;

  const Result sheets =
      Run({"evaluate", "landmarks", "drive", "--segmenter", "labels", "--kept", "kept.png",
           "--removed", "removed.png", "--list", "list.csv", "--count", "30"});
  ASSERT_EQ(sheets.exit_code, 0) << sheets.err;
  EXPECT_THAT(sheets.out, HasSubstr("30 landmarks kept"));
  EXPECT_GT(cv::imread((work() / "kept.png").string()).rows, 2 * 72);
}

TEST_F(CliTest, SaysWhenItsMapIsUnfiltered) {
  CopyTestDrive(1, 5, work() / "drive");
  WriteLabels(work() / "drive/labels", 6, 120);
  for (const int frame : {1, 2, 3, 4}) {  // the first is what is looked at before the drive
    cv::imwrite((work() / fmt::format("drive/labels/{:06}.png", frame + 1)).string(),
                cv::Mat(16, 32, CV_8UC1, cv::Scalar(0)));
  }
  const Result result = Run({"map", "drive", "--out", "m.cmap", "--segmenter", "labels"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_THAT(result.err, AllOf(HasSubstr("may hold what was parked or moved"),
                                HasSubstr("labels/000002.png")));
  EXPECT_TRUE(fs::exists(work() / "m.cmap"));

  const Result localized = Run({"localize", "drive", "--map", "m.cmap", "--segmenter", "labels"});
  EXPECT_EQ(localized.exit_code, 3);
  EXPECT_THAT(localized.err, HasSubstr("may have tracked itself by traffic"));
}

TEST_F(CliTest, SaysWhenItsSegmenterTellsNothing) {
  CopyTestDrive(1, 5, work() / "drive");
  fs::create_directories(work() / "drive/labels");
  cv::imwrite((work() / "drive/labels/000099.png").string(), cv::Mat::zeros(160, 320, CV_8UC1));
  const Result result = Run({"map", "drive", "--out", "m.cmap", "--segmenter", "labels"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_THAT(result.err, HasSubstr("told nothing of any keyframe"));
  EXPECT_THAT(result.out, testing::ContainsRegex("segmented +0 of"));
  const Result sheets = Run({"evaluate", "landmarks", "drive", "--segmenter", "none", "--kept",
                             "k.png", "--removed", "r.png", "--list", "l.csv"});
  EXPECT_EQ(sheets.exit_code, 1);
  EXPECT_FALSE(fs::exists(work() / "k.png"));
}

TEST_F(CliTest, RefusesSegmentersAndLabelsThatItCannotEvaluate) {
  const std::vector<std::string> command = {"evaluate", "segmentation", "drive", "--segmenter"};
  const auto with = [&](const std::vector<std::string>& arguments) {
    std::vector<std::string> all = command;
    all.insert(all.end(), arguments.begin(), arguments.end());
    return all;
  };
  CopyTestDrive(1, 2, work() / "drive");
  ExpectRefusedAtOnce(with({"labels"}), "drive/labels: no such folder");
  WriteLabels(work() / "drive/labels", 2, 120);
  ExpectRefusedAtOnce(with({"none"}), "--segmenter none: tells nothing");
  ExpectRefusedAtOnce(with({"net.onnx"}), "net.json: no such file");
  ExpectRefusedAtOnce(with({"net"}), "net: is no segmenter");
  ExpectRefusedAtOnce({"evaluate", "segmentation", "drive"}, "--segmenter", 2);
  Write(work() / "net.json", "{}");
  ExpectRefusedAtOnce(with({"net.onnx"}), "net.json: \"input\" must be an object");
  ExpectRefusedAtOnce(with({"net.onnx", "--report", "net.json"}),
                      "net.json: would change net.json");
  ExpectRefused(with({"labels", "--every", "5"}), "has labels");
  Write(work() / "drive/labels/000001.png", "no image");
  ExpectRefusedAtOnce(with({"labels"}), "000001.png: ");
}

TEST_F(CliTest, RefusesWrongUsageWithExitCode2) {
  ExpectRefusedAtOnce({}, "command is required", 2);
  ExpectRefusedAtOnce({"mapp"}, "no command 'mapp'", 2);
  ExpectRefusedAtOnce({"map"}, "DRIVE", 2);
  ExpectRefusedAtOnce({"map", "../drive"}, "--out", 2);
  ExpectRefusedAtOnce({"map", "../drive", "--out", "m.cmap", "--frist", "3"}, "--frist", 2);
  ExpectRefusedAtOnce({"map", "../drive", "--out", "m.cmap", "--first", "-3"}, "--first", 2);
  ExpectRefusedAtOnce({"map", "../drive", "--out", "m.cmap", "--last", "x"}, "--last", 2);
  ExpectRefusedAtOnce({"localize", "../drive"}, "--map", 2);
  ExpectRefusedAtOnce({"stitch", "../base.cmap", "--out", "m.cmap"}, "SEGMENT", 2);
  ExpectRefusedAtOnce({"evaluate"}, "command is required", 2);
  ExpectRefusedAtOnce({"info", "../base.cmap", "another"}, "another", 2);
}

TEST_F(CliTest, RefusesOutputsThatItCannotOrMustNotWrite) {
  const auto map = [](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"map", "../drive"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  ExpectRefusedAtOnce(map({"--out", "no/such/m.cmap"}), "no/such/m.cmap: cannot be written");
  ExpectRefusedAtOnce(map({"--out", "../drive/calib.txt/m.cmap"}), "calib.txt/m.cmap: cannot");
  ExpectRefusedAtOnce(map({"--out", ".."}), "is a folder");
  ExpectRefusedAtOnce(map({"--out", "/dev/null"}), "/dev/null: is a device");
  ExpectRefusedAtOnce(map({"--out", "m.cmap", "--report", "no/r.json"}), "no/r.json");
  ExpectRefusedAtOnce(map({"--out", "m.cmap", "--picture", "no/p.png"}), "no/p.png");
  ExpectRefusedAtOnce({"localize", "../drive", "--map", "../base.cmap", "--trajectory", "no/t.txt"},
                      "no/t.txt");
  ExpectRefusedAtOnce({"stitch", "../base.cmap", "../segment.cmap", "--out", "no/road.cmap"},
                      "no/road.cmap");
}

TEST_F(CliTest, RefusesOutputsThatAreInputs) {
  const fs::path drive = CopyOfDrive();
  WriteLabels(drive / "labels", 2, 120);
  fs::copy(root_ / "base.cmap", work() / "a.cmap");
  fs::copy(root_ / "segment.cmap", work() / "b.cmap");
  fs::create_hard_link(work() / "a.cmap", work() / "hard.cmap");
  fs::create_symlink("b.cmap", work() / "link.cmap");
  fs::create_symlink("../damaged/image_1/000003.png", work() / "link.png");
  fs::create_hard_link(drive / "image_0/000005.png", work() / "hard.png");
  fs::create_directory_symlink("../damaged", work() / "d");
  fs::create_symlink("absent.cmap", work() / "to_absent.cmap");
  Write(work() / "net.json", "{}");
  const auto refuses = [](const std::string& command, const std::string& output,
                          const std::string& input) {
    std::istringstream words(command);
    ExpectRefusedAtOnce({std::istream_iterator<std::string>(words), {}},
                        fmt::format("{}: would change {}, ", output, input));
  };
  const std::string map = "map d --out m.cmap ", localize = "localize d --map a.cmap ";
  refuses("map d --out d/image_1/3.png", "d/image_1/3.png", "d/image_1");
  refuses(map + "--picture d/image_0/000005.png", "d/image_0/000005.png", "d/image_0");
  refuses(map + "--picture ../damaged/image_0/000005.png", "../damaged/image_0/000005.png",
          "d/image_0");
  refuses(map + "--picture link.png", "link.png", "d/image_1");
  refuses(map + "--picture hard.png", "hard.png", "d/image_0/000005.png");
  refuses(map + "--trajectory d/poses.txt", "d/poses.txt", "d/poses.txt");
  refuses(map + "--trajectory d/gps.txt", "d/gps.txt", "d/gps.txt");  // that is not there yet
  refuses(map + "--vocabulary v.cmvoc --full-map v.cmvoc", "v.cmvoc", "v.cmvoc");
  refuses(map + "--segmenter net.onnx --report net.json", "net.json", "net.json");
  refuses(map + "--segmenter labels --picture d/labels/000001.png", "d/labels/000001.png",
          "d/labels");
  refuses(localize + "--report hard.cmap", "hard.cmap", "a.cmap");
  refuses(localize + "--trajectory d/times.txt", "d/times.txt", "d/times.txt");
  refuses(localize + "--map-truth ../drive --frame-picture ../drive/poses.txt",
          "../drive/poses.txt", "../drive/poses.txt");
  refuses("stitch a.cmap b.cmap --out link.cmap", "link.cmap", "b.cmap");
  refuses("stitch a.cmap b.cmap --out n.cmap --report hard.cmap", "hard.cmap", "a.cmap");
  refuses("evaluate frames d --map a.cmap --map-truth ../drive --report ../drive/times.txt",
          "../drive/times.txt", "../drive/times.txt");
  refuses("evaluate segmentation d --segmenter none --picture d/labels/000001.png",
          "d/labels/000001.png", "d/labels");
  refuses("evaluate landmarks d --kept k.png --removed link.png --list l.csv", "link.png",
          "d/image_1");
  refuses("evaluate realism d ../drive --picture hard.png", "hard.png", "d/image_0/000005.png");
  refuses("vocabulary train d --out link.png", "link.png", "d/image_1");
  refuses("simulate --scene suburb --out d --path d/poses.txt", "d/poses.txt", "d/poses.txt");

  const auto are_one = [](const std::string& a, const std::string& b) {
    ExpectRefusedAtOnce({"map", "d", "--out", a, "--report", b},
                        fmt::format("{}: is the same file as {}, ", b, a));
  };
  are_one("m.cmap", "./m.cmap");
  are_one("a.cmap", "hard.cmap");
  are_one("link.cmap", "b.cmap");
  are_one("to_absent.cmap", "absent.cmap");
}

TEST_F(CliTest, WorksWithoutAStandardError) {
  ASSERT_EQ(Run({"map", "../drive", "--last", "7", "--out", "expected.cmap"}).exit_code, 0);
  fs::resize_file(CopyOfDrive() / Image("image_0", 3), 100);
  for (const char* redirection : {"2>/dev/full", "2>&-", "<&- 2>&-"}) {
    SCOPED_TRACE(redirection);
    const auto exit_code = [&](const std::vector<std::string>& arguments) {
      return RunTo(redirection, arguments).exit_code;
    };
    EXPECT_EQ(exit_code({"map", "../drive", "--last", "7", "--out", "m.cmap"}), 0);
    EXPECT_EQ(Read(work() / "m.cmap"), Read(work() / "expected.cmap"));
    EXPECT_EQ(exit_code({"map", "../damaged", "--last", "7", "--out", "m.cmap"}), 3);
    EXPECT_EQ(exit_code({"localize", "../damaged", "--map", "m.cmap", "--last", "7"}), 3);
    EXPECT_EQ(exit_code({"stitch", "../base.cmap", "../segment.cmap", "--out", "r.cmap"}), 0);
    EXPECT_EQ(exit_code({"info", "absent.cmap"}), 1);
    EXPECT_EQ(exit_code({"mapp"}), 2);
  }
}

TEST_F(CliTest, WorksOnWhenNobodyReadsItsStandardErrorAnyMore) {
  fs::resize_file(CopyOfDrive() / Image("image_0", 3), 100);
  RunProgram(work(), {"map", "../damaged", "--last", "7", "--out", "m.cmap"}, root_,
             "2>&3; echo $? >code; } | true", "{ exec 3>&1");
  EXPECT_EQ(Read(work() / "code"), "3\n");
  EXPECT_TRUE(ReadLeanMap(work() / "m.cmap").ok());
}

TEST_F(CliTest, WorksOnWhenItsTerminalIsClosed) {
  const Result result = RunProgram(
      work(), {"map", "../drive", "--replay", "6", "--out", "m.cmap"}, root_,
      "& program=$!; for i in 1 2 3; do sleep 0.8; kill -HUP $program; done; wait $program");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(ReadLeanMap(work() / "m.cmap").ok());
}

TEST_F(CliTest, WritesTheMapWhateverElseCannotBeWritten) {
  // The largest file that may be written, in blocks of 512 bytes: like a disk that is full.
  const Result result = RunProgram(work(),
                                   {"map", "../drive", "--out", "m.cmap", "--report", "r.json",
                                    "--picture", "p.png", "--trajectory", "t.txt"},
                                   root_, "", "ulimit -f 60");
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_THAT(result.problems(),
              testing::ElementsAre(AllOf(HasSubstr("p.png: cannot be written"), HasSubstr("; ")),
                                   HasSubstr("not written: p.png; written: m.cmap, t.txt, r.json")))
      << result.err;
  EXPECT_THAT(result.out, HasSubstr("16 of 16 frames"));
  EXPECT_THAT(FilesInWork(), testing::UnorderedElementsAre("m.cmap", "r.json", "t.txt"));
  EXPECT_TRUE(ReadLeanMap(work() / "m.cmap").ok());
  EXPECT_THAT(Run({"map", "--help"}).out, HasSubstr("3 map written but frames were lost"));

  const Result full =
      RunProgram(work(), {"map", "../drive", "--out", "n.cmap", "--trajectory", "n.txt"}, root_, "",
                 "ulimit -f 8");
  EXPECT_EQ(full.exit_code, 1);
  EXPECT_THAT(full.err, HasSubstr("not written: n.cmap; written: n.txt"));
  EXPECT_THAT(full.out, testing::Not(HasSubstr("n.cmap")));
}

TEST_F(CliTest, WritesThroughLinksAndObeysTheUmask) {
  fs::create_directory(work() / "maps");
  fs::create_symlink("maps/m.cmap", work() / "m.cmap");
  ASSERT_EQ(RunProgram(work(), {"map", "../drive", "--last", "7", "--out", "m.cmap"}, root_, "",
                       "umask 077")
                .exit_code,
            0);
  EXPECT_TRUE(fs::is_symlink(work() / "m.cmap"));
  EXPECT_EQ(fs::status(work() / "maps/m.cmap").permissions(), fs::perms(0600));
  EXPECT_TRUE(ReadLeanMap(work() / "maps/m.cmap").ok());
}

TEST_F(CliTest, FailsWhenItsStandardOutputIsFull) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "there is no /dev/full here";
  const std::string command = fmt::format("'{}' info '{}' >/dev/full 2>/dev/null", CARMAP_PROGRAM,
                                          (root_ / "base.cmap").string());
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 1);
}

// Drives that cannot be read at all: the same for map and localize.

class BadDrive : public CliTest {
 protected:
  static void ExpectRefusedByBoth(const std::string& what,
                                  const std::string& drive = "../damaged") {
    ExpectRefusedAtOnce({"map", drive, "--out", "m.cmap", "--report", "r.json"}, what);
    ExpectRefusedAtOnce({"localize", drive, "--map", "../base.cmap", "--report", "r.json"}, what);
  }
};

TEST_F(BadDrive, WithoutFolderOrFiles) {
  ExpectRefusedByBoth("../absent: no such folder", "../absent");
  ExpectRefusedByBoth("../base.cmap: no such folder", "../base.cmap");
  for (const char* name : {"image_0", "image_1", "calib.txt", "times.txt"}) {
    fs::remove_all(CopyOfDrive() / name);
    ExpectRefusedByBoth(name);
  }
}

TEST_F(BadDrive, WithUnequalImages) {
  const fs::path drive = CopyOfDrive();
  for (int frame = 0; frame < 9; ++frame) fs::remove(drive / Image("image_1", frame));
  ExpectRefusedByBoth("of 16 images in image_0 and 7 in image_1 only 7 have the same name");
}

TEST_F(BadDrive, Empty) {
  const fs::path drive = CopyOfDrive();
  for (const char* side : {"image_0", "image_1"}) {
    fs::remove_all(drive / side);
    fs::create_directory(drive / side);
  }
  ExpectRefusedByBoth("the drive is empty");
}

TEST_F(BadDrive, WithUnusableCalibration) {
  const fs::path drive = CopyOfDrive();
  const std::string calibration = Read(drive / "calib.txt");
  Write(drive / "calib.txt", Replace(calibration, "P1:", "P2:"));
  ExpectRefusedByBoth("'P1:' is missing");
  Write(drive / "calib.txt", Replace(calibration, "185.361741", "nan"));
  ExpectRefusedByBoth("nan");
  Write(drive / "calib.txt", "");
  ExpectRefusedByBoth("'P0:' is missing");
}

TEST_F(BadDrive, WithTimesThatGoBackOrLack) {
  const fs::path drive = CopyOfDrive();
  const std::string times = Read(drive / "times.txt");
  Write(drive / "times.txt", Replace(times, "0.700000\n", "0.500000\n"));
  ExpectRefusedByBoth("times.txt: line 8");
  Write(drive / "times.txt", Replace(times, "0.700000\n", ""));
  ExpectRefusedByBoth("has 15 times");
}

TEST_F(BadDrive, WithARangeOutsideIt) {
  ExpectRefusedAtOnce({"map", "../drive", "--first", "16", "--out", "m.cmap"}, "frames 0 to 15");
  ExpectRefusedAtOnce({"map", "../drive", "--last", "16", "--out", "m.cmap"}, "frames 0 to 15");
  ExpectRefusedAtOnce({"map", "../drive", "--first", "7", "--last", "6", "--out", "m.cmap"},
                      "frames 7 to 6");
}

TEST_F(BadDrive, OfWhichNoFrameCanBeTracked) {
  const fs::path drive = CopyOfDrive();
  for (int frame = 0; frame < kFrames; ++frame) {
    for (const char* side : {"image_0", "image_1"}) {
      cv::imwrite((drive / Image(side, frame)).string(),
                  cv::Mat(160, 320, CV_8UC1, cv::Scalar(frame)));
    }
  }
  ExpectRefused({"map", "../damaged", "--out", "m.cmap", "--report", "r.json"},
                "../damaged: no frame");
  ExpectRefused({"localize", "../damaged", "--map", "../base.cmap", "--trajectory", "t.txt"},
                "../damaged: no frame");
}

TEST_F(BadDrive, OfAnotherRoad) {
  CopyTestDrive(2, 8, root_ / "damaged");
  ExpectRefused({"localize", "../damaged", "--map", "../base.cmap", "--trajectory", "t.txt"},
                "no frame of 8 was found in ../base.cmap");
  // That no frame was found is a result too.
  EXPECT_EQ(
      Run({"localize", "../damaged", "--map", "../base.cmap", "--report", "r.json"}).exit_code, 1);
  EXPECT_EQ(ReadJson("r.json")["known_by"]["lost"], 8);
  EXPECT_EQ(ReadJson("r.json")["frames_detail"].size(), 8u);
  ASSERT_EQ(Run({"map", "../damaged", "--out", "other.cmap"}).exit_code, 0);
  ExpectRefused({"stitch", "../base.cmap", "other.cmap", "--out", "road.cmap"},
                "other.cmap: the segment does not overlap");
}

// Drives with a frame that cannot be used: the rest is done.

class LostFrameTest : public CliTest {
 protected:
  /// Frame 7 is lost: one line says what, the others are mapped and localized.
  static void ExpectOnlyFrame7Lost(const std::string& what, int dead_reckoned = 1) {
    const auto is_told =
        testing::ElementsAre(AllOf(HasSubstr("frame 7 "), HasSubstr(what), HasSubstr("; ")));
    const Result map = Run(
        {"map", "../damaged", "--out", "m.cmap", "--report", "r.json", "--trajectory", "t.txt"});
    EXPECT_EQ(map.exit_code, 3);
    EXPECT_THAT(map.problems(), is_told) << map.err;
    EXPECT_TRUE(ReadLeanMap(work() / "m.cmap").ok());
    const nlohmann::json report = ReadJson("r.json");
    EXPECT_EQ(report["tracked_frames"], kFrames - 1);
    ASSERT_EQ(report["lost_frames"].size(), 1u);
    EXPECT_EQ(report["lost_frames"][0]["index"], 7);
    EXPECT_LE(report["ate_rmse_m"].get<double>(), 0.1);
    const auto trajectory = ReadTrajectory(work() / "t.txt");
    ASSERT_TRUE(trajectory.ok());
    EXPECT_FALSE((*trajectory)[7].world_from_camera.has_value());

    const Result localize =
        Run({"localize", "../damaged", "--map", "m.cmap", "--report", "l.json"});
    EXPECT_EQ(localize.exit_code, 3);
    EXPECT_THAT(localize.problems(), is_told) << localize.err;
    const nlohmann::json localized = ReadJson("l.json");
    EXPECT_EQ(localized["known_by"]["map"], kFrames - dead_reckoned);
    EXPECT_EQ(localized["known_by"]["dead_reckoning"], dead_reckoned);
    EXPECT_EQ(localized["frames_detail"][7]["known_by"], "dead_reckoning");
  }
};

TEST_F(LostFrameTest, TruncatedImage) {
  fs::resize_file(CopyOfDrive() / Image("image_0", 7), 4000);
  ExpectOnlyFrame7Lost("image_0/000007.png");
}

TEST_F(LostFrameTest, ImageOfAnotherSize) {
  const fs::path drive = CopyOfDrive();
  cv::imwrite((drive / Image("image_1", 7)).string(), cv::Mat(100, 320, CV_8UC1, cv::Scalar(9)));
  ExpectOnlyFrame7Lost("image_1/000007.png: the image is 320x100");
}

TEST_F(LostFrameTest, BlackFrame) {
  const fs::path drive = CopyOfDrive();
  for (const char* side : {"image_0", "image_1"}) {
    cv::imwrite((drive / Image(side, 7)).string(), cv::Mat(160, 320, CV_8UC1, cv::Scalar(0)));
  }
  ExpectOnlyFrame7Lost("only 0 features");
}

TEST_F(LostFrameTest, MissingImage) {
  fs::remove(CopyOfDrive() / Image("image_1", 7));
  ExpectOnlyFrame7Lost("image_1/000007.png: no such file");
}

TEST_F(LostFrameTest, TimeOfTheFrameBefore) {
  const fs::path drive = CopyOfDrive();
  const std::string times = Read(drive / "times.txt");
  Write(drive / "times.txt", Replace(times, "0.700000\n", "0.600000\n"));
  ExpectOnlyFrame7Lost("times.txt: line 8: the time 0.600000 s is that of the frame before");
}

TEST_F(LostFrameTest, ARepeatedFrameIsNotLost) {
  const fs::path drive = CopyOfDrive();
  for (const char* side : {"image_0", "image_1"}) {
    fs::copy_file(drive / Image(side, 6), drive / Image(side, 7),
                  fs::copy_options::overwrite_existing);
  }
  const Result map = Run({"map", "../damaged", "--out", "m.cmap", "--report", "r.json"});
  EXPECT_EQ(map.exit_code, 0) << map.err;
  EXPECT_EQ(ReadJson("r.json")["tracked_frames"], kFrames);
  EXPECT_LE(ReadJson("r.json")["ate_rmse_m"].get<double>(), 0.1);
  const Result localize = Run({"localize", "../damaged", "--map", "m.cmap", "--report", "l.json"});
  EXPECT_EQ(localize.exit_code, 0) << localize.err;
  EXPECT_EQ(ReadJson("l.json")["known_by"]["dead_reckoning"], 1);
}

TEST_F(LostFrameTest, FrozenFrames) {
  const fs::path drive = CopyOfDrive();
  for (const int frame : {5, 6, 7}) {
    for (const char* side : {"image_0", "image_1"}) {
      fs::copy_file(drive / Image(side, 4), drive / Image(side, frame),
                    fs::copy_options::overwrite_existing);
    }
  }
  ExpectOnlyFrame7Lost("the same for 0.30 s: the camera was frozen", /*dead_reckoned=*/3);
}

TEST_F(LostFrameTest, ManyAreCountedAfterTen) {
  const fs::path drive = CopyOfDrive();
  for (int frame = 4; frame < kFrames; ++frame) {
    fs::resize_file(drive / Image("image_0", frame), 100);
  }
  const Result result = Run({"map", "../damaged", "--out", "m.cmap"});
  EXPECT_EQ(result.exit_code, 3);
  ASSERT_GE(result.problems().size(), 11u);
  EXPECT_THAT(result.problems()[10], HasSubstr("12 frames lost in all"));
}

TEST_F(LostFrameTest, AMapWithoutLandmarksReplacesNone) {
  fs::copy(root_ / "base.cmap", work() / "m.cmap");
  for (const char* last : {"0", "1"}) {
    const Result result = Run({"map", "../drive", "--last", last, "--out", "m.cmap", "--full-map",
                               "m.cfull", "--report", "r.json", "--picture", "p.png"});
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_THAT(result.problems(),
                testing::ElementsAre(
                    AllOf(HasSubstr("the map is empty"), HasSubstr("; ")), HasSubstr("empty"),
                    HasSubstr("not written: m.cmap, m.cfull; written: p.png, r.json")));
    EXPECT_EQ(Read(work() / "m.cmap"), Read(root_ / "base.cmap"));
    EXPECT_FALSE(fs::exists(work() / "m.cfull"));
    EXPECT_TRUE(ReadJson("r.json")["bytes_per_landmark"].is_null());
  }
}

TEST_F(CliTest, LocalizesByNoMapWithoutLandmarks) {
  auto map = ReadLeanMap(root_ / "base.cmap");
  ASSERT_TRUE(map.ok()) << map.status();
  map->landmarks.clear();
  ASSERT_TRUE(WriteLeanMap(work() / "m.cmap", *map).ok());
  ExpectRefusedAtOnce({"localize", "../drive", "--map", "m.cmap"}, "m.cmap: holds no landmark");
}

// Map files that cannot be trusted.

class BadMap : public CliTest {
 protected:
  void SetUp() override {
    CliTest::SetUp();
    bytes_ = Read(root_ / "base.cmap");
  }

  static void ExpectRefusedByAll(const std::string& bytes, const std::string& what) {
    Write(work() / "bad.cmap", bytes);
    const std::string message = "bad.cmap: " + what;
    ExpectRefusedAtOnce({"info", "bad.cmap"}, message);
    ExpectRefusedAtOnce({"info", "bad.cmap", "--json"}, message);
    ExpectRefusedAtOnce({"localize", "../drive", "--map", "bad.cmap", "--report", "r.json"},
                        message);
    ExpectRefusedAtOnce({"stitch", "bad.cmap", "../segment.cmap", "--out", "n.cmap"}, message);
    ExpectRefusedAtOnce({"stitch", "../segment.cmap", "bad.cmap", "--out", "n.cmap"}, message);
  }

  std::string bytes_;
};

TEST_F(BadMap, Absent) {
  ExpectRefusedAtOnce({"info", "absent.cmap"}, "absent.cmap: no such file");
  ExpectRefusedAtOnce({"info", ".."}, "..: is a folder");
  ExpectRefusedAtOnce({"localize", "../drive", "--map", "absent.cmap"},
                      "absent.cmap: no such file");
  ExpectRefusedAtOnce({"stitch", "../base.cmap", "absent.cmap", "--out", "n.cmap"}, "absent.cmap");
}

TEST_F(BadMap, Cut) {
  for (const size_t size :
       {size_t{0}, size_t{1}, size_t{30}, bytes_.size() / 2, bytes_.size() - 1}) {
    ExpectRefusedByAll(bytes_.substr(0, size), "cut short");
  }
}

TEST_F(BadMap, WithFlippedBits) {
  for (const size_t position :
       {size_t{0}, size_t{17}, size_t{40}, size_t{150}, bytes_.size() / 3, bytes_.size() - 1}) {
    std::string damaged = bytes_;
    damaged[position] = static_cast<char>(damaged[position] ^ 0x10);
    ExpectRefusedByAll(damaged, "");
  }
}

TEST_F(BadMap, OfANewerVersion) {
  std::string newer = bytes_;
  newer[8] = 9;
  ExpectRefusedByAll(newer, "");
  EXPECT_THAT(Run({"info", "bad.cmap"}).err, AllOf(HasSubstr("version 9"), HasSubstr("upgrade")));
}

TEST_F(BadMap, ThatWouldNeedTerabytes) {
  std::vector<Section> sections;
  const auto views = ReadContainer(bytes_, "base.cmap");
  ASSERT_TRUE(views.ok());
  for (const SectionView& view : *views) {
    sections.push_back({view.id, view.is_mandatory, std::string(view.content)});
  }
  // Keyframes at byte 5 of the counts, observations at 25 (docs/format.md).
  std::fill_n(sections[0].content.begin() + 5, 4, '\xff');
  std::fill_n(sections[0].content.begin() + 25, 8, '\xff');
  ExpectRefusedByAll(WriteContainer(sections), "claims");
}

TEST_F(BadMap, ThatIsNone) { ExpectRefusedByAll("P0: 1 0 0 0 this is no map at all", ""); }

TEST_F(BadMap, StitchedTwice) {
  ExpectRefusedAtOnce({"stitch", "../base.cmap", "../base.cmap", "--out", "n.cmap"},
                      "base.cmap: drive");
}

TEST_F(CliTest, RefusesTruthThatDoesNotFit) {
  const fs::path drive = CopyOfDrive();
  fs::remove(drive / "poses.txt");
  const std::vector<std::string> localize = {"localize", "../drive", "--map", "../base.cmap",
                                             "--map-truth"};
  const auto with = [&](const std::string& folder) {
    std::vector<std::string> arguments = localize;
    arguments.push_back(folder);
    return arguments;
  };
  ExpectRefusedAtOnce(with("../damaged"), "../damaged/poses.txt");
  ExpectRefusedAtOnce(with("../absent"), "../absent");
  const fs::path later = CopyOfDrive();
  std::string times;
  for (size_t i = 0; i < kFrames; ++i) times += fmt::format("{:.1f}\n", 100 + 0.1 * i);
  Write(later / "times.txt", times);
  ExpectRefusedAtOnce(with("../damaged"), "0 have a time stamp of the ground truth");
}

TEST_F(CliTest, RefusesTrajectoriesThatItCannotCompare) {
  Write(work() / "t.txt", "1 0 0 0 0 1 0 0 0 0 1\n");
  const std::string truth = "../drive/poses.txt";
  ExpectRefusedAtOnce({"evaluate", "trajectory", "t.txt", truth}, "t.txt: line 1");
  ExpectRefusedAtOnce({"evaluate", "trajectory", truth, "absent.txt"}, "absent.txt: no such file");
  Write(work() / "t.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  ExpectRefusedAtOnce({"evaluate", "trajectory", "t.txt", truth}, "t.txt: ");
}

// The real drive.

/// Where it should be; it may be absent.
std::string RealDriveFolder(const std::string& name) {
  const char* data = std::getenv("CARMAP_DATA");
  return fs::absolute(fs::path(data ? data : CARMAP_DATA_DIR) / name).string();
}

class RealDrive : public CliTest {
 protected:
  void SetUp() override {
    CliTest::SetUp();
    drive_ = RealDriveFolder("kitti06_000-050");
    if (!fs::is_directory(drive_)) GTEST_SKIP() << drive_ << " is absent";
  }

  std::string drive_;
};

TEST_F(RealDrive, MeetsTheTargetsForAccuracyAndSize) {
  const Result map = Run({"map", drive_, "--sequential", "--out", "full.cmap", "--trajectory",
                          "full.txt", "--report", "full.json"});
  ASSERT_EQ(map.exit_code, 0) << map.err;
  const nlohmann::json mapped = ReadJson("full.json");
  EXPECT_LE(mapped["ate_rmse_m"].get<double>(), 0.05);
  EXPECT_LE(mapped["t_rel_5_50_percent"].get<double>(), 0.65);
  EXPECT_LE(mapped["bytes_per_landmark"].get<double>(), 55);
  EXPECT_GE(mapped["composition_bytes"]["full"].get<double>(),
            25 * mapped["composition_bytes"]["lean"].get<double>());

  // The same drive in its map, against the mapping trajectory: both are in the map's frame.
  const Result localize =
      Run({"localize", drive_, "--map", "full.cmap", "--trajectory", "loc.txt"});
  ASSERT_EQ(localize.exit_code, 0) << localize.err;
  const Trajectory expected = ReadTrajectory(work() / "full.txt").value();
  const Trajectory localized = ReadTrajectory(work() / "loc.txt").value();
  std::vector<double> errors_m;
  for (size_t i = 0; i < expected.size(); ++i) {
    ASSERT_TRUE(localized[i].world_from_camera.has_value()) << "frame " << i;
    errors_m.push_back(
        (localized[i].world_from_camera->translation - expected[i].world_from_camera->translation)
            .norm());
  }
  std::sort(errors_m.begin(), errors_m.end());
  EXPECT_LE(errors_m[errors_m.size() / 2], 0.02);
  EXPECT_LE(errors_m.back(), 0.1);
}

TEST_F(RealDrive, LocalizesEachFrameInAStitchedMap) {
  ASSERT_EQ(Run({"map", drive_, "--last", "33", "--sequential", "--out", "a.cmap"}).exit_code, 0);
  ASSERT_EQ(Run({"map", drive_, "--first", "18", "--sequential", "--out", "b.cmap"}).exit_code, 0);
  const Result stitch = Run({"stitch", "a.cmap", "b.cmap", "--out", "road.cmap"});
  ASSERT_EQ(stitch.exit_code, 0) << stitch.err;
  const Result localize =
      Run({"localize", drive_, "--map", "road.cmap", "--map-truth", drive_, "--report", "r.json"});
  ASSERT_EQ(localize.exit_code, 0) << localize.err;
  const nlohmann::json report = ReadJson("r.json");
  EXPECT_EQ(report["localized_frames"], 51);
  EXPECT_LE(report["position_error_m"]["max"].get<double>(), 0.15);
}

/// Skipped where it is absent.
TEST_F(CliTest, PutsARealDriveWithGpsOnTheEarth) {
  const std::string drive = RealDriveFolder("kitti_raw_2011_09_26_0001");
  if (!fs::is_directory(drive)) GTEST_SKIP() << drive << " is absent";
  const Result map = Run({"map", drive, "--out", "m.cmap", "--report", "r.json"});
  ASSERT_EQ(map.exit_code, 0) << map.err;
  const nlohmann::json report = ReadJson("r.json");
  EXPECT_LT(report["georeference"]["fix_error_m"]["median"].get<double>(), 0.5);
  EXPECT_NEAR(report["georeference"]["origin"]["latitude_deg"].get<double>(), 49, 0.1);
  const auto lean = ReadLeanMap(work() / "m.cmap");
  ASSERT_TRUE(lean.ok()) << lean.status();
  for (const LeanKeyframe& keyframe : lean->keyframes) EXPECT_TRUE(keyframe.gps);
}

/// The real drive with GPS, whose gps.txt is changed row by row.
class RealGpsDrive : public CliTest {
 protected:
  struct Row {
    double latitude_deg, longitude_deg, altitude_m;
  };
  using Change = std::function<Row(int, const Row&)>;

  void SetUp() override {
    CliTest::SetUp();
    source_ = RealDriveFolder("kitti_raw_2011_09_26_0001");
    if (!fs::is_directory(source_)) GTEST_SKIP() << source_ << " is absent";
    ASSERT_EQ(
        Run({"map", source_.string(), "--out", "good.cmap", "--report", "good.json"}).exit_code, 0);
  }

  void WriteDrive(const Change& change) const {
    fs::remove_all(work() / "d");
    fs::create_directory(work() / "d");
    for (const char* name : {"image_0", "image_1", "calib.txt", "times.txt", "poses.txt"}) {
      fs::create_symlink(source_ / name, work() / "d" / name);
    }
    std::ifstream rows(source_ / "gps.txt");
    std::ofstream changed(work() / "d" / "gps.txt");
    int index = 0;
    for (std::string line; std::getline(rows, line);) {
      if (line.empty() || line.front() == '#') continue;
      std::istringstream row(line);
      std::string time;
      Row fix{};
      row >> time >> fix.latitude_deg >> fix.longitude_deg >> fix.altitude_m;
      fix = change(index++, fix);
      changed << fmt::format("{} {} {} {}\n", time, fix.latitude_deg, fix.longitude_deg,
                             fix.altitude_m);
    }
  }

  /// The report of the changed drive's map, m.cmap.
  nlohmann::json MapChanged(const Change& change, int exit_code = 0) const {
    WriteDrive(change);
    const Result map = Run({"map", "d", "--out", "m.cmap", "--report", "r.json"});
    EXPECT_EQ(map.exit_code, exit_code) << map.err;
    const nlohmann::json report = ReadJson("r.json");
    EXPECT_LE(report["ate_rmse_m"].get<double>(), 0.2) << "whatever GPS says";
    return report;
  }

  /// The largest distance between keyframes' places on the Earth in m.cmap and in good.cmap.
  static double WorstPlaceErrorM() {
    const LeanMap map = ReadLeanMap(work() / "m.cmap").value(),
                  good = ReadLeanMap(work() / "good.cmap").value();
    EXPECT_EQ(map.keyframes.size(), good.keyframes.size());
    double worst_m = 0;
    for (size_t i = 0; i < std::min(map.keyframes.size(), good.keyframes.size()); ++i) {
      const Eigen::Vector3d error =
          LocalEnu(*good.keyframes[i].gps).FromGps(map.keyframes[i].gps.value());
      worst_m = std::max(worst_m, error.head<2>().norm());
    }
    return worst_m;
  }

  fs::path source_;
};

TEST_F(RealGpsDrive, IsMappedAsWithoutTheRowsThatAreWrong) {
  const Row berlin{52.52, 13.4, 30}, no_fix{0, 0, 0};
  struct Case {
    Change change;
    size_t outliers, without_fix;
  };
  const std::vector<Case> cases = {
      {[&](int i, const Row& row) { return i == 0 ? berlin : row; }, 1, 0},
      {[&](int i, const Row& row) { return i == 50 ? berlin : row; }, 1, 0},
      {[&](int i, Row row) {
         if (i == 0) row.latitude_deg += 0.5;
         return row;
       },
       1, 0},
      {[&](int i, const Row& row) { return i < 15 ? no_fix : row; }, 0, 15},
      {[&](int i, const Row& row) {
         return i % 5 == 0 ? Row{std::nan(""), std::nan(""), 0} : row;
       },
       0, 22}};
  for (const Case& test : cases) {
    const nlohmann::json gps = MapChanged(test.change)["health"]["gps"];
    EXPECT_EQ(gps["rows"], 108);
    EXPECT_EQ(gps["outliers"], test.outliers);
    EXPECT_EQ(gps["without_fix"], test.without_fix);
    EXPECT_EQ(gps["used"], 108 - test.outliers - test.without_fix);
    EXPECT_FALSE(gps.contains("contradiction"));
    EXPECT_LE(WorstPlaceErrorM(), 0.2);
  }
}

TEST_F(RealGpsDrive, IsNotHeldByRowsThatContradictIt) {
  constexpr double kRadPerDeg = M_PI / 180;
  const std::vector<std::pair<Change, std::string>> cases = {
      {[](int, const Row& row) {
         return Row{kRadPerDeg * row.latitude_deg, kRadPerDeg * row.longitude_deg, row.altitude_m};
       },
       "radians"},
      {[](int, const Row& row) {
         return Row{row.longitude_deg, row.latitude_deg, row.altitude_m};
       },
       "swapped"},
      {[](int, const Row& row) {
         return Row{50 + 3 * (row.latitude_deg - 49), row.longitude_deg, row.altitude_m};
       },
       "of another drive"},
      {[](int, const Row&) {
         return Row{49.015, 8.4343, 116};
       },
       "repeat one place"}};
  for (const auto& [change, cause] : cases) {
    const nlohmann::json report = MapChanged(change, /*exit_code=*/3);
    EXPECT_FALSE(report.contains("georeference")) << cause;
    EXPECT_THAT(report["health"]["gps"].value("contradiction", ""), HasSubstr(cause));
  }
}

TEST_F(RealGpsDrive, IsFoundWhereItsFixesAreNot) {
  const auto localize = [&](const Change& change, int exit_code = 0) {
    WriteDrive(change);
    const Result found = Run({"localize", "d", "--map", "good.cmap", "--map-truth",
                              source_.string(), "--report", "l.json"});
    EXPECT_EQ(found.exit_code, exit_code) << found.err;
    const nlohmann::json report = ReadJson("l.json");
    EXPECT_EQ(report["localized_frames"], 108);
    EXPECT_LE(report["position_error_m"]["max"].get<double>(), 0.5);
    return report["health"]["gps"];
  };
  EXPECT_EQ(localize([](int, const Row&) { return Row{0, 0, 0}; })["without_fix"], 108);
  const nlohmann::json off = localize(
      [](int, Row row) {
        row.latitude_deg += 60 / 111200.0;
        return row;
      },
      /*exit_code=*/3);
  EXPECT_EQ(off["outliers"], 108);
  EXPECT_THAT(off.value("contradiction", ""), HasSubstr("lie 60 m"));
  EXPECT_EQ(localize([](int, const Row& row) { return row; })["used"], 108);
}

}  // namespace
}  // namespace carmap
