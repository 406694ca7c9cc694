// The subcommands of the program.
//
// Each Add…Command teaches the parser one subcommand. When it was asked for, the parser leaves in
// `chosen` what is to be done. Options and inputs are checked before anything long or anything that
// writes begins.
#pragma once

#include <absl/status/statusor.h>

#include <CLI/App.hpp>
#include <functional>

namespace carmap {

/// What the program exits with; an error status becomes kError and one line.
enum ExitCode { kSuccess = 0, kError = 1, kWrongUsage = 2, kIncomplete = 3 };

using Command = std::function<absl::StatusOr<ExitCode>()>;

void AddSimulateCommand(CLI::App& app, Command& chosen);
void AddCheckCommand(CLI::App& app, Command& chosen);
void AddMapCommand(CLI::App& app, Command& chosen);
void AddLocalizeCommand(CLI::App& app, Command& chosen);
void AddDriveCommand(CLI::App& app, Command& chosen);
void AddStitchCommand(CLI::App& app, Command& chosen);
void AddBaseCommand(CLI::App& app, Command& chosen);
void AddDiffCommand(CLI::App& app, Command& chosen);
void AddInfoCommand(CLI::App& app, Command& chosen);
void AddEvaluateCommand(CLI::App& app, Command& chosen);
void AddVocabularyCommand(CLI::App& app, Command& chosen);

/// To `carmap base`.
void AddBaseChanges(CLI::App& base, Command& chosen);

/// To `carmap evaluate`.
void AddEvaluateForgetting(CLI::App& evaluate, Command& chosen);
void AddEvaluateFrames(CLI::App& evaluate, Command& chosen);
void AddEvaluateLocalization(CLI::App& evaluate, Command& chosen);
void AddEvaluateMatching(CLI::App& evaluate, Command& chosen);
void AddEvaluatePlaces(CLI::App& evaluate, Command& chosen);
void AddEvaluateRealism(CLI::App& evaluate, Command& chosen);
void AddEvaluateLandmarks(CLI::App& evaluate, Command& chosen);
void AddEvaluateSegmentation(CLI::App& evaluate, Command& chosen);
void AddEvaluateStitching(CLI::App& evaluate, Command& chosen);

}  // namespace carmap
