#include <fmt/format.h>

#include <CLI/App.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/evaluated_map.h"
#include "apps/carmap/outputs.h"
#include "carmap/base/status_macros.h"
#include "carmap/eval/street_change_score.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

struct Arguments {
  std::string before, after, truth, changed, fresh, fresh_truth, report;
  bool row = false;
};

/// A map in the world of a drive that it was made from.
struct TrueMap {
  LeanMap map;
  Rigid3 world_from_map;
};

absl::StatusOr<TrueMap> ReadTrueMap(const std::string& path, const std::string& truth,
                                    bool is_part_of_base) {
  TrueMap read;
  CARMAP_ASSIGN_OR_RETURN(read.map, ReadLeanMap(path));
  CARMAP_ASSIGN_OR_RETURN(const EvaluatedMap evaluated,
                          AlignToTruth(read.map, path, truth, is_part_of_base));
  read.world_from_map = evaluated.alignment.world_from_map;
  return read;
}

nlohmann::ordered_json ToJson(const StreetChangeScore& score) {
  nlohmann::ordered_json json = {{"removed_landmarks", score.removed_before()},
                                 {"removed_landmarks_left", score.removed_left()},
                                 {"standing_landmarks", score.standing},
                                 {"standing_landmarks_lost", score.standing_lost},
                                 {"things", nlohmann::ordered_json::array()}};
  for (const ThingScore& thing : score.things) {
    json["things"].push_back({{"name", thing.name},
                              {"change", thing.is_added ? "added" : "removed"},
                              {"before", thing.before},
                              {"after", thing.after},
                              {"fresh", thing.fresh}});
  }
  return json;
}

void Print(const StreetChangeScore& score) {
  for (const ThingScore& thing : score.things) {
    if (thing.is_added) {
      fmt::print("{:<32}added: {} landmarks of {} in a fresh map\n", thing.name, thing.after,
                 thing.fresh);
    } else {
      fmt::print("{:<32}removed: {} landmarks of {} left\n", thing.name, thing.after, thing.before);
    }
  }
  fmt::print("vanished      {} of {} landmarks of removed things left\n", score.removed_left(),
             score.removed_before());
  fmt::print(
      "standing      {} of {} landmarks lost ({:.2f} %)\n", score.standing_lost, score.standing,
      score.standing == 0
          ? 0
          : 100 * static_cast<double>(score.standing_lost) / static_cast<double>(score.standing));
}

/// The end of a row of a Markdown table.
void PrintRow(const StreetChangeScore& score) {
  constexpr size_t kFewest = 3;
  constexpr double kGoneShare = 0.1;
  size_t things = 0, gone = 0, added = 0, fresh = 0;
  for (const ThingScore& thing : score.things) {
    added += thing.is_added ? thing.after : 0;
    fresh += thing.is_added ? thing.fresh : 0;
    if (thing.is_added || thing.before < kFewest) continue;
    ++things;
    gone += static_cast<double>(thing.after) <= kGoneShare * static_cast<double>(thing.before);
  }
  fmt::print("| {} of {} | {} of {} | {} of {} | {} of {} |\n", score.removed_left(),
             score.removed_before(), gone, things, score.standing_lost, score.standing, added,
             fresh);
}

absl::StatusOr<ExitCode> RunForgetting(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report}, {arguments.before, arguments.after}));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<ChangedThing> things,
                          ReadChangedThings(arguments.changed));
  CARMAP_ASSIGN_OR_RETURN(const TrueMap before,
                          ReadTrueMap(arguments.before, arguments.truth, true));
  CARMAP_ASSIGN_OR_RETURN(const TrueMap after, ReadTrueMap(arguments.after, arguments.truth, true));
  std::optional<TrueMap> fresh;
  std::vector<PlacedMap> fresh_maps;
  if (!arguments.fresh.empty()) {
    CARMAP_ASSIGN_OR_RETURN(fresh, ReadTrueMap(arguments.fresh, arguments.fresh_truth, false));
    fresh_maps.push_back({fresh->map, fresh->world_from_map});
  }
  const StreetChangeScore score = ScoreStreetChanges(things, {before.map, before.world_from_map},
                                                     {after.map, after.world_from_map}, fresh_maps);
  arguments.row ? PrintRow(score) : Print(score);
  OutputFiles files;
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, ToJson(score)); });
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateForgetting(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "forgetting", "Count what a base forgot of a street that changed, and what it lost");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("BEFORE", arguments->before, "The base before (`carmap base export`)")
      ->required();
  command->add_option("AFTER", arguments->after, "The same base after drives of the changed street")
      ->required();
  command
      ->add_option("--truth", arguments->truth,
                   "Drive whose keyframes the base has, with poses.txt")
      ->required()
      ->type_name("DRIVE");
  command
      ->add_option("--changed", arguments->changed,
                   "A drive through the changed street: its world.json tells what was changed")
      ->required()
      ->type_name("DRIVE");
  CLI::Option* fresh =
      command->add_option("--fresh", arguments->fresh, "A map made in the changed street alone")
          ->type_name("MAP.cmap");
  command->add_option("--fresh-truth", arguments->fresh_truth, "The drive that it was made of")
      ->needs(fresh)
      ->type_name("DRIVE");
  fresh->needs("--fresh-truth");
  command->add_option("--report", arguments->report, "Write the counts as JSON")
      ->type_name("R.json");
  command->add_flag("--row", arguments->row,
                    "Print the end of a row of a Markdown table: landmarks of removed things left, "
                    "things gone, standing lost, on added things");
  command->footer(
      R"(A landmark is on a thing that was removed or added if it lies within half a metre of its box. All
others of BEFORE stand, and none of them should be lost. In a --row a thing of three landmarks and more is gone
when a tenth of them is left.

Exit codes: 0 done, 1 error, 2 wrong usage, 3 the report could not be written)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunForgetting(*arguments); }; });
}

}  // namespace carmap
