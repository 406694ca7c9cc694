#include "carmap/eval/localization_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

namespace carmap {
namespace {

constexpr std::array<const char*, kLocalizationFigureCount> kKeys = {
    "well_known",         "by_map",
    "median_error_m",     "p95_error_m",
    "median_map_error_m", "p95_map_error_m",
    "map_coverage",       "dead_reckoning_coverage",
    "map_sigma_m",        "dead_reckoning_sigma_m"};

std::string Percent(double share) {
  return std::isnan(share) ? "–" : fmt::format("{:.1f}", 100 * share);
}

std::string Metres(double metres) {
  return std::isnan(metres) ? "–" : fmt::format("{:.3f}", metres);
}

std::string PercentWithInterval(const Estimate& share) {
  if (std::isnan(share.value)) return "–";
  return fmt::format("{} ({}–{})", Percent(share.value), Percent(share.low), Percent(share.high));
}

std::string MetresWithInterval(const Estimate& error) {
  if (std::isnan(error.value)) return "–";
  return fmt::format("{} ({}–{})", Metres(error.value), Metres(error.low), Metres(error.high));
}

std::string Row(const std::vector<std::string>& columns) {
  return fmt::format("| {} |\n", fmt::join(columns, " | "));
}

std::string Header(const std::vector<std::string>& columns) {
  std::string line = Row(columns) + "|";
  for (size_t i = 0; i < columns.size(); ++i) line += "---|";
  return line + "\n";
}

std::string NameOf(const ScoredGroup& group) {
  const std::string method = group.method.empty() ? "" : ", by " + group.method;
  return fmt::format("{}x{}{}", group.width_px, group.height_px, method);
}

std::vector<std::string> ColumnsOf(const std::string& name, const LocalizationScore& score) {
  return {name,
          fmt::format("{}", score.drives),
          fmt::format("{}", score.frames),
          PercentWithInterval(score[kWellKnown]),
          PercentWithInterval(score[kByMap]),
          Metres(score[kMedianErrorM].value),
          Metres(score[kP95ErrorM].value),
          MetresWithInterval(score[kMedianMapErrorM]),
          Metres(score[kP95MapErrorM].value),
          PercentWithInterval(score[kMapCoverage]),
          PercentWithInterval(score[kDeadReckoningCoverage]),
          Metres(score[kMapSigmaM].value),
          Metres(score[kDeadReckoningSigmaM].value),
          fmt::format("{}", score.wrong_poses),
          std::isnan(score.median_ms) ? "–" : fmt::format("{:.0f}", score.median_ms),
          std::isnan(score.p99_ms) ? "–" : fmt::format("{:.0f}", score.p99_ms)};
}

std::string CellTable(const ScoredGroup& group, const std::string& title,
                      LocalizationScore ScoredCell::*score) {
  std::string table =
      Header({title, "drives", "frames", "well known %", "by map %", "error m", "p95",
              "against the map m", "p95", "95 % bound, map", "dead reckoning", "sigma m, map",
              "dead reckoning", "wrong", "ms", "p99"});
  for (const ScoredCell& cell : group.cells) {
    table += Row(ColumnsOf(ToText(cell.cell), cell.*score));
  }
  return table;
}

std::string TotalsTable(const ScoredGroup& group) {
  const auto worst = [&](LocalizationFigure figure, auto&& to_text) -> std::string {
    const ScoredCell* cell = WorstCell(group, figure);
    return cell == nullptr
               ? "–"
               : fmt::format("{} ({})", to_text(cell->score[figure]), ToText(cell->cell));
  };
  std::string table = Header({NameOf(group), "all cells", "worst cell"});
  table += Row({"well known %", PercentWithInterval(group.all[kWellKnown]),
                worst(kWellKnown, PercentWithInterval)});
  table +=
      Row({"by map %", PercentWithInterval(group.all[kByMap]), worst(kByMap, PercentWithInterval)});
  table += Row({"error m, median", MetresWithInterval(group.all[kMedianErrorM]),
                worst(kMedianErrorM, MetresWithInterval)});
  table += Row({"against the map's trajectory", MetresWithInterval(group.all[kMedianMapErrorM]),
                worst(kMedianMapErrorM, MetresWithInterval)});
  table += Row({"95 % bound, map", PercentWithInterval(group.all[kMapCoverage]),
                worst(kMapCoverage, PercentWithInterval)});
  table +=
      Row({"95 % bound, dead reckoning", PercentWithInterval(group.all[kDeadReckoningCoverage]),
           worst(kDeadReckoningCoverage, PercentWithInterval)});
  table += Row(
      {"wrong poses", fmt::format("{} of {} frames", group.all.wrong_poses, group.all.frames), ""});
  return table;
}

/// One row a cell that several methods tried, three columns a method.
std::string ComparisonTable(const std::vector<const ScoredGroup*>& groups) {
  std::vector<std::string> columns = {
      fmt::format("{}x{}", groups.front()->width_px, groups.front()->height_px)};
  std::map<std::string, std::map<std::string, const ScoredCell*>> cells;
  for (const ScoredGroup* group : groups) {
    const std::string method = group->method.empty() ? "CarMap" : group->method;
    columns.push_back(method + ": well known %");
    columns.push_back("error m");
    columns.push_back("map kB");
    for (const ScoredCell& cell : group->cells) cells[ToText(cell.cell)][group->method] = &cell;
  }
  std::string table = Header(columns);
  for (const auto& [name, of_method] : cells) {
    if (of_method.size() < 2) continue;
    std::vector<std::string> row = {name};
    for (const ScoredGroup* group : groups) {
      const auto cell = of_method.find(group->method);
      if (cell == of_method.end()) {
        row.insert(row.end(), {"–", "–", "–"});
        continue;
      }
      const LocalizationScore& score = cell->second->score;
      row.push_back(PercentWithInterval(score[kWellKnown]));
      row.push_back(Metres(score[kMedianErrorM].value));
      row.push_back(score.map_bytes ? fmt::format("{:.0f}", *score.map_bytes * 1e-3) : "–");
    }
    table += Row(row);
  }
  return table;
}

std::string ComparisonTables(const std::vector<ScoredGroup>& groups) {
  std::map<std::pair<int, int>, std::vector<const ScoredGroup*>> of_size;
  for (const ScoredGroup& group : groups) {
    of_size[{group.width_px, group.height_px}].push_back(&group);
  }
  std::string tables;
  for (const auto& [size, same] : of_size) {
    if (same.size() > 1) tables.append("\n").append(ComparisonTable(same));
  }
  return tables;
}

nlohmann::ordered_json NumberOrNull(double number) {
  return std::isfinite(number) ? nlohmann::ordered_json(number) : nullptr;
}

nlohmann::ordered_json ScoreJson(const LocalizationScore& score) {
  nlohmann::ordered_json json = {{"drives", score.drives}, {"frames", score.frames}};
  for (size_t i = 0; i < kLocalizationFigureCount; ++i) {
    const Estimate& estimate = score.figures[i];
    if (std::isnan(estimate.value)) {
      json[kKeys[i]] = nullptr;
    } else {
      json[kKeys[i]] = {{"value", estimate.value}, {"low", estimate.low}, {"high", estimate.high}};
    }
  }
  json["wrong_poses"] = score.wrong_poses;
  json["frame_ms"] = {{"median", NumberOrNull(score.median_ms)},
                      {"p99", NumberOrNull(score.p99_ms)}};
  json["map_bytes"] =
      score.map_bytes ? nlohmann::ordered_json(*score.map_bytes) : nlohmann::ordered_json();
  return json;
}

nlohmann::ordered_json CellJson(const ScoredCell& scored) {
  const LocalizationCell& cell = scored.cell;
  nlohmann::ordered_json json = {{"scene", cell.scene},
                                 {"map_traffic", cell.map_traffic},
                                 {"lane", cell.lane},
                                 {"traffic", cell.traffic},
                                 {"light", cell.light}};
  json.update(ScoreJson(scored.score));
  json["first_second"] = ScoreJson(scored.first_second);
  return json;
}

}  // namespace

std::vector<ScoredGroup> ScoreGroups(const std::vector<LocalizationReport>& reports) {
  using Key = std::tuple<int, int, std::string>;
  std::map<Key, std::vector<LocalizationReport>> grouped;
  for (const LocalizationReport& report : reports) {
    grouped[{report.cell.width_px, report.cell.height_px, report.cell.method}].push_back(report);
  }
  std::vector<ScoredGroup> groups;
  for (const auto& [key, same] : grouped) {
    groups.push_back({std::get<0>(key), std::get<1>(key), std::get<2>(key), ScoreCells(same),
                      ScoreLocalization(same, DrivePart::kAfterIt)});
  }
  return groups;
}

const ScoredCell* WorstCell(const ScoredGroup& group, LocalizationFigure figure) {
  const bool lower_is_worse = figure == kWellKnown || figure == kByMap || figure == kMapCoverage ||
                              figure == kDeadReckoningCoverage;
  const ScoredCell* worst = nullptr;
  for (const ScoredCell& cell : group.cells) {
    const double value = cell.score[figure].value;
    if (std::isnan(value)) continue;
    const bool is_worse = worst == nullptr || (lower_is_worse ? value < worst->score[figure].value
                                                              : value > worst->score[figure].value);
    if (is_worse) worst = &cell;
  }
  return worst;
}

std::string ToMarkdown(const std::vector<ScoredGroup>& groups) {
  std::string text;
  for (const ScoredGroup& group : groups) {
    if (!text.empty()) text += "\n";
    text += CellTable(group, NameOf(group), &ScoredCell::score) + "\n" + TotalsTable(group) + "\n" +
            CellTable(group, NameOf(group) + ", first second", &ScoredCell::first_second);
  }
  return text + ComparisonTables(groups);
}

nlohmann::ordered_json ToJson(const std::vector<ScoredGroup>& groups) {
  auto json = nlohmann::ordered_json::array();
  for (const ScoredGroup& group : groups) {
    nlohmann::ordered_json& record = json.emplace_back();
    record["size"] = {group.width_px, group.height_px};
    record["method"] = group.method;
    record["all"] = ScoreJson(group.all);
    record["cells"] = nlohmann::ordered_json::array();
    for (const ScoredCell& cell : group.cells) record["cells"].push_back(CellJson(cell));
  }
  return json;
}

}  // namespace carmap
