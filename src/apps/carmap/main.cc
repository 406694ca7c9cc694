// The program `carmap`: reads the command line and runs one subcommand.
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <string>

#include "apps/carmap/commands.h"
#include "apps/carmap/help_format.h"
#include "apps/carmap/outputs.h"
#include "carmap/base/exceptions.h"

namespace carmap {
namespace {

constexpr const char* kFooter =
    R"(Two cars map two parts of one road, and a third finds itself on all of it:
  carmap map kitti06_000-050 --last 33 --out base.cmap
  carmap map kitti06_000-050 --first 18 --out segment.cmap
  carmap stitch base.cmap segment.cmap --out road.cmap
  carmap info road.cmap
  carmap localize kitti06_000-050 --map road.cmap --trajectory localized.txt
  carmap evaluate trajectory localized.txt kitti06_000-050/poses.txt

A DRIVE is a folder in KITTI's layout: image_0/ (left) and image_1/ (right) with rectified images
of the same names, calib.txt (P0: and P1:), times.txt (seconds), and optionally poses.txt (ground
truth) and gps.txt (time latitude longitude altitude).

`carmap COMMAND --help` explains each command, its options and their units.

Exit codes:
  0  done
  1  an error; one line on standard error names file, cause and remedy
  2  wrong usage
  3  done, but not with all of the input, or the drive cannot be right, or some file could not be
     written: lines on standard error say what and why)";

/// Cause and remedy in one line.
std::string ExplainUsage(const CLI::App& app, const CLI::ParseError& error,
                         const std::string& first_argument) {
  const auto chosen = app.get_subcommands();
  if (!chosen.empty()) {
    return fmt::format("{}; see `carmap {} --help`", error.what(), chosen.front()->get_name());
  }
  if (first_argument.empty() || first_argument.front() == '-') {
    return fmt::format("{}; see `carmap --help`", error.what());
  }
  return fmt::format("there is no command '{}'; see `carmap --help`", first_argument);
}

/// Streams and terminals that are closed or that nobody reads any more cost no work: writing to
/// them is an error, not a signal, and no file that is opened takes their place.
void SecureStandardStreams() {
  for (const int signal : {SIGPIPE, SIGXFSZ, SIGHUP}) std::signal(signal, SIG_IGN);
  int descriptor = 0;
  while (descriptor >= 0 && descriptor <= STDERR_FILENO) {
    descriptor = ::open("/dev/null", O_RDONLY);  // the lowest that is free
  }
  if (descriptor > STDERR_FILENO) ::close(descriptor);
}

/// Does what was asked for. Errors: those of the command; what was printed was not written.
absl::StatusOr<ExitCode> RunChosen(const Command& chosen) {
  absl::StatusOr<ExitCode> exit_code = kError;
  const absl::Status thrown = CatchExceptions([&] { exit_code = chosen(); });
  if (!exit_code.ok()) return exit_code;
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {  // printing throws then
    return absl::UnavailableError("standard output: cannot be written; is its disk full?");
  }
  if (!thrown.ok()) return thrown;
  return exit_code;
}

int Run(int argc, char** argv) {
  CLI::App app("CarMap: lean 3D feature maps of roads from a car's stereo camera.", "carmap");
  app.footer(kFooter);
  app.set_help_flag("-h,--help", "Print this help");
  app.set_version_flag("--version", "carmap " CARMAP_VERSION, "Print the version");
  app.require_subcommand(1);
  app.formatter(std::make_shared<HelpFormat>());

  Command chosen;
  AddSimulateCommand(app, chosen);
  AddCheckCommand(app, chosen);
  AddMapCommand(app, chosen);
  AddLocalizeCommand(app, chosen);
  AddDriveCommand(app, chosen);
  AddStitchCommand(app, chosen);
  AddBaseCommand(app, chosen);
  AddDiffCommand(app, chosen);
  AddInfoCommand(app, chosen);
  AddEvaluateCommand(app, chosen);
  AddVocabularyCommand(app, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(error);
    PrintProblem(ExplainUsage(app, error, argc > 1 ? argv[1] : ""));
    return kWrongUsage;
  }

  cv::setNumThreads(1);  // what runs in parallel runs on oneTBB
  const auto exit_code = RunChosen(chosen);
  if (exit_code.ok()) return *exit_code;
  PrintProblem(std::string(exit_code.status().message()));
  return kError;
}

}  // namespace
}  // namespace carmap

int main(int argc, char** argv) {
  carmap::SecureStandardStreams();
  int exit_code = carmap::kError;
  const absl::Status thrown = carmap::CatchExceptions([&] { exit_code = carmap::Run(argc, argv); });
  if (!thrown.ok()) carmap::PrintProblem(std::string(thrown.message()));
  return exit_code;
}
