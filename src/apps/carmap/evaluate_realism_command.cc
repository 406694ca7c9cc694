#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/histogram_picture.h"
#include "carmap/eval/realism.h"

namespace carmap {
namespace {

struct Arguments {
  std::string simulated, real, picture;
  size_t frames = 50;
  bool json = false;
};

/// Reads the chain's frames into the meter.
absl::Status TakeChain(const std::string& folder, const FrameChain& chain, RealismMeter& meter,
                       size_t& done, Progress& progress) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(folder, {chain.first, chain.last}));
  meter.BeginChain();
  while (const auto frame = drive->Next()) {
    CARMAP_RETURN_IF_ERROR(frame->status);
    meter.Take(frame->left, frame->right);
    progress.Update(++done);
  }
  return absl::OkStatus();
}

absl::StatusOr<DriveMeasures> MeasureDrive(const std::string& folder, size_t max_frames) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(folder));
  if (drive->size() < FeatureTracks::kMinChainFrames) {
    return absl::InvalidArgumentError(
        fmt::format("{}: has {}, too few to follow features; give a drive of at least {}", folder,
                    Count(drive->size(), "frame"), FeatureTracks::kMinChainFrames));
  }
  const std::vector<FrameChain> chains = ChooseChains(drive->size(), max_frames);
  Progress progress("measuring " + NameOf(folder),
                    chains.size() * (chains.front().last - chains.front().first + 1));
  RealismMeter meter(drive->rig());
  size_t done = 0;
  for (const FrameChain& chain : chains) {
    CARMAP_RETURN_IF_ERROR(TakeChain(folder, chain, meter, done, progress));
  }
  DriveMeasures measures = meter.Finish();
  if (measures.lost_pairs == measures.pairs) {
    return absl::FailedPreconditionError(
        fmt::format("{}: between none of its frames could the camera's motion be found; look at "
                    "its images and calib.txt",
                    folder));
  }
  return measures;
}

cv::Mat Draw(const RealismComparison& comparison, const Arguments& arguments) {
  std::vector<HistogramPanel> panels;
  for (const MeasureComparison& measure : comparison.measures) {
    const MeasureInfo& info = InfoOf(measure.measure);
    const std::string unit = info.unit.empty() ? "" : fmt::format(" ({})", info.unit);
    panels.push_back({info.name + unit, comparison.simulated[measure.measure],
                      comparison.real[measure.measure]});
  }
  return RenderHistograms(
      fmt::format("{} beside {}", NameOf(arguments.simulated), NameOf(arguments.real)),
      "simulated: " + NameOf(arguments.simulated), "real: " + NameOf(arguments.real), panels);
}

absl::StatusOr<ExitCode> EvaluateRealism(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.simulated);
  AddFiles(FilesOfDrive(arguments.real), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.picture}, inputs));
  CARMAP_RETURN_IF_ERROR(KittiDrive::Open(arguments.real).status());  // before long work
  CARMAP_ASSIGN_OR_RETURN(DriveMeasures simulated,
                          MeasureDrive(arguments.simulated, arguments.frames));
  CARMAP_ASSIGN_OR_RETURN(DriveMeasures real, MeasureDrive(arguments.real, arguments.frames));
  const RealismComparison comparison = CompareRealism(std::move(simulated), std::move(real));
  OutputFiles files;
  files.Write(arguments.picture,
              [&] { return WritePng(arguments.picture, Draw(comparison, arguments)); });
  fmt::print("{}", arguments.json ? JsonText(ToJson(comparison)) : ToText(comparison));
  return files.Finish() ? kSuccess : kIncomplete;
}

constexpr const char* kFooter =
    R"(Each measure is a distribution of samples: one an image, a pair of successive images, a feature or
a match. The table gives its tenth percentile, median and ninetieth percentile in both drives, the
ratio of the medians, the largest difference of the cumulative distributions (0: the same, 1: far
apart), and whether the medians agree within a factor of 1.5, Hamming distances within 1.2.

  grey level, gradient    of the left image: mean, standard deviation, central differences
  noise in flat places    standard deviation in 8x8 px, tenth percentile over the image
  spectrum 1/f^n          n of the power spectrum about 0.13 cycles a pixel (coarse) and 0.25
                          (fine), where lens and sharpening show
  corners                 before any are selected, of contrast 7 or 20 grey levels, by pyramid level
  features with depth     share of the features that find a match in the right image
  stereo match            how far 11x11 px differ there, in grey levels, on average (brightness off:
                          their means), and rows between the images after rectification
  found again             share of the features with depth whose true match is in the next frame
  true match              the feature that lies where the camera's motion puts it, within 2 px at
                          its level: told by place alone, not by descriptor. Place off: how far
                          from there. Hamming: unequal bits of the 128. Ambiguous: share for which
                          a feature elsewhere, within 5 % of the image's width, comes as near in
                          bits (within a quarter, or two)
  track length            of features found again at least once, followed for up to 10 frames; in
                          metres, the mean over those that begin in one frame

The motion from frame to frame is the localizer's own, good to a few millimetres; poses.txt is not
needed. Tracks and Hamming distances depend on how far the car drives from frame to frame: compare
drives of like speed (the last row says). Two real drives do not agree in all measures either;
compare two to see by how much. If images differ in size by more than a fifth, counts of the
simulated drive are scaled to the area of the real one, and its disparities to that one's rig.

Example:
  carmap evaluate realism simulated_suburb kitti06_000-050 --picture realism.png

Exit codes: 0 measured, whatever the result, 1 error, 2 wrong usage, 3 measured but the picture could
not be written)";

}  // namespace

void AddEvaluateRealism(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "realism", "How like a real drive a simulated one is to the front end");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->simulated, "Folder of the simulated drive")->required();
  command->add_option("REAL_DRIVE", arguments->real, "Folder of the real drive")->required();
  command
      ->add_option("--frames", arguments->frames,
                   "Frames to measure of each drive, at most, in chains spread evenly over it "
                   "(default 50, at least 11)")
      ->check(CLI::Range(FeatureTracks::kMinChainFrames, size_t{1'000'000}).description(""))
      ->type_name("N");
  command->add_flag("--json", arguments->json, "Print JSON");
  command
      ->add_option("--picture", arguments->picture,
                   "Draw the distributions of both drives over each other")
      ->type_name("P.png");
  command->footer(kFooter);
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateRealism(*arguments); }; });
}

}  // namespace carmap
