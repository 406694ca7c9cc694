#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <algorithm>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/evaluated_map.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/stitching.h"
#include "carmap/eval/stitching_picture.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

struct Arguments {
  std::string base, base_truth, report, picture;
  std::vector<std::string> segments, segment_truths, ways;
};

/// A map of one drive, and the full one that `carmap map --full-map` wrote beside it.
struct Input {
  std::string path;
  LeanMap lean;
  std::optional<FullMap> full;
};

std::string FullMapBeside(const std::string& path) {
  return std::filesystem::path(path).replace_extension(".cfull").string();
}

absl::StatusOr<Input> ReadInput(const std::string& path, bool needs_full_map) {
  CARMAP_ASSIGN_OR_RETURN(LeanMap lean, ReadLeanMap(path));
  Input input{path, std::move(lean), std::nullopt};
  if (!needs_full_map) return input;
  const std::string full_path = FullMapBeside(path);
  const auto bytes = ReadFile(full_path, kMaxFullMapBytes);
  if (!bytes.ok()) {
    return absl::NotFoundError(fmt::format(
        "{}; --ways quicksketch needs the full map beside {}: `carmap map --full-map` writes it",
        std::string(bytes.status().message()), path));
  }
  CARMAP_ASSIGN_OR_RETURN(input.full, DecodeFullMap(*bytes, full_path));
  return input;
}

struct Way {
  const char* name;
  bool needs_full_map;
  std::function<absl::StatusOr<PlacedSegment>(const Input& base, const Input& segment)> stitch;
};

const std::vector<Way>& AllWays() {
  static const std::vector<Way> ways = {
      {"carmap", false,
       [](const Input& base, const Input& segment) {
         return StitchSegment(base.lean, segment.lean, {});
       }},
      {"appearance", false,
       [](const Input& base, const Input& segment) {
         StitchOptions options;
         options.fit.locator.by_appearance = true;
         return StitchSegment(base.lean, segment.lean, options);
       }},
      {"progressive", false,
       [](const Input& base, const Input& segment) {
         return RelocalizeProgressively(base.lean, segment.lean, {});
       }},
      {"quicksketch", true, [](const Input& base, const Input& segment) {
         return StitchTrace(*base.full, *segment.full);
       }}};
  return ways;
}

std::vector<Way> ChosenWays(const std::vector<std::string>& names) {
  std::vector<Way> ways;
  std::copy_if(AllWays().begin(), AllWays().end(), std::back_inserter(ways), [&](const Way& way) {
    return std::find(names.begin(), names.end(), way.name) != names.end();
  });
  return ways;
}

/// What one way made of one segment.
struct Result {
  absl::Status status;
  std::optional<StitchingScore> score;
  double ms = 0;
};

class Evaluation {
 public:
  Evaluation(const Input& base, const EvaluatedMap& evaluated, std::vector<Way> ways)
      : base_(base), evaluated_(evaluated), ways_(std::move(ways)) {
    for (const Way& way : ways_) curves_.push_back({way.name, {}});
  }

  /// Errors: the truth is not of this segment.
  absl::Status Add(const Input& segment, const Trajectory& truth) {
    if (segments_.empty()) PrintHead();
    const auto aligned = AlignMapToTruth(segment.lean, truth);
    if (!aligned.ok()) return WithName(segment.path, aligned.status());
    const MapAlignment& own = *aligned;
    nlohmann::ordered_json json = {{"segment", segment.path},
                                   {"keyframes", segment.lean.keyframes.size()},
                                   {"own_rmse_m", own.rmse_m},
                                   {"ways", nlohmann::ordered_json::array()}};
    for (size_t i = 0; i < ways_.size(); ++i) {
      CARMAP_ASSIGN_OR_RETURN(const Result result, Stitch(ways_[i], segment, truth));
      Print(segment, own.rmse_m, ways_[i].name, result);
      json["ways"].push_back(ToJson(ways_[i].name, result));
      curves_[i].points.emplace_back();
      if (result.score) curves_[i].points.back() = {result.score->error_m.mean, result.ms};
    }
    names_.push_back(std::filesystem::path(segment.path).stem().string());
    segments_.push_back(std::move(json));
    return absl::OkStatus();
  }

  nlohmann::ordered_json Report() const {
    return {{"base", base_.path},
            {"keyframes", base_.lean.keyframes.size()},
            {"base_rmse_m", evaluated_.alignment.rmse_m},
            {"segments", segments_}};
  }
  cv::Mat Picture() const {
    return RenderStitching("stitching to " + NameOf(base_.path), names_, curves_);
  }

 private:
  static void PrintHead() {
    fmt::print(
        "| segment | keyframes | by itself, RMSE | way | placed | mean error | largest | in the "
        "base, mean | largest | within bounds | ms |\n|---|---|---|---|---|---|---|---|---|---|---|"
        "\n");
  }

  absl::StatusOr<Result> Stitch(const Way& way, const Input& segment,
                                const Trajectory& truth) const {
    const auto placed = way.stitch(base_, segment);
    if (!placed.ok()) return Result{placed.status(), std::nullopt, 0};
    const auto score = ScoreStitching(placed->keyframes, truth, base_.lean, evaluated_.truth,
                                      evaluated_.alignment.world_from_map);
    if (!score) {
      return absl::FailedPreconditionError(
          fmt::format("{}: no keyframe has a true pose; is its --segment-truth the drive that it "
                      "was made from?",
                      segment.path));
    }
    return Result{absl::OkStatus(), score, placed->ms};
  }

  static void Print(const Input& segment, double own_rmse_m, const char* way,
                    const Result& result) {
    const size_t keyframes = segment.lean.keyframes.size();
    const std::string name = std::filesystem::path(segment.path).stem().string();
    if (!result.score) {
      fmt::print("| {} | {} | {:.3f} m | {} | – | ∞ | | | | | {} |\n", name, keyframes, own_rmse_m,
                 way, std::string(result.status.message()));
      return;
    }
    const StitchingScore& score = *result.score;
    fmt::print(
        "| {} | {} | {:.3f} m | {} | {} | {:.3f} m | {:.3f} m | {:.3f} m | {:.3f} m | {:.0f} % | "
        "{:.0f} |\n",
        name, keyframes, own_rmse_m, way, score.keyframes, score.error_m.mean, score.error_m.max,
        score.map_error_m.mean, score.map_error_m.max,
        100.0 * static_cast<double>(score.within_bounds) / static_cast<double>(score.keyframes),
        result.ms);
  }

  static nlohmann::ordered_json ToJson(const char* way, const Result& result) {
    if (!result.score) {
      return {{"way", way}, {"stitched", false}, {"reason", std::string(result.status.message())}};
    }
    return {{"way", way},
            {"stitched", true},
            {"keyframes", result.score->keyframes},
            {"error_m", carmap::ToJson(result.score->error_m)},
            {"map_error_m", carmap::ToJson(result.score->map_error_m)},
            {"within_bounds", result.score->within_bounds},
            {"farthest_m", result.score->farthest_m},
            {"ms", result.ms}};
  }

  const Input& base_;
  const EvaluatedMap& evaluated_;
  const std::vector<Way> ways_;
  std::vector<StitchingCurve> curves_;
  std::vector<std::string> names_;
  nlohmann::ordered_json segments_ = nlohmann::ordered_json::array();
};

absl::Status CheckTruthCount(const Arguments& arguments) {
  const size_t truths = arguments.segment_truths.size();
  if (truths <= 1 || truths == arguments.segments.size()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("--segment-truth: {} drives for {} segments; name one for all, or one a segment "
                  "in their order",
                  truths, arguments.segments.size()));
}

/// Of the segment of this number; without any given, that of the base.
const std::string& TruthFolder(const Arguments& arguments, size_t i) {
  const std::vector<std::string>& truths = arguments.segment_truths;
  return truths.empty() ? arguments.base_truth : truths[truths.size() == 1 ? 0 : i];
}

absl::StatusOr<ExitCode> EvaluateStitching(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckTruthCount(arguments));
  std::vector<std::string> inputs = arguments.segments;
  inputs.push_back(arguments.base);
  AddFiles(FilesOfDrive(arguments.base_truth), inputs);
  for (const std::string& truth : arguments.segment_truths) AddFiles(FilesOfDrive(truth), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report, arguments.picture}, inputs));
  const std::vector<Way> ways = ChosenWays(arguments.ways);
  const bool needs_full_maps =
      std::any_of(ways.begin(), ways.end(), [](const Way& way) { return way.needs_full_map; });
  CARMAP_ASSIGN_OR_RETURN(const Input base, ReadInput(arguments.base, needs_full_maps));
  CARMAP_ASSIGN_OR_RETURN(const EvaluatedMap evaluated,
                          AlignToTruth(base.lean, arguments.base, arguments.base_truth,
                                       /*is_part_of_base=*/true));
  Evaluation evaluation(base, evaluated, ways);
  Progress progress("stitching", arguments.segments.size());
  for (size_t i = 0; i < arguments.segments.size(); ++i) {
    CARMAP_ASSIGN_OR_RETURN(const Input segment, ReadInput(arguments.segments[i], needs_full_maps));
    CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(TruthFolder(arguments, i)));
    CARMAP_RETURN_IF_ERROR(
        CheckIsOfDrive(segment.lean, segment.path, *drive, TruthFolder(arguments, i)));
    CARMAP_RETURN_IF_ERROR(evaluation.Add(segment, drive->truth()));
    progress.Update(i + 1);
  }
  OutputFiles files;
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, evaluation.Report()); });
  files.Write(arguments.picture, [&] { return WritePng(arguments.picture, evaluation.Picture()); });
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateStitching(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "stitching", "Stitch segments to a base map in the ways to compare, and tell how far off");
  const auto arguments = std::make_shared<Arguments>();
  std::vector<std::string> names;
  for (const Way& way : AllWays()) {
    names.emplace_back(way.name);
    if (!way.needs_full_map) arguments->ways.emplace_back(way.name);
  }
  command->add_option("BASE", arguments->base, "The map to stitch to")
      ->required()
      ->type_name("B.cmap");
  command
      ->add_option("SEGMENT", arguments->segments, "Maps of drives that overlap it, each by itself")
      ->required()
      ->type_name("S.cmap");
  command
      ->add_option("--base-truth", arguments->base_truth, "The drive that the base was made from")
      ->required()
      ->type_name("DRIVE");
  command
      ->add_option("--segment-truth", arguments->segment_truths,
                   "The drive of the segments, or of each in their order (default: the base's); of "
                   "the same world")
      ->type_name("DRIVE");
  command
      ->add_option("--ways", arguments->ways,
                   "Which ways, with commas (default: all but quicksketch)")
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  command->add_option("--report", arguments->report, "Write all figures as JSON")
      ->type_name("R.json");
  command
      ->add_option("--picture", arguments->picture, "Draw errors and times of each segment and way")
      ->type_name("P.png");
  command->footer(
      R"(Ways:
  carmap       as `carmap stitch`: by position, bent to the base along the overlap
  appearance   the same, but the overlap is found by words and descriptors alone
  progressive  each keyframe is found anew in the base and what of the segment is in it by then
  quicksketch  one keyframe of the segment's full map is found in the base's full map by appearance,
               the others follow; needs what `carmap map --full-map` writes, M.cfull beside M.cmap

`By itself` is the segment's own error, once it is aligned to the truth alone: what no stitching takes away.
The others are distances of the segment's keyframes from the truth: of the base aligned as a whole, and
`in the base` from where the base's own keyframes nearby have the truth, which leaves the base's errors out.
Within bounds is what is off by at most 0.1 m up to 50 m from the base, and by 0.1 % of the way beyond.

Examples:
  carmap map lane0 --last 59 --out a.cmap --full-map a.cfull
  carmap map lane1 --first 40 --out b.cmap --full-map b.cfull
  carmap evaluate stitching a.cmap b.cmap --base-truth lane0 --segment-truth lane1 \
      --ways carmap,quicksketch --picture p.png
  make evaluate-stitching

Exit codes: 0 measured, whatever the result, 1 error, 2 wrong usage, 3 measured but an output could not
be written)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateStitching(*arguments); }; });
}

}  // namespace carmap
