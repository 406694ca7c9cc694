#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <algorithm>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/segmenter_option.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/canvas.h"
#include "carmap/map/strip.h"
#include "carmap/semantics/segmenter_choice.h"
#include "carmap/slam/map_drive.h"

namespace carmap {
namespace {

constexpr int kColumns = 20, kCropPx = 72;  ///< a landmark's square on the sheet
constexpr double kFeatureCrop = 56;         ///< its side in the feature's image, pixels

struct Arguments {
  std::string drive, segmenter, kept, removed, list;
  size_t count = 200;
  uint64_t seed = 1;
};

/// Where a person can see a landmark: in the middle one of its keyframes.
struct Example {
  LandmarkId id;
  uint32_t frame = 0;
  cv::Point2d px;  ///< in the camera's image
  cv::Mat crop;
};

Example ExampleOf(const Map& map, const Landmark& landmark, double camera_px_per_px) {
  const Observation& middle = landmark.observations[landmark.observations.size() / 2];
  const Feature& feature = (*map.Find(middle.keyframe_id)->features)[middle.feature_idx];
  return {landmark.id,
          middle.keyframe_id.index,
          {feature.x_px * camera_px_per_px, feature.y_px * camera_px_per_px},
          {}};
}

/// Of the landmarks that enough keyframes saw, `count` drawn by lot.
std::vector<Example> Draw(const Map& map, bool non_static, const Arguments& arguments,
                          double camera_px_per_px) {
  std::vector<const Landmark*> candidates;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (landmark.observations.size() < StripOptions().min_observations) continue;
    if (landmark.is_non_static() == non_static) candidates.push_back(&landmark);
  }
  std::mt19937_64 random(arguments.seed);
  std::vector<Example> drawn;
  while (drawn.size() < arguments.count && !candidates.empty()) {
    const size_t i = random() % candidates.size();
    drawn.push_back(ExampleOf(map, *candidates[i], camera_px_per_px));
    candidates.erase(candidates.begin() + static_cast<ptrdiff_t>(i));
  }
  return drawn;
}

void Crop(const StereoFrame& frame, double side_px, std::vector<Example>& examples) {
  for (Example& example : examples) {
    if (example.frame != frame.index || !frame.status.ok()) continue;
    const cv::Matx23d sheet_from_image(
        kCropPx / side_px, 0, kCropPx / 2.0 - example.px.x * kCropPx / side_px, 0,
        kCropPx / side_px, kCropPx / 2.0 - example.px.y * kCropPx / side_px);
    cv::warpAffine(frame.left, example.crop, sheet_from_image, {kCropPx, kCropPx});
    cv::cvtColor(example.crop, example.crop, cv::COLOR_GRAY2BGR);
    cv::circle(example.crop, {kCropPx / 2, kCropPx / 2}, 4, {0, 0, 255}, 1);
  }
}

/// Row by row, each landmark in the middle of its square.
cv::Mat SheetOf(const std::vector<Example>& examples) {
  const int rows = (static_cast<int>(examples.size()) + kColumns - 1) / kColumns;
  cv::Mat sheet(std::max(1, rows) * (kCropPx + 2), kColumns * (kCropPx + 2), CV_8UC3,
                cv::Scalar::all(255));
  for (size_t i = 0; i < examples.size(); ++i) {
    if (examples[i].crop.empty()) continue;
    const int column = static_cast<int>(i) % kColumns, row = static_cast<int>(i) / kColumns;
    examples[i].crop.copyTo(sheet({column * (kCropPx + 2), row * (kCropPx + 2), kCropPx, kCropPx}));
  }
  return sheet;
}

void AddToList(const char* sheet, const std::vector<Example>& examples, std::string& list) {
  for (size_t i = 0; i < examples.size(); ++i) {
    const Example& example = examples[i];
    list += fmt::format("{},{},{},{},{},{:.1f},{:.1f}\n", sheet, i / kColumns, i % kColumns,
                        example.id.index, example.frame, example.px.x, example.px.y);
  }
}

absl::StatusOr<ExitCode> EvaluateLandmarks(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  AddFiles(FilesOfSegmenter(arguments.segmenter, arguments.drive), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.kept, arguments.removed, arguments.list}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive));
  MapDriveOptions options;
  const PinholeCamera& camera = drive->rig().camera;
  CARMAP_ASSIGN_OR_RETURN(options.segmenter, MakeSegmenter(arguments.segmenter, arguments.drive,
                                                           {camera.width, camera.height}));
  if (!options.segmenter) {
    return absl::InvalidArgumentError(
        "--segmenter none: keeps all and removes nothing, so there is nothing to judge; name one");
  }
  Progress progress("mapping", drive->size());
  const auto mapped = MapDrive(*drive, drive->id(), options,
                               [&](size_t frames, size_t) { progress.Update(frames); });
  if (!mapped.ok()) return WithName(arguments.drive, mapped.status());
  const bool is_whole = CheckWhole(mapped->failure, arguments.drive);
  const bool is_filtered =
      CheckLabelling(mapped->labelling, arguments.segmenter, "what it could not label is kept");

  const double camera_px_per_px = static_cast<double>(camera.width) / mapped->rig.camera.width;
  auto kept = Draw(mapped->map, /*non_static=*/false, arguments, camera_px_per_px);
  auto removed = Draw(mapped->map, /*non_static=*/true, arguments, camera_px_per_px);
  CARMAP_ASSIGN_OR_RETURN(const auto again, KittiDrive::Open(arguments.drive));
  while (const auto frame = again->Next()) {
    Crop(*frame, kFeatureCrop * camera_px_per_px, kept);
    Crop(*frame, kFeatureCrop * camera_px_per_px, removed);
  }
  std::string list = "sheet,row,column,landmark,frame,x_px,y_px\n";
  AddToList("kept", kept, list);
  AddToList("removed", removed, list);
  OutputFiles files;
  files.Write(arguments.kept, [&] { return WritePng(arguments.kept, SheetOf(kept)); });
  files.Write(arguments.removed, [&] { return WritePng(arguments.removed, SheetOf(removed)); });
  files.Write(arguments.list, [&] { return WriteFileAtomically(arguments.list, list); });
  fmt::print("drawn         {} kept, {} removed\n", Count(kept.size(), "landmark"),
             Count(removed.size(), "landmark"));
  return files.Finish() && is_whole && is_filtered ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateLandmarks(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "landmarks", "Sheets of landmarks that a segmenter kept and removed, to be judged by eye");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  AddSegmenterOption(*command, arguments->segmenter);
  command->add_option("--kept", arguments->kept, "Draw landmarks that are in the map")
      ->required()
      ->type_name("P.png");
  command->add_option("--removed", arguments->removed, "Draw landmarks voted non-static")
      ->required()
      ->type_name("P.png");
  command->add_option("--list", arguments->list, "Write where each is, row and column from 0")
      ->required()
      ->type_name("L.csv");
  command->add_option("--count", arguments->count, "Landmarks a sheet, drawn by lot")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str()
      ->type_name("N");
  command->add_option("--seed", arguments->seed, "Of the lot")->capture_default_str();
  command->footer(fmt::format(
      R"(Real drives have no labels that are true: somebody has to look. Each square of a sheet shows a
landmark, circled, in one of its keyframes.

{}

Example:
  carmap evaluate landmarks kitti06_000-050 --segmenter espnetv2.json --kept kept.png \
    --removed removed.png --list list.csv

Exit codes: 0 drawn, 1 error, 2 wrong usage, 3 drawn but the segmenter failed, or not all of
the drive was mapped, or not all files could be written)",
      kSegmenterHelp));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateLandmarks(*arguments); }; });
}

}  // namespace carmap
