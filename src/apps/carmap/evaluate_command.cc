#include <fmt/format.h>

#include <CLI/App.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/eval/trajectory_metrics.h"

namespace carmap {
namespace {

struct Arguments {
  std::string estimate, truth;
  bool json = false;
};

absl::StatusOr<ExitCode> Evaluate(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const Trajectory estimate, ReadTrajectory(arguments.estimate));
  CARMAP_ASSIGN_OR_RETURN(const Trajectory truth, ReadTrajectory(arguments.truth));
  const auto evaluation = EvaluateTrajectory(estimate, truth);
  if (!evaluation.ok()) return WithName(arguments.estimate, evaluation.status());
  fmt::print("{}", arguments.json ? JsonText(ToJson(*evaluation)) : ToText(*evaluation));
  return kSuccess;
}

}  // namespace

void AddEvaluateCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand(
      "evaluate", "Compare results with the truth, and simulated drives with real ones");
  command->require_subcommand(1);
  CLI::App* trajectory =
      command->add_subcommand("trajectory", "Errors of a trajectory against ground truth");
  const auto arguments = std::make_shared<Arguments>();
  trajectory->add_option("ESTIMATE", arguments->estimate, "Trajectory, KITTI or TUM form")
      ->required();
  trajectory->add_option("TRUTH", arguments->truth, "Ground truth, KITTI or TUM form")->required();
  trajectory->add_flag("--json", arguments->json, "Print JSON");
  trajectory->footer(R"(Errors:
  absolute  distances in metres after the best rigid alignment (ATE)
  relative  KITTI's measure: translation in percent and rotation in degrees per 100 m, over lengths
            of 100 to 800 m, and over 5 to 50 m for shorter paths

Poses belong together by time stamp (within 0.02 s) if both files are in TUM form, else by line.

Example:
  carmap evaluate trajectory localized.txt kitti06_000-050/poses.txt

Exit codes: 0 done, 1 error, 2 wrong usage)");
  trajectory->callback(
      [arguments, &chosen] { chosen = [arguments] { return Evaluate(*arguments); }; });
  AddEvaluateForgetting(*command, chosen);
  AddEvaluateFrames(*command, chosen);
  AddEvaluateLocalization(*command, chosen);
  AddEvaluateMatching(*command, chosen);
  AddEvaluatePlaces(*command, chosen);
  AddEvaluateRealism(*command, chosen);
  AddEvaluateLandmarks(*command, chosen);
  AddEvaluateSegmentation(*command, chosen);
  AddEvaluateStitching(*command, chosen);
  command->footer(R"(`carmap evaluate COMMAND --help` explains each.

Example:
  carmap evaluate trajectory localized.txt kitti06_000-050/poses.txt

Exit codes: 0 done, 1 error, 2 wrong usage)");
}

}  // namespace carmap
