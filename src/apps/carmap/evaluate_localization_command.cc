#include <fmt/format.h>

#include <CLI/App.hpp>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/localization_picture.h"
#include "carmap/eval/localization_report.h"
#include "carmap/eval/localization_score.h"
#include "carmap/eval/localization_table.h"

namespace carmap {
namespace {

constexpr uint64_t kMaxReportBytes = 1 << 28;

struct Arguments {
  std::vector<std::string> reports;
  std::string out;
  bool json = false;
};

absl::StatusOr<std::vector<LocalizationReport>> ReadReports(const std::vector<std::string>& paths) {
  std::vector<LocalizationReport> reports;
  for (const std::string& path : paths) {
    CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxReportBytes));
    CARMAP_ASSIGN_OR_RETURN(LocalizationReport report, ParseLocalizationReport(bytes, path));
    reports.push_back(std::move(report));
  }
  return reports;
}

std::string SizeText(int width_px, int height_px) {
  return fmt::format("{}x{}", width_px, height_px);
}

/// Two pictures for each size of image, by their paths.
std::map<std::string, cv::Mat> Draw(const std::filesystem::path& folder,
                                    const std::vector<LocalizationReport>& reports,
                                    const std::vector<ScoredGroup>& groups) {
  std::map<std::string, std::vector<LocalizationReport>> reports_of;
  std::map<std::string, std::vector<ScoredGroup>> groups_of;
  for (const LocalizationReport& report : reports) {
    reports_of[SizeText(report.cell.width_px, report.cell.height_px)].push_back(report);
  }
  for (const ScoredGroup& group : groups) {
    groups_of[SizeText(group.width_px, group.height_px)].push_back(group);
  }
  std::map<std::string, cv::Mat> pictures;
  for (const auto& [size, of_size] : reports_of) {
    pictures[folder / fmt::format("errors_{}.png", size)] =
        RenderErrorDistributions("Share of frames within an error, " + size, of_size);
    pictures[folder / fmt::format("cells_{}.png", size)] =
        RenderCellBars("Localization by conditions, " + size, groups_of[size]);
  }
  return pictures;
}

absl::Status WritePictures(const Arguments& arguments,
                           const std::vector<LocalizationReport>& reports,
                           const std::vector<ScoredGroup>& groups, OutputFiles& files) {
  const auto pictures = Draw(arguments.out, reports, groups);
  std::vector<std::string> paths;
  for (const auto& picture : pictures) paths.push_back(picture.first);
  CARMAP_RETURN_IF_ERROR(CheckOutputs(paths, arguments.reports));
  for (const auto& picture : pictures) {
    files.Write(picture.first, [&] { return WritePng(picture.first, picture.second); });
  }
  return absl::OkStatus();
}

absl::StatusOr<ExitCode> EvaluateLocalization(const Arguments& arguments) {
  if (!arguments.out.empty() && !std::filesystem::is_directory(arguments.out)) {
    return absl::NotFoundError(
        fmt::format("{}: is no folder; make it, or name another", arguments.out));
  }
  CARMAP_ASSIGN_OR_RETURN(const auto reports, ReadReports(arguments.reports));
  const std::vector<ScoredGroup> groups = ScoreGroups(reports);
  OutputFiles files;
  if (!arguments.out.empty()) {
    CARMAP_RETURN_IF_ERROR(WritePictures(arguments, reports, groups, files));
  }
  fmt::print("{}", arguments.json ? JsonText(ToJson(groups)) : ToMarkdown(groups));
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateLocalization(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "localization", "How well drives are localized, by traffic, lane and light");
  const auto arguments = std::make_shared<Arguments>();
  command
      ->add_option("REPORT", arguments->reports,
                   "Reports of carmap localize --map-truth, whose names tell the conditions")
      ->required();
  command->add_flag("--json", arguments->json, "Print JSON");
  command
      ->add_option("--out", arguments->out,
                   "Draw error distributions and the cells' figures into this folder")
      ->type_name("FOLDER");
  command->footer(fmt::format(
      R"(Reports are named SCENE-sSEED-WxH-map_TRAFFIC-to-laneN-TRAFFIC-LIGHT.json; -by_METHOD before .json names
another way of matching, to compare. Those that differ only in the seed are one cell, and pooled.
The first second of each drive is apart.

  well known        share of the frames that the map tells, or dead reckoning over {:.0f} m at most,
                    within {:g} m and {:g} degree of the truth
  by map            share that the map tells
  error             of these frames' positions against the truth, once and rigidly aligned with the map
  against the map   against the truth as the map's own keyframes near by have it: without the map's
                    scale and drift
  95 % bound        share of the positions whose error, by the covariance stated, is within what 95 %
                    must be within
  wrong             frames told by the map that are more than 2 m off, or 1 m between good ones

In brackets are intervals of 95 %, by resampling seconds of the drives.

Example:
  carmap evaluate localization build/evaluate_localization/reports/*.json --out build

Exit codes: 0 evaluated, whatever the result, 1 error, 2 wrong usage, 3 evaluated but not all
pictures could be written)",
      kMaxDeadReckonedM, kMaxPositionErrorM, kMaxRotationErrorDeg));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateLocalization(*arguments); }; });
}

}  // namespace carmap
