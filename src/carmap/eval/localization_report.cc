#include "carmap/eval/localization_report.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>

#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

constexpr size_t kMaxNameLength = 255;  // of a file; a regular expression takes a stack for each

absl::Status Refuse(const std::string& name, const std::string& problem) {
  return absl::InvalidArgumentError(
      fmt::format("{}: {}; give a report that `carmap localize --map-truth` wrote", name, problem));
}

absl::StatusOr<LocalizationReport> ParseName(const std::string& name) {
  static const std::regex pattern(
      "([a-z]+)-s([0-9]{1,9})-([0-9]{1,5})x([0-9]{1,5})-map_([a-z]+)-to-lane(-?[0-9]{1,3})-([a-z]+)"
      "-(sunny|overcast|low-sun)(-by_([a-z_]+))?\\.json");
  const std::string file = std::filesystem::path(name).filename().string();
  std::smatch words;
  if (file.size() > kMaxNameLength || !std::regex_match(file, words, pattern)) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: its name does not tell the conditions; name reports "
        "SCENE-sSEED-WxH-map_TRAFFIC-to-laneN-TRAFFIC-LIGHT.json, as make evaluate-localization "
        "does",
        name));
  }
  LocalizationReport report;
  report.cell = {.scene = words[1],
                 .width_px = std::stoi(words[3]),
                 .height_px = std::stoi(words[4]),
                 .map_traffic = words[5],
                 .lane = std::stoi(words[6]),
                 .traffic = words[7],
                 .light = words[8],
                 .method = words[10]};
  report.seed = std::stoull(words[2]);
  return report;
}

/// NaN if it is absent or no number.
double NumberAt(const nlohmann::json& record, const char* key) {
  const auto found = record.find(key);
  return found != record.end() && found->is_number() ? found->get<double>() : ReportedFrame::kNone;
}

std::optional<KnownBy> KnownByOf(const nlohmann::json& record) {
  const auto found = record.find("known_by");
  if (found == record.end()) return std::nullopt;
  if (*found == "map") return KnownBy::kMap;
  if (*found == "dead_reckoning") return KnownBy::kDeadReckoning;
  if (*found == "lost") return KnownBy::kLost;
  return std::nullopt;
}

absl::StatusOr<ReportedFrame> ParseFrame(const nlohmann::json& record, size_t idx,
                                         const std::string& name) {
  const auto known_by = record.is_object() ? KnownByOf(record) : std::nullopt;
  if (!known_by) {
    return Refuse(name, fmt::format("its frame {} does not say by what it is known", idx));
  }
  ReportedFrame frame{.known_by = *known_by,
                      .position_error_m = NumberAt(record, "position_error_m"),
                      .rotation_error_deg = NumberAt(record, "rotation_error_deg"),
                      .map_position_error_m = NumberAt(record, "map_position_error_m"),
                      .squared_mahalanobis = NumberAt(record, "squared_mahalanobis"),
                      .sigma_m = NumberAt(record, "sigma_m"),
                      .ms = NumberAt(record, "ms")};
  if (frame.known_by == KnownBy::kLost) return frame;
  if (frame.known_by == KnownBy::kDeadReckoning) {
    frame.dead_reckoned_m = NumberAt(record, "dead_reckoned_m");
  }
  for (const double needed : {frame.position_error_m, frame.rotation_error_deg,
                              frame.map_position_error_m, frame.dead_reckoned_m}) {
    if (std::isnan(needed)) {
      return Refuse(name, fmt::format("its frame {} has a pose and no errors", idx));
    }
  }
  return frame;
}

}  // namespace

std::string ToText(const LocalizationCell& cell) {
  return fmt::format("{}, map {}, drive {}, lane {}, {}", cell.scene, cell.map_traffic,
                     cell.traffic, cell.lane, cell.light);
}

absl::StatusOr<LocalizationReport> ParseLocalizationReport(std::string_view json,
                                                           const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(LocalizationReport report, ParseName(name));
  const auto parsed = nlohmann::json::parse(json, nullptr, /*allow_exceptions=*/false);
  if (!parsed.is_object()) return Refuse(name, "is no JSON report");
  const auto records = parsed.find("frames_detail");
  if (records == parsed.end() || !records->is_array() || records->empty()) {
    return Refuse(name, "has no frames_detail");
  }
  for (const nlohmann::json& record : *records) {
    CARMAP_ASSIGN_OR_RETURN(const ReportedFrame frame,
                            ParseFrame(record, report.frames.size(), name));
    report.frames.push_back(frame);
  }
  if (const double bytes = NumberAt(parsed, "map_bytes"); !std::isnan(bytes)) {
    report.map_bytes = bytes;
  }
  return report;
}

}  // namespace carmap
