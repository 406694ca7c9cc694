#include "carmap/eval/localization_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace carmap {
namespace {

using ::testing::HasSubstr;

constexpr char kName[] = "reports/freeway-s32-620x188-map_none-to-lane-2-dense-low-sun.json";
constexpr char kReport[] = R"({"frames": 3, "map_bytes": 12345, "frames_detail": [
  {"index": 0, "known_by": "map", "dead_reckoned_m": 0, "position_error_m": 0.25,
   "rotation_error_deg": 0.5, "map_position_error_m": 0.125, "map_rotation_error_deg": 0.25,
   "squared_mahalanobis": 2.5, "sigma_m": 0.0625, "inliers": 99, "ms": 30.5},
  {"index": 1, "known_by": "dead_reckoning", "dead_reckoned_m": 1.5, "position_error_m": 0.5,
   "rotation_error_deg": 1, "map_position_error_m": 0.25, "ms": 20},
  {"index": 2, "known_by": "lost"}]})";

std::string Problem(const std::string& json, const std::string& name = kName) {
  const auto report = ParseLocalizationReport(json, name);
  EXPECT_FALSE(report.ok());
  EXPECT_EQ(report.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(report.status().message()), HasSubstr(name + ": "));
  return std::string(report.status().message());
}

TEST(LocalizationReport, IsReadWithItsConditions) {
  const auto report = ParseLocalizationReport(kReport, kName);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->cell, (LocalizationCell{.scene = "freeway",
                                            .width_px = 620,
                                            .height_px = 188,
                                            .map_traffic = "none",
                                            .lane = -2,
                                            .traffic = "dense",
                                            .light = "low-sun"}));
  EXPECT_EQ(report->seed, 32u);
  EXPECT_EQ(report->map_bytes, 12345);
  ASSERT_EQ(report->frames.size(), 3u);
  const ReportedFrame& first = report->frames[0];
  EXPECT_EQ(first.known_by, KnownBy::kMap);
  EXPECT_EQ(first.position_error_m, 0.25);
  EXPECT_EQ(first.rotation_error_deg, 0.5);
  EXPECT_EQ(first.map_position_error_m, 0.125);
  EXPECT_EQ(first.squared_mahalanobis, 2.5);
  EXPECT_EQ(first.sigma_m, 0.0625);
  EXPECT_EQ(first.ms, 30.5);
  EXPECT_EQ(report->frames[1].known_by, KnownBy::kDeadReckoning);
  EXPECT_EQ(report->frames[1].dead_reckoned_m, 1.5);
  EXPECT_TRUE(std::isnan(report->frames[1].sigma_m));
  EXPECT_EQ(report->frames[2].known_by, KnownBy::kLost);
}

TEST(LocalizationReport, TellsTheMethodByItsName) {
  const auto report = ParseLocalizationReport(
      kReport, "suburb-s1-1241x376-map_dense-to-lane0-none-sunny-by_appearance.json");
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->cell.method, "appearance");
  EXPECT_EQ(report->cell.light, "sunny");
}

TEST(LocalizationReport, OfAnotherNameIsRefused) {
  for (const char* name : {"report.json", "suburb-s1-1241x376-map_none-to-lane0-none-night.json",
                           "suburb-s1-1241x376-map_none-to-lane0-none-sunny",
                           "suburb-s99999999999999-1241x376-map_none-to-lane0-none-sunny.json"}) {
    EXPECT_THAT(Problem(kReport, name), HasSubstr("does not tell the conditions"));
  }
  EXPECT_THAT(Problem(kReport, std::string(100'000, 'a')), HasSubstr("conditions"));
}

TEST(LocalizationReport, OfHostileBytesIsRefused) {
  for (const char* json : {"", "[", "[]", "3", "{}", R"({"frames_detail": 3})",
                           R"({"frames_detail": []})", "\xff\xfe", R"({"frames_detail": {}})"}) {
    Problem(json);
  }
  for (const char* frame :
       {"3", "null", "[]", "{}", R"({"known_by": 3})", R"({"known_by": "guess"})",
        R"({"known_by": "map"})",
        R"({"known_by": "map", "position_error_m": "a", "rotation_error_deg": 1,
            "map_position_error_m": 1})",
        R"({"known_by": "dead_reckoning", "position_error_m": 1, "rotation_error_deg": 1,
            "map_position_error_m": 1})"}) {
    EXPECT_THAT(Problem(R"({"frames_detail": [)" + std::string(frame) + "]}"),
                HasSubstr("its frame 0 "));
  }
  const std::string whole = kReport;
  for (size_t length = 0; length < whole.size(); ++length) Problem(whole.substr(0, length));
}

}  // namespace
}  // namespace carmap
