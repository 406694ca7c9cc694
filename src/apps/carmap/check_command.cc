#include <fmt/format.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/health_report.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/slam/drive_sample.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive;
  FrameRange range;
  bool json = false;
};

constexpr size_t kSampledPairs = 40;

/// What a sample of the drive's pairs shows.
struct Check {
  std::vector<SampledPair> sample;
  size_t asked = 0;  ///< frames to be sampled
  PairHealth pairs;
  std::vector<Suspicion> suspicions;
  double depth_share = 0, wall_s = 0;
};

double DepthShare(const std::vector<SampledPair>& sample) {
  size_t features = 0, with_depth = 0;
  for (const SampledPair& pair : sample) {
    features += pair.features;
    with_depth += pair.with_depth;
  }
  return features == 0 ? 0 : static_cast<double>(with_depth) / static_cast<double>(features);
}

/// Where a fault begins within the drive, finds its first frame.
void FindOnset(const KittiDrive& drive, const std::vector<SampledPair>& sample,
               Suspicion& suspicion) {
  uint32_t sound_index = drive.first();
  for (const SampledPair& sampled : sample) {
    if (sampled.pair.index >= suspicion.first_index) break;
    sound_index = sampled.pair.index;
  }
  if (sound_index >= suspicion.first_index) return;
  suspicion.first_index = FindOnset(drive, suspicion.fault, sound_index, suspicion.first_index);
}

Check CheckDrive(const KittiDrive& drive) {
  const Stopwatch watch;
  Check check;
  const std::vector<uint32_t> indices = SpreadOver(drive, kSampledPairs);
  check.asked = indices.size();
  check.sample = SamplePairs(drive, indices);
  const std::vector<CheckedPair> pairs = PairsOf(check.sample);
  check.pairs = Summarize(drive.rig().camera, pairs);
  check.suspicions = JudgePairs(drive.rig(), pairs);
  for (Suspicion& suspicion : check.suspicions) FindOnset(drive, check.sample, suspicion);
  check.depth_share = DepthShare(check.sample);
  check.wall_s = watch.ElapsedMs() * 1e-3;
  return check;
}

nlohmann::ordered_json ToJson(const KittiDrive& drive, const Check& check) {
  const PairHealth& pairs = check.pairs;
  return {{"frames", drive.size()},
          {"sampled_pairs", check.sample.size()},
          {"unreadable_pairs", check.asked - check.sample.size()},
          {"telling_pairs", pairs.telling_pairs},
          {"baseline_m", drive.rig().baseline_m},
          {"row_offset_px", pairs.row_offset_px},
          {"row_slope_px", pairs.row_slope_px},
          {"before_m", pairs.before_baselines * drive.rig().baseline_m},
          {"distortion", pairs.distortion},
          {"brightness_ratio", pairs.brightness_ratio},
          {"depth_share", check.depth_share},
          {"wall_s", check.wall_s},
          {"suspect", carmap::ToJson(check.suspicions)}};
}

void PrintCheck(const KittiDrive& drive, const Check& check) {
  const PairHealth& pairs = check.pairs;
  const auto row = [](const char* name, const std::string& value) {
    fmt::print("{:<14}{}\n", name, value);
  };
  row("checked",
      fmt::format("{} of {}, {} showing enough, in {:.1f} s", Count(check.sample.size(), "pair"),
                  drive.size(), pairs.telling_pairs, check.wall_s));
  row("baseline", fmt::format("{:.3f} m", drive.rig().baseline_m));
  row("rows", fmt::format("right image {:+.2f} px lower in its middle, {:+.2f} px more from border "
                          "to border",
                          pairs.row_offset_px, pairs.row_slope_px));
  row("moment", fmt::format("right camera {:+.2f} m before the left one",
                            pairs.before_baselines * drive.rig().baseline_m));
  row("distortion", fmt::format("{:+.2f}", pairs.distortion));
  row("brightness",
      fmt::format("right image {:.0f} % of the left one", 100 * pairs.brightness_ratio));
  row("depth", fmt::format("{:.0f} % of features", 100 * check.depth_share));
  row("verdict", check.suspicions.empty() ? "sound" : "suspect");
}

/// Whether the verdict is of all pairs that were to be looked at; if not, says so on standard
/// error.
bool CheckRead(const Check& check, const std::string& drive) {
  const size_t unread = check.asked - check.sample.size();
  if (unread == 0) return true;
  PrintProblem(fmt::format("{}: {} of {} cannot be read; `carmap map` names each", drive, unread,
                           Count(check.asked, "sampled pair")));
  return false;
}

absl::StatusOr<ExitCode> RunCheck(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive, arguments.range));
  const Check check = CheckDrive(*drive);
  if (check.pairs.telling_pairs == 0 && check.suspicions.empty()) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: none of {} shows enough to tell: dark, blank or blurred images, or two cameras that "
        "do not look the same way; look at image_0 and image_1",
        arguments.drive, Count(check.asked, "sampled pair")));
  }
  if (arguments.json) {
    fmt::print("{}", JsonText(ToJson(*drive, check)));
  } else {
    PrintCheck(*drive, check);
  }
  const bool is_sound = CheckSound(check.suspicions, arguments.drive);
  return CheckRead(check, arguments.drive) && is_sound ? kSuccess : kIncomplete;
}

}  // namespace

void AddCheckCommand(CLI::App& app, Command& chosen) {
  CLI::App* command =
      app.add_subcommand("check", "Tell whether a drive's images and rig are sound");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  command->add_option("--first", arguments->range.first, "First frame to check, from 0")
      ->type_name("N");
  command->add_option("--last", arguments->range.last, "Last frame to check (default: the drive's)")
      ->type_name("M");
  command->add_flag("--json", arguments->json, "Print JSON");
  command->footer(
      R"(Forty pairs of the drive are looked at. Corners of both images are matched without the help of the
calibration, which shows whether left and right are exchanged, upside down, the same image, not of
the same moment, not rectified, or whether rows do not meet, and from which frame on. `map` and
`localize` look at every tenth pair in the same way.

A right camera that is turned by less than 0.7 degrees, or whose images lie as little higher or lower, is named;
`map` and `localize` undo it.

Example:
  carmap check kitti06_000-050

Exit codes: 0 sound, 1 error, or the images show too little to tell, 2 wrong usage, 3 suspect, or
some pairs cannot be read: lines on standard error say why and what to do)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunCheck(*arguments); }; });
}

}  // namespace carmap
