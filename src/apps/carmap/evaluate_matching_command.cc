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
#include "apps/carmap/reports.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/eval/matching_ratio.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/format/lean_codec.h"
#include "carmap/index/reconstruct.h"
#include "carmap/slam/frame_extraction.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, map, map_truth;
  bool json = false;
};

/// Of the frames that show a landmark of the map.
struct Ratios {
  size_t frames = 0;
  MatchingCounts total;
  std::vector<double> by_position, by_appearance;

  void Take(const MatchingCounts& counts) {
    if (counts.in_sight == 0) return;
    const auto in_sight = static_cast<double>(counts.in_sight);
    ++frames;
    total.in_sight += counts.in_sight;
    by_position.push_back(static_cast<double>(counts.by_position) / in_sight);
    by_appearance.push_back(static_cast<double>(counts.by_appearance) / in_sight);
  }
  double InSightAFrame() const {
    return frames == 0 ? 0 : static_cast<double>(total.in_sight) / static_cast<double>(frames);
  }
};

Ratios MeasureDrive(KittiDrive& drive, const LeanMap& lean, const MapTruth& truth) {
  FrameExtraction frames(drive, {}, /*sequential=*/false);
  const StereoRig rig = frames.front_end().rig();
  const ReconstructedMap map = Reconstruct(lean, rig.camera.fx);
  const MatchingMeter meter(map, rig, DefaultVocabulary());
  Progress progress("matching", drive.size());
  Ratios ratios;
  for (size_t n = 0; const auto frame = frames.Next(); ++n) {
    progress.Update(n + 1);
    const auto& world_from_camera = drive.truth()[n].world_from_camera;
    if (!world_from_camera || !frame->features) continue;
    ratios.Take(meter.Measure(*frame->features, truth.InMap(*world_from_camera).Inverse(),
                              /*seed=*/n + 1));
  }
  return ratios;
}

absl::StatusOr<ExitCode> EvaluateMatching(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(arguments.drive));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap lean, ReadLeanMap(arguments.map));
  CARMAP_ASSIGN_OR_RETURN(const EvaluatedMap evaluated,
                          AlignToTruth(lean, arguments.map, arguments.map_truth));
  const Ratios ratios = MeasureDrive(*drive, lean, evaluated.truth);
  if (ratios.frames == 0) {
    return absl::FailedPreconditionError(
        fmt::format("{}: none of its frames shows a landmark of {}; take a map of the same road",
                    arguments.drive, arguments.map));
  }
  const Summary position = Summarize(ratios.by_position),
                appearance = Summarize(ratios.by_appearance);
  if (arguments.json) {
    fmt::print("{}", JsonText({{"frames", ratios.frames},
                               {"landmarks_in_sight", ratios.InSightAFrame()},
                               {"matched_by_position", position.mean},
                               {"matched_by_appearance", appearance.mean}}));
  } else {
    fmt::print("landmarks     {:.0f} in sight a frame, of {}\n", ratios.InSightAFrame(),
               Count(ratios.frames, "frame"));
    fmt::print("by position   {:.3f} of them are matched\n", position.mean);
    fmt::print("by appearance {:.3f} of them are matched\n", appearance.mean);
  }
  return kSuccess;
}

}  // namespace

void AddEvaluateMatching(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "matching", "What share of a map's landmarks in sight is matched, by position and otherwise");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive, with poses.txt")->required();
  command->add_option("--map", arguments->map, "The map")->required()->type_name("MAP.cmap");
  command->add_option("--map-truth", arguments->map_truth, "The drive that the map was made from")
      ->required()
      ->type_name("DRIVE");
  command->add_flag("--json", arguments->json, "Print JSON");
  const MatchingOptions options;
  command->footer(fmt::format(
      R"(A landmark is in sight where, at the true pose, a feature is within {:g} px of where it must appear and
its disparity within {:g} px; a match is right if its feature is there. By position: the frame is tracked
as by `carmap localize`, from a pose that is as far off as a prediction ({:g} m and {:g} mrad an axis). By
appearance: all landmarks of the keyframes that resemble the frame by words are compared with all
features. Shares are means over the frames.

Example:
  carmap evaluate matching busy --map empty.cmap --map-truth empty

Exit codes: 0 measured, 1 error, 2 wrong usage)",
      options.true_match_px, options.same_disparity_px, options.prediction_m,
      1e3 * options.prediction_rad));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateMatching(*arguments); }; });
}

}  // namespace carmap
