// Drives that cannot be right, made out of a real one like those that users met: each must be
// named, and no result that rests on it called right.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "apps/carmap/program_runner.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kFrames = 31;

struct Pair {
  cv::Mat left, right;
};
/// The pair that the faulty drive has, from the sound drive's pairs; the frame's number.
using Fault = std::function<Pair(const std::vector<Pair>&, size_t)>;

class SuspectDrive : public testing::Test {
 protected:
  void SetUp() override {
    const char* data = std::getenv("CARMAP_DATA");
    real_ = fs::absolute(fs::path(data ? data : CARMAP_DATA_DIR) / "kitti06_000-050");
    if (!fs::exists(real_)) GTEST_SKIP() << "no real drive at " << real_;
    fs::remove_all(root_);
    fs::create_directories(root_);
    for (int i = 0; i < kFrames; ++i) {
      pairs_.push_back({Read("image_0", i), Read("image_1", i)});
      ASSERT_FALSE(pairs_.back().left.empty());
    }
  }
  void TearDown() override { fs::remove_all(root_); }

  cv::Mat Read(const char* side, int frame) const {
    return cv::imread((real_ / side / fmt::format("{:06}.png", frame)).string(),
                      cv::IMREAD_GRAYSCALE);
  }

  /// Writes the folder drive/.
  void Make(const Fault& fault) {
    const fs::path drive = root_ / "drive";
    for (const char* side : {"image_0", "image_1"}) fs::create_directories(drive / side);
    for (size_t i = 0; i < pairs_.size(); ++i) {
      const Pair pair = fault(pairs_, i);
      const std::string name = fmt::format("{:06}.pgm", i);
      cv::imwrite((drive / "image_0" / name).string(), pair.left);
      cv::imwrite((drive / "image_1" / name).string(), pair.right);
    }
    fs::copy(real_ / "calib.txt", drive);
    for (const char* name : {"times.txt", "poses.txt"}) {
      std::ifstream lines(real_ / name);
      std::ofstream copied(drive / name);
      std::string line;
      for (int i = 0; i < kFrames && std::getline(lines, line); ++i) copied << line << "\n";
    }
  }

  Result Run(const std::vector<std::string>& arguments) {
    return RunProgram(root_, arguments, root_);
  }
  Result Map() { return Run({"map", "drive", "--out", "m.cmap", "--report", "r.json"}); }
  nlohmann::json Report() const { return nlohmann::json::parse(std::ifstream(root_ / "r.json")); }

  /// `check` names the fault, and `map` too, whether it can make a map or not.
  void ExpectNamed(const Fault& fault, const std::string& name, const std::string& finding) {
    Make(fault);
    const Result check = Run({"check", "drive"});
    EXPECT_EQ(check.exit_code, 3) << check.out;
    EXPECT_THAT(check.err, AllOf(HasSubstr("suspect, " + name), HasSubstr(finding)));
    const Result map = Map();
    EXPECT_NE(map.exit_code, 0);
    EXPECT_THAT(map.err, HasSubstr(finding));
  }

  const fs::path root_ = fs::path(testing::TempDir()) / "carmap_suspect_drive_test";
  fs::path real_;
  std::vector<Pair> pairs_;
};

cv::Mat Moved(const cv::Mat& image, const cv::Matx23d& to_from) {
  cv::Mat moved;
  cv::warpAffine(image, moved, to_from, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
  return moved;
}

cv::Mat Turned(const cv::Mat& image, double degrees) {
  const cv::Point2f middle(static_cast<float>(image.cols) / 2, static_cast<float>(image.rows) / 2);
  return Moved(image, cv::Mat1d(cv::getRotationMatrix2D(middle, degrees, 1)));
}

TEST_F(SuspectDrive, OfSoundImagesIsNone) {
  Make([](const std::vector<Pair>& pairs, size_t i) { return pairs[i]; });
  const Result check = Run({"check", "drive", "--json"});
  EXPECT_EQ(check.exit_code, 0) << check.err;
  const auto json = nlohmann::json::parse(check.out);
  EXPECT_THAT(json["suspect"], IsEmpty());
  EXPECT_EQ(json["sampled_pairs"], kFrames);
  EXPECT_LT(json.at("wall_s").get<double>(), 10);
  ASSERT_EQ(Map().exit_code, 0);
  const auto health = Report()["health"];
  EXPECT_THAT(health["suspect"], IsEmpty());
  EXPECT_GT(health.at("depth_share").get<double>(), 0.5);
  EXPECT_LT(health.at("motion").at("max_acceleration_mps2").get<double>(), 3);
}

TEST_F(SuspectDrive, WithSidesSwapped) {
  ExpectNamed(
      [](const auto& pairs, size_t i) {
        return Pair{pairs[i].right, pairs[i].left};
      },
      "sides swapped", "left and right images are exchanged");
}

TEST_F(SuspectDrive, WithTheLeftImageTwice) {
  ExpectNamed(
      [](const auto& pairs, size_t i) {
        return Pair{pairs[i].left, pairs[i].left};
      },
      "one camera", "left and right images are the same");
}

TEST_F(SuspectDrive, UpsideDown) {
  ExpectNamed(
      [](const auto& pairs, size_t i) {
        Pair pair;
        cv::flip(pairs[i].left, pair.left, -1);
        cv::flip(pairs[i].right, pair.right, -1);
        return pair;
      },
      "upside down", "stand on their heads");
}

TEST_F(SuspectDrive, WithRightImagesFarTooLow) {
  ExpectNamed(
      [](const auto& pairs, size_t i) {
        return Pair{pairs[i].left, Moved(pairs[i].right, {1, 0, 0, 0, 1, 10})};
      },
      "misaligned", "px lower in the middle");
}

TEST_F(SuspectDrive, BentByTheLens) {
  const cv::Size size = pairs_[0].left.size();
  cv::Mat from_x(size, CV_32F), from_y(size, CV_32F);
  for (int y = 0; y < from_x.rows; ++y) {
    for (int x = 0; x < from_x.cols; ++x) {
      constexpr double kF = 707.0912, kCx = 601.8873, kCy = 183.1104, kDistortion = -0.3;
      const cv::Vec2d bent((x - kCx) / kF, (y - kCy) / kF);
      cv::Vec2d straight = bent;
      for (int i = 0; i < 8; ++i) straight = bent / (1 + kDistortion * straight.dot(straight));
      from_x.at<float>(y, x) = static_cast<float>(kCx + kF * straight[0]);
      from_y.at<float>(y, x) = static_cast<float>(kCy + kF * straight[1]);
    }
  }
  ExpectNamed(
      [&](const auto& pairs, size_t i) {
        Pair pair;
        cv::remap(pairs[i].left, pair.left, from_x, from_y, cv::INTER_LINEAR, cv::BORDER_REFLECT);
        cv::remap(pairs[i].right, pair.right, from_x, from_y, cv::INTER_LINEAR, cv::BORDER_REFLECT);
        return pair;
      },
      "not rectified", "bent by the lens");
}

/// A lost image: from then on all pairs are of two moments. Its map must not reach a base unawares.
TEST_F(SuspectDrive, WithARightImageLost) {
  constexpr size_t kLost = 12;
  ExpectNamed(
      [](const auto& pairs, size_t i) {
        return Pair{pairs[i].left, pairs[std::min(i < kLost ? i : i + 1, pairs.size() - 1)].right};
      },
      "unsynchronised", "not of the same moment");
  EXPECT_THAT(Run({"check", "drive"}).err,
              HasSubstr(fmt::format("frames {} to {}: ", kLost, kFrames - 2)));
  const auto suspicion = Report().at("health").at("suspect").at(0);
  EXPECT_EQ(suspicion["fault"], "unsynchronised");
  EXPECT_EQ(suspicion.at("first_index"), 20);  // of every tenth pair
  const auto map = ReadLeanMap(root_ / "m.cmap");
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(NamesOf(map->drives[0].faults), "unsynchronised");
  EXPECT_THAT(Run({"info", "m.cmap"}).out, HasSubstr("; suspect: unsynchronised"));

  ASSERT_EQ(RunProgram(root_, {"map", real_.string(), "--last", "30", "--out", "good.cmap"}, root_)
                .exit_code,
            0);
  const std::vector<std::string> stitch = {"stitch", "good.cmap", "m.cmap", "--out", "both.cmap"};
  const Result refused = Run(stitch);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.err, AllOf(HasSubstr("m.cmap: its drive"), HasSubstr("unsynchronised"),
                                 HasSubstr("--accept-suspect")));
  EXPECT_FALSE(fs::exists(root_ / "both.cmap"));
  std::vector<std::string> accepting = stitch;
  accepting.push_back("--accept-suspect");
  EXPECT_THAT(Run(accepting).err, ::testing::Not(HasSubstr("suspect")));
}

TEST_F(SuspectDrive, WithABaselineInMetres) {
  Make([](const std::vector<Pair>& pairs, size_t i) { return pairs[i]; });
  std::ifstream lines(real_ / "calib.txt");
  std::ofstream calibration(root_ / "drive" / "calib.txt");
  for (std::string line; std::getline(lines, line);) {
    const bool is_right = line.rfind("P1:", 0) == 0;
    calibration << (is_right ? "P1: 707.0912 0 601.8873 -0.5372 0 707.0912 183.1104 0 0 0 1 0"
                             : line)
                << "\n";
  }
  calibration.close();
  EXPECT_THAT(Run({"check", "drive"}).err, HasSubstr("implausible rig: the baseline is 0.00076 m"));
  const Result map = Map();
  EXPECT_NE(map.exit_code, 0);
  EXPECT_THAT(map.err, HasSubstr("the fourth number of P1"));
}

TEST_F(SuspectDrive, OfWhichImagesCannotBeReadIsNotCalledSound) {
  Make([](const std::vector<Pair>& pairs, size_t i) { return pairs[i]; });
  for (const char* name : {"000004.pgm", "000005.pgm"}) {
    fs::resize_file(root_ / "drive" / "image_1" / name, 100);
  }
  const Result check = Run({"check", "drive"});
  EXPECT_EQ(check.exit_code, 3);
  EXPECT_THAT(check.err, HasSubstr("2 of 31 sampled pairs cannot be read"));
}

struct Bearable {
  const char* name;
  Fault fault;
};

/// What is wrong but can be undone gives a map as good as that of the sound drive.
TEST_F(SuspectDrive, IsMappedRightWhereTheFaultCanBeUndone) {
  const std::vector<Bearable> cases = {
      {"half a degree",
       [](const auto& pairs, size_t i) {
         return Pair{pairs[i].left, Turned(pairs[i].right, 0.5)};
       }},
      {"4 px lower",
       [](const auto& pairs, size_t i) {
         return Pair{pairs[i].left, Moved(pairs[i].right, {1, 0, 0, 0, 1, 4})};
       }},
      {"40 % as bright",
       [](const auto& pairs, size_t i) {
         return Pair{pairs[i].left, cv::Mat(pairs[i].right * 0.4)};
       }},
      {"160 % as bright",
       [](const auto& pairs, size_t i) {
         return Pair{pairs[i].left, cv::Mat(pairs[i].right * 1.6)};
       }},
  };
  for (const Bearable& bearable : cases) {
    SCOPED_TRACE(bearable.name);
    fs::remove_all(root_ / "drive");
    Make(bearable.fault);
    const Result map = Map();
    EXPECT_EQ(map.exit_code, 0) << map.err;
    EXPECT_LT(Report().at("ate_rmse_m").get<double>(), 0.10);
    EXPECT_EQ(Report()["tracked_frames"], kFrames);
  }
}

}  // namespace
}  // namespace carmap
