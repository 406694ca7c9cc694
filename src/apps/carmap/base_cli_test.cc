// `carmap base` as its users meet it.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/carmap/program_runner.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// Two overlapping maps of one simulated drive, and one of another town.
class BaseCliTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    root_ = fs::path(testing::TempDir()) / "carmap_base_cli_test";
    fs::remove_all(root_);
    fs::create_directories(root_ / "work");
    const auto map = [](int town, const std::vector<std::string>& range, const std::string& out) {
      std::vector<std::string> arguments = {"map", Drive(town), "--out", (root_ / out).string()};
      arguments.insert(arguments.end(), range.begin(), range.end());
      const Result result = RunProgram(root_, arguments, root_);
      ASSERT_EQ(result.exit_code, 0) << result.err;
    };
    map(1, {"--last", "10"}, "monday.cmap");
    map(1, {"--first", "4"}, "tuesday.cmap");
    map(2, {}, "elsewhere.cmap");
  }
  static void TearDownTestSuite() { fs::remove_all(root_); }

  void SetUp() override {
    fs::remove_all(root_ / "work");
    fs::create_directories(root_ / "work");
    ASSERT_EQ(Run({"base", "init", "town.base"}).exit_code, 0);
  }

  static std::string Drive(int town) {
    return (fs::path(CARMAP_TEST_DRIVES) / fmt::format("town_{}", town)).string();
  }
  static Result Run(const std::vector<std::string>& arguments,
                    const std::string& preparation = "") {
    return RunProgram(root_ / "work", arguments, root_, "", preparation);
  }
  static nlohmann::json Info() {
    return nlohmann::json::parse(Run({"base", "info", "town.base", "--json"}).out);
  }
  static void ExpectRefused(const std::vector<std::string>& arguments, const std::string& what) {
    SCOPED_TRACE(fmt::format("{}", fmt::join(arguments, " ")));
    const Result result = Run(arguments);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_THAT(result.problems(), ElementsAre(HasSubstr(what))) << result.err;
  }

  static fs::path root_;
};

fs::path BaseCliTest::root_;

TEST_F(BaseCliTest, GrowsByWhatIsAdded) {
  const Result added = Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap",
                            "../elsewhere.cmap", "--report", "r.json", "--picture", "p.png"});
  ASSERT_EQ(added.exit_code, 0) << added.err;
  const auto report = nlohmann::json::parse(Read(root_ / "work" / "r.json"));
  ASSERT_EQ(report["added"].size(), 3u);
  EXPECT_EQ(report["added"][1]["component"], 1);
  EXPECT_GT(report["added"][1]["fit"]["inliers"], 100);
  EXPECT_LT(report["added"][1]["landmarks_added"], report["added"][1]["landmarks"]);
  EXPECT_TRUE(report["added"][2]["is_new_component"]);
  EXPECT_GT(fs::file_size(root_ / "work" / "p.png"), 10'000u);
  EXPECT_EQ(Info()["components"].size(), 2u);

  EXPECT_THAT(Run({"base", "log", "town.base"}).out,
              AllOf(HasSubstr("monday.cmap"), HasSubstr("tuesday.cmap"), HasSubstr("add")));
  const Result verified = Run({"base", "verify", "town.base"});
  EXPECT_EQ(verified.exit_code, 0) << verified.err;

  const Result localized = Run({"localize", Drive(1), "--map", "town.base", "--report", "l.json"});
  EXPECT_EQ(localized.exit_code, 0) << localized.err;
  const auto frames = nlohmann::json::parse(Read(root_ / "work" / "l.json"));
  EXPECT_GE(frames["localized_frames"], 10);
}

TEST_F(BaseCliTest, ExportsAMapThatLocalizes) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  ASSERT_EQ(Run({"base", "export", "town.base", "--out", "m.cmap"}).exit_code, 0);
  const auto exported = ReadLeanMap(root_ / "work" / "m.cmap");
  const auto source = ReadLeanMap(root_ / "monday.cmap");
  ASSERT_TRUE(exported.ok()) << exported.status();
  EXPECT_EQ(exported->landmarks.size(), source->landmarks.size());
  EXPECT_EQ(Run({"localize", Drive(1), "--map", "m.cmap"}).exit_code, 0);
}

TEST_F(BaseCliTest, TakesEachDriveOnceAndTheRestAllTheSame) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  ExpectRefused({"base", "add", "town.base", "../monday.cmap"}, "is in the base already");
  const Result some =
      Run({"base", "add", "town.base", "../monday.cmap", "absent.cmap", "../tuesday.cmap"});
  EXPECT_EQ(some.exit_code, 3);
  EXPECT_THAT(some.problems(), ElementsAre(HasSubstr("already"), HasSubstr("absent.cmap")));
  EXPECT_THAT(some.out, HasSubstr("tuesday.cmap: component 1"));
}

TEST_F(BaseCliTest, TakesAContributionBack) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  const auto before = Info()["components"];
  ASSERT_EQ(Run({"base", "add", "town.base", "../tuesday.cmap", "--report", "r.json"}).exit_code,
            0);
  const std::string drive =
      nlohmann::json::parse(Read(root_ / "work" / "r.json"))["added"][0]["drives"][0];
  const Result reverted = Run({"base", "revert", "town.base", drive.substr(0, 12)});
  EXPECT_EQ(reverted.exit_code, 0) << reverted.err;
  EXPECT_EQ(Info()["components"][0]["landmarks"], before[0]["landmarks"]);
  EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0);
  EXPECT_EQ(Run({"base", "add", "town.base", "../tuesday.cmap"}).exit_code, 0);
}

TEST_F(BaseCliTest, RestoresABaseThatCannotBeOpened) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap"}).exit_code, 0);
  const auto before = Info()["components"];
  std::ofstream(root_ / "work" / "town.base" / "rocksdb" / "CURRENT") << "nonsense";
  ExpectRefused({"base", "info", "town.base"}, "carmap base verify town.base --repair");
  const Result repaired = Run({"base", "verify", "town.base", "--repair"});
  EXPECT_EQ(repaired.exit_code, 0) << repaired.err;
  EXPECT_THAT(repaired.out, AllOf(HasSubstr("restored"), HasSubstr("rocksdb.damaged.1")));
  EXPECT_EQ(Info()["components"], before);
  ExpectRefused({"base", "add", "town.base", "../monday.cmap"}, "is in the base already");
}

TEST_F(BaseCliTest, RepairsAndDiscardsUntilItIsSound) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap"}).exit_code, 0);
  // The journal's and the patches' tables, as a bad disk may take them.
  const fs::path database = root_ / "work" / "town.base" / "rocksdb";
  ASSERT_EQ(Run({"base", "compact", "town.base", "--keep", "1"}).exit_code, 0);
  for (const auto& entry : fs::directory_iterator(database)) {
    if (entry.path().extension() == ".log") fs::resize_file(entry.path(), 0);
    if (entry.path().filename().string().starts_with("MANIFEST")) fs::resize_file(entry.path(), 9);
  }
  EXPECT_EQ(Run({"base", "info", "town.base"}).exit_code, 1);
  Run({"base", "verify", "town.base", "--repair"});
  const Result discarded = Run({"base", "verify", "town.base", "--discard"});
  EXPECT_EQ(discarded.exit_code, 0) << discarded.err;
  EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0);
  EXPECT_EQ(Run({"base", "add", "town.base", "../elsewhere.cmap"}).exit_code, 0);
}

TEST_F(BaseCliTest, EvaluatesStitchingAgainstItsOwnTruthOnly) {
  const std::vector<std::string> command = {"evaluate", "stitching", "../monday.cmap",
                                            "../tuesday.cmap", "--base-truth"};
  const auto with = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  };
  const Result made = Run(with({Drive(1), "--report", "r.json", "--picture", "p.png"}));
  EXPECT_EQ(made.exit_code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("| tuesday |"));
  const auto report = nlohmann::json::parse(Read(root_ / "work" / "r.json"));
  EXPECT_EQ(report["segments"][0]["ways"].size(), 3u);
  EXPECT_TRUE(report["segments"][0]["ways"][0]["stitched"]);
  EXPECT_LT(report["segments"][0]["ways"][0]["map_error_m"]["mean"], 0.2);
  EXPECT_TRUE(fs::exists(root_ / "work" / "p.png"));
  ExpectRefused(with({Drive(2)}), "none of its 1 drives is");
  ExpectRefused(with({Drive(1), "--segment-truth", Drive(2)}), "none of its 1 drives is");
  ExpectRefused(with({Drive(1), "--ways", "quicksketch"}), "carmap map --full-map");
}

TEST_F(BaseCliTest, AdjustsAndCompacts) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap"}).exit_code, 0);
  const Result adjusted = Run({"base", "adjust", "town.base", "--report", "a.json"});
  EXPECT_EQ(adjusted.exit_code, 0) << adjusted.err;
  EXPECT_THAT(adjusted.out, HasSubstr("of 2 contributions"));
  const auto report = nlohmann::json::parse(Read(root_ / "work" / "a.json"))["adjusted"][0];
  EXPECT_EQ(report["contributions"], 2);
  EXPECT_LE(report["misfit_after"], report["misfit_before"]);
  EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0);
  const Result compacted = Run({"base", "compact", "town.base", "--keep", "1"});
  EXPECT_EQ(compacted.exit_code, 0) << compacted.err;
  EXPECT_THAT(compacted.out, HasSubstr("newest patch at most"));
  EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0);
  EXPECT_EQ(Run({"base", "compact", "town.base", "--keep", "0"}).exit_code, 2);
}

TEST_F(BaseCliTest, ExplainsALandmark) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap"}).exit_code, 0);
  const auto map = ReadLeanMap(root_ / "monday.cmap").value();
  const Result told = Run({"base", "explain", "town.base", ToHex(map.drives[0].id) + ":3"});
  EXPECT_EQ(told.exit_code, 0) << told.err;
  EXPECT_THAT(told.out, AllOf(HasSubstr("seen by"), HasSubstr("add of monday.cmap: added")));
  ExpectRefused({"base", "explain", "town.base", "nonsense"}, "is neither a landmark");
  ExpectRefused({"base", "explain", "town.base", "49,8"}, "has nothing within");
}

TEST_F(BaseCliTest, SaysWhatIsWrong) {
  ExpectRefused({"base", "init", "town.base"}, "town.base");
  ExpectRefused({"base", "info", "absent.base"}, "absent.base");
  fs::create_directories(root_ / "work" / "folder");
  ExpectRefused({"base", "add", "folder", "../monday.cmap"}, "folder");
  ExpectRefused({"localize", Drive(1), "--map", "folder"}, "folder");
  ExpectRefused({"base", "export", "town.base", "--out", "m.cmap"}, "no such component");
  ExpectRefused({"base", "revert", "town.base", "777777"}, "no drive of the base");
  ExpectRefused({"base", "revert", "town.base", ""}, "too short for a drive's id");
  ExpectRefused({"base", "adjust", "town.base", "--component", "3"}, "no such component");
  ExpectRefused({"localize", Drive(1), "--map", "town.base"}, "is empty");
  EXPECT_EQ(Run({"base"}).exit_code, 2);
  EXPECT_EQ(Run({"base", "add", "town.base"}).exit_code, 2);
}

TEST_F(BaseCliTest, TeachesItself) {
  for (const char* command : {"init", "add", "info", "log", "verify", "export", "revert", "adjust",
                              "compact", "explain"}) {
    const Result help = Run({"base", command, "--help"});
    EXPECT_EQ(help.exit_code, 0);
    EXPECT_THAT(help.out, HasSubstr("Exit codes:")) << command;
  }
  EXPECT_THAT(Run({"base", "--help"}).out, HasSubstr("carmap base init town.base"));
}

// What was reported as added is there, whenever the program is killed.
TEST_F(BaseCliTest, LosesNothingWhenItIsKilled) {
  for (int i = 0; i < 8; ++i) {
    const Result killed =
        Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap", "../elsewhere.cmap"},
            fmt::format("timeout -s KILL 0.{:02} \\", 5 + 6 * i));
    const Result log = Run({"base", "log", "town.base"});
    ASSERT_EQ(log.exit_code, 0) << log.err;
    for (const char* name : {"monday.cmap", "tuesday.cmap", "elsewhere.cmap"}) {
      if (killed.out.find(fmt::format("{}: component", name)) == std::string::npos) continue;
      EXPECT_THAT(log.out, HasSubstr(name)) << i;
    }
    EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0) << i;
  }
}

TEST_F(BaseCliTest, ADrivePublishesWhatItSawAndTheBaseTakesItOnce) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap", "../tuesday.cmap"}).exit_code, 0);
  const Result driven =
      Run({"drive", Drive(1), "--base", "town.base", "--out", "parts", "--report", "r.json"});
  ASSERT_EQ(driven.exit_code, 0) << driven.err;
  const auto report = nlohmann::json::parse(Read(root_ / "work" / "r.json"));
  ASSERT_EQ(report["parts"].size(), 1u);
  EXPECT_EQ(report["parts"][0]["kind"], "diff");
  EXPECT_GT(report["parts"][0]["seen"], 50);
  EXPECT_LT(report["parts"][0]["landmarks"], 20) << "nothing is new to it";
  std::string part;
  for (const auto& file : fs::directory_iterator(root_ / "work" / "parts")) {
    part = file.path().string();
    EXPECT_EQ(file.path().extension(), ".cmdiff");
  }
  const Result added = Run({"base", "add", "town.base", part, "--report", "a.json"});
  ASSERT_EQ(added.exit_code, 0) << added.err;
  EXPECT_THAT(added.out, HasSubstr("passes by"));
  const auto taken = nlohmann::json::parse(Read(root_ / "work" / "a.json"))["added"][0];
  EXPECT_EQ(taken["seen"], report["parts"][0]["seen"]);
  EXPECT_EQ(taken["landmarks_vanished"], 0);
  ExpectRefused({"base", "add", "town.base", part}, "is in the base already");
  EXPECT_EQ(Run({"base", "verify", "town.base"}).exit_code, 0);
}

TEST_F(BaseCliTest, ADriveThatTellsNothingPublishesNothing) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../elsewhere.cmap"}).exit_code, 0);
  ExpectRefused({"drive", Drive(1), "--base", "town.base", "--out", "parts", "--last", "0"},
                "nothing could be mapped");
  EXPECT_FALSE(fs::exists(root_ / "work" / "parts"));
}

TEST_F(BaseCliTest, ADriveOnUnknownRoadPublishesASegment) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../elsewhere.cmap"}).exit_code, 0);
  const Result driven = Run({"drive", Drive(1), "--base", "town.base", "--out", "parts"});
  ASSERT_EQ(driven.exit_code, 0) << driven.err;
  EXPECT_THAT(driven.out, HasSubstr("segment (nothing of the base was seen on it)"));
  const Result added = Run({"base", "add", "town.base",
                            fs::directory_iterator(root_ / "work" / "parts")->path().string()});
  EXPECT_EQ(added.exit_code, 0) << added.err;
  EXPECT_EQ(Info()["components"].size(), 2u);
}

TEST_F(BaseCliTest, PatchesReachAVehicleThatDrives) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  fs::copy(root_ / "work" / "town.base", root_ / "work" / "old.base", fs::copy_options::recursive);
  ASSERT_EQ(Run({"base", "add", "town.base", "../tuesday.cmap", "--patches", "patches"}).exit_code,
            0);
  const Result driven =
      Run({"drive", Drive(1), "--base", "old.base", "--patches", "patches", "--out", "parts"});
  ASSERT_EQ(driven.exit_code, 0) << driven.err;
  EXPECT_THAT(driven.out, HasSubstr("applied while it drove"));
  std::ofstream(root_ / "work" / "patches" / "broken.cmpatch") << "nonsense";
  const Result warned =
      Run({"drive", Drive(1), "--base", "old.base", "--patches", "patches", "--out", "again"});
  EXPECT_EQ(warned.exit_code, 3);
  EXPECT_THAT(warned.err, HasSubstr("broken.cmpatch"));
}

TEST_F(BaseCliTest, PartsThatNobodyTakesAwayAreBounded) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  const Result driven = Run({"drive", Drive(1), "--base", "town.base", "--out", "parts", "--every",
                             "1", "--out-limit", "0.01"});
  EXPECT_LE(driven.exit_code, 3);
  uintmax_t bytes = 0;
  for (const auto& file : fs::directory_iterator(root_ / "work" / "parts")) {
    bytes += file.file_size();
  }
  EXPECT_LE(bytes, 20'000u);
}

TEST_F(BaseCliTest, TellsWhatChangedInTheStreet) {
  ASSERT_EQ(Run({"base", "add", "town.base", "../monday.cmap"}).exit_code, 0);
  const Result told = Run({"base", "changes", "town.base", "--out", "c.geojson"});
  ASSERT_EQ(told.exit_code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr("nothing changed"));
  const auto json = nlohmann::json::parse(Read(root_ / "work" / "c.geojson"));
  EXPECT_EQ(json["type"], "FeatureCollection");
  ExpectRefused({"base", "changes", "town.base", "--since", "yesterday"}, "is no time");
  ExpectRefused({"drive", Drive(1), "--base", "../monday.cmap", "--out", "p"}, "folder of a base");
  ExpectRefused({"drive", Drive(1), "--base", "town.base", "--out", "town.base/parts"}, "lies in");
  ExpectRefused({"drive", Drive(1), "--base", "town.base", "--out", Drive(1)}, "lies in");
}

}  // namespace
}  // namespace carmap
