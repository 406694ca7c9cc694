#include "carmap/eval/localization_score.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "carmap/eval/localization_picture.h"
#include "carmap/eval/localization_table.h"

namespace carmap {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

ReportedFrame ByMap(double error_m, double map_error_m = 0.01, double squared_mahalanobis = 1) {
  return {.known_by = KnownBy::kMap,
          .position_error_m = error_m,
          .rotation_error_deg = 0.1,
          .map_position_error_m = map_error_m,
          .squared_mahalanobis = squared_mahalanobis,
          .sigma_m = 0.02,
          .ms = 30};
}

ReportedFrame ByDeadReckoning(double error_m, double dead_reckoned_m) {
  ReportedFrame frame = ByMap(error_m);
  frame.known_by = KnownBy::kDeadReckoning;
  frame.dead_reckoned_m = dead_reckoned_m;
  frame.sigma_m = 0.2;
  return frame;
}

/// Ten lost frames, then these.
LocalizationReport DriveWith(const std::vector<ReportedFrame>& frames,
                             const std::string& scene = "suburb", const std::string& method = "",
                             uint64_t seed = 31) {
  LocalizationReport drive{.cell = {.scene = scene,
                                    .width_px = 1241,
                                    .height_px = 376,
                                    .map_traffic = "none",
                                    .lane = 1,
                                    .traffic = "dense",
                                    .light = "low-sun",
                                    .method = method},
                           .seed = seed};
  drive.frames.resize(10);
  drive.frames.insert(drive.frames.end(), frames.begin(), frames.end());
  return drive;
}

TEST(ScoreLocalization, CountsWhatIsKnown) {
  ReportedFrame turned = ByMap(0.1);
  turned.rotation_error_deg = 1.1;
  const std::vector<LocalizationReport> drives = {
      DriveWith({ByMap(0.1), ByMap(0.2), ByMap(0.6), turned, ByDeadReckoning(0.3, 20),
                 ByDeadReckoning(0.1, 20.5), ReportedFrame(), ByMap(0.4, 0.03, 8)})};
  const LocalizationScore score = ScoreLocalization(drives, DrivePart::kAfterIt);
  EXPECT_EQ(score.frames, 8u);
  EXPECT_EQ(score[kWellKnown].value, 4.0 / 8);
  EXPECT_EQ(score[kByMap].value, 5.0 / 8);
  EXPECT_EQ(score[kMedianErrorM].value, 0.2) << "nearest rank of 0.1 0.1 0.2 0.3 0.4 0.6";
  EXPECT_EQ(score[kMapCoverage].value, 4.0 / 5);
  EXPECT_EQ(score[kDeadReckoningCoverage].value, 1);
  EXPECT_EQ(score[kMapSigmaM].value, 0.02);
  EXPECT_EQ(score[kDeadReckoningSigmaM].value, 0.2);
  EXPECT_EQ(score.wrong_poses, 0u);
  EXPECT_EQ(score.median_ms, 30);
}

TEST(ScoreLocalization, KeepsTheFirstSecondApart) {
  LocalizationReport drive = DriveWith(std::vector<ReportedFrame>(30, ByMap(0.1)));
  const LocalizationScore first = ScoreLocalization({drive}, DrivePart::kFirstSecond),
                          after = ScoreLocalization({drive}, DrivePart::kAfterIt);
  EXPECT_EQ(first.frames, 10u);
  EXPECT_EQ(first[kWellKnown].value, 0);
  EXPECT_TRUE(std::isnan(first[kMedianErrorM].value));
  EXPECT_EQ(after.frames, 30u);
  EXPECT_EQ(after[kWellKnown].value, 1);
  // A drive shorter than a second has nothing after it.
  drive.frames.resize(4);
  EXPECT_EQ(ScoreLocalization({drive}, DrivePart::kFirstSecond).frames, 4u);
  EXPECT_EQ(ScoreLocalization({drive}, DrivePart::kAfterIt).frames, 0u);
}

TEST(ScoreLocalization, FindsWrongPoses) {
  const auto wrong_poses = [](const std::vector<ReportedFrame>& frames) {
    return ScoreLocalization({DriveWith(frames)}, DrivePart::kAfterIt).wrong_poses;
  };
  const ReportedFrame good = ByMap(0.1);
  EXPECT_EQ(wrong_poses({good, ByMap(2.1), good}), 1u);
  EXPECT_EQ(wrong_poses({good, ByMap(1.1), good}), 1u);
  EXPECT_EQ(wrong_poses({good, ByMap(1.1), ByMap(1.2), good}), 0u);
  EXPECT_EQ(wrong_poses({good, ByDeadReckoning(2.1, 5), good}), 0u) << "says that it drifts";
}

TEST(ScoreLocalization, TakesIntervalsFromSecondsNotFrames) {
  std::vector<ReportedFrame> alternating, in_seconds;
  for (int i = 0; i < 200; ++i) {
    alternating.push_back(i % 2 ? ByMap(0.1) : ReportedFrame());
    in_seconds.push_back(i / 10 % 2 ? ByMap(0.1) : ReportedFrame());
  }
  const Estimate even =
      ScoreLocalization({DriveWith(alternating)}, DrivePart::kAfterIt)[kWellKnown];
  EXPECT_EQ(even.value, 0.5);
  EXPECT_EQ(even.low, 0.5) << "each second is the same";
  const Estimate uneven =
      ScoreLocalization({DriveWith(in_seconds)}, DrivePart::kAfterIt)[kWellKnown];
  EXPECT_EQ(uneven.value, 0.5);
  // Of 20 seconds half are known: a binomial's standard deviation is 0.11.
  EXPECT_NEAR(uneven.low, 0.5 - 1.96 * 0.112, 0.06);
  EXPECT_NEAR(uneven.high, 0.5 + 1.96 * 0.112, 0.06);
}

TEST(LocalizationTable, PoolsSeedsAndComparesMethods) {
  const std::vector<LocalizationReport> reports = {
      DriveWith(std::vector<ReportedFrame>(20, ByMap(0.1)), "suburb", "", 31),
      DriveWith(std::vector<ReportedFrame>(20, ByMap(0.9)), "suburb", "", 32),
      DriveWith(std::vector<ReportedFrame>(20, ByMap(0.2)), "downtown"),
      DriveWith(std::vector<ReportedFrame>(20), "suburb", "appearance")};
  const auto groups = ScoreGroups(reports);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].cells.size(), 2u);
  EXPECT_EQ(groups[0].all.frames, 60u);
  EXPECT_EQ(WorstCell(groups[0], kWellKnown)->cell.scene, "suburb");
  EXPECT_EQ(WorstCell(groups[1], kMedianErrorM), nullptr);
  const std::string text = ToMarkdown(groups);
  EXPECT_THAT(text,
              AllOf(HasSubstr("| suburb, map none, drive dense, lane 1, low-sun | 2 | 40 | 50.0 ("),
                    HasSubstr("| appearance: well known % |"), Not(HasSubstr("nan"))));
  const auto json = ToJson(groups);
  EXPECT_EQ(json[0]["cells"][1]["well_known"]["value"], 0.5);
  EXPECT_EQ(json[0]["cells"][1]["first_second"]["frames"], 20);
  EXPECT_TRUE(json[1]["cells"][0]["median_error_m"].is_null());
  const cv::Mat errors = RenderErrorDistributions("errors", reports),
                bars = RenderCellBars("cells", groups);
  EXPECT_GT(errors.rows, 100);
  EXPECT_GT(bars.rows, 100);
}

}  // namespace
}  // namespace carmap
