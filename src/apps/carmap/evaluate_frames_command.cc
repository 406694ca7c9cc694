#include <fmt/format.h>

#include <CLI/App.hpp>
#include <algorithm>
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
#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/eval/full_map.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/format/lean_codec.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/appearance_localizer.h"
#include "carmap/localize/place_search.h"
#include "carmap/slam/frame_extraction.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, trace, map, map_truth, report, by = "place-search";
};

/// A full or a lean map.
struct SearchedMap {
  ReconstructedMap map;
  LeanMap keyframes;  ///< without landmarks, if it is a full map
  size_t bytes = 0;
};

absl::StatusOr<SearchedMap> ReadMap(const std::string& path, const StereoRig& rig) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxFullMapBytes));
  const auto full = DecodeFullMap(bytes, path);
  if (full.ok()) {
    return SearchedMap{IndexSnapshot(SnapshotOf(*full), rig.camera.fx), KeyframesOf(*full),
                       bytes.size()};
  }
  if (!absl::IsInvalidArgument(full.status())) return full.status();
  CARMAP_ASSIGN_OR_RETURN(LeanMap lean, DecodeLeanMap(bytes, path));
  ReconstructedMap map = Reconstruct(lean, rig.camera.fx);
  return SearchedMap{std::move(map), std::move(lean), bytes.size()};
}

/// How a frame is looked for.
using FindFrame =
    std::function<std::optional<Rigid3>(const std::vector<Feature>&, const std::optional<GpsFix>&)>;

FindFrame ByAppearance(const SearchedMap& map, const StereoRig& rig) {
  const auto localizer =
      std::make_shared<const AppearanceLocalizer>(map.map.snapshot, DefaultVocabulary());
  return [rig, localizer](const std::vector<Feature>& features,
                          const std::optional<GpsFix>&) -> std::optional<Rigid3> {
    const auto pose = localizer->Localize(features, rig);
    if (!pose) return std::nullopt;
    return pose->camera_from_map;
  };
}

FindFrame ByPlaceSearch(const SearchedMap& map, const StereoRig& rig) {
  const auto search = std::make_shared<PlaceSearch>(
      map.map,
      std::shared_ptr<const Vocabulary>(std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()));
  return [rig, search](const std::vector<Feature>& features,
                       const std::optional<GpsFix>& gps) -> std::optional<Rigid3> {
    search->Forget();
    const FeatureGrid grid(features, rig.camera.width, rig.camera.height);
    const std::vector<PlaceHypothesis> places = search->Search(grid, rig, gps);
    if (places.empty()) return std::nullopt;
    return places.front().camera_from_map;
  };
}

/// Finds frames one by one and writes down how far off they are.
class FrameFinder {
 public:
  FrameFinder(FindFrame find, const EvaluatedMap& evaluated)
      : find_(std::move(find)), evaluated_(evaluated) {}

  void Find(uint32_t index, const std::vector<Feature>& features, const std::optional<GpsFix>& gps,
            const std::optional<Rigid3>& world_from_camera) {
    if (!world_from_camera) return;
    const Stopwatch watch;
    const auto camera_from_map = find_(features, gps);
    nlohmann::ordered_json& frame = frames_.emplace_back();
    frame = {{"index", index},
             {"known_by", camera_from_map ? "map" : "lost"},
             {"ms", watch.ElapsedMs()}};
    if (!camera_from_map) return;
    AddErrors(evaluated_, camera_from_map->Inverse(), *world_from_camera, frame);
    errors_m_.push_back(frame["map_position_error_m"]);
  }

  const nlohmann::ordered_json& frames() const { return frames_; }
  /// Against the map's own trajectory.
  const std::vector<double>& errors_m() const { return errors_m_; }

 private:
  const FindFrame find_;
  const EvaluatedMap& evaluated_;
  nlohmann::ordered_json frames_ = nlohmann::ordered_json::array();
  std::vector<double> errors_m_;
};

/// Each frame of the drive.
void FindFrames(KittiDrive& drive, FrameFinder& finder) {
  FrameExtraction frames(drive, {}, /*sequential=*/false);
  Progress progress("localizing", drive.size());
  for (size_t n = 0; const auto frame = frames.Next(); ++n) {
    finder.Find(frame->index, frame->features ? *frame->features : std::vector<Feature>(),
                frame->gps, drive.truth()[n].world_from_camera);
    progress.Update(n + 1);
  }
}

/// The keyframes of the drive's trace, as QuickSketch relocalizes them.
absl::Status FindTrace(const std::string& path, const KittiDrive& drive, FrameFinder& finder) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxFullMapBytes));
  CARMAP_ASSIGN_OR_RETURN(const FullMap trace, DecodeFullMap(bytes, path));
  if (trace.drive.id.input != drive.id().input) {
    return absl::FailedPreconditionError(
        fmt::format("{}: is not of this drive; write it with `carmap map --full-map`", path));
  }
  Progress progress("localizing", trace.keyframes.size());
  for (size_t k = 0; k < trace.keyframes.size(); ++k) {
    const FullKeyframe& keyframe = trace.keyframes[k];
    std::vector<Feature> features;
    for (const FullFeature& full : keyframe.features) features.push_back(full.feature);
    finder.Find(keyframe.index, features, std::nullopt,
                keyframe.index < drive.truth().size()
                    ? drive.truth()[keyframe.index].world_from_camera
                    : std::nullopt);
    progress.Update(k + 1);
  }
  return absl::OkStatus();
}

void PrintSummary(const FrameFinder& finder) {
  constexpr double kRightM = 0.5, kWrongM = 2;
  const std::vector<double>& errors_m = finder.errors_m();
  const auto within = [&](double bound_m) {
    return std::count_if(errors_m.begin(), errors_m.end(),
                         [&](double error_m) { return error_m <= bound_m; });
  };
  fmt::print("found         {} of {}: {} within {} m, {} wrong by more than {} m\n",
             errors_m.size(), Count(finder.frames().size(), "frame"), within(kRightM), kRightM,
             static_cast<ptrdiff_t>(errors_m.size()) - within(kWrongM), kWrongM);
  if (errors_m.empty()) return;
  fmt::print("position      {} m off\n", ToText(Summarize(errors_m), 3));
}

absl::StatusOr<ExitCode> EvaluateFrames(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  inputs.push_back(arguments.map);
  if (!arguments.trace.empty()) inputs.push_back(arguments.trace);
  AddFiles(FilesOfDrive(arguments.map_truth), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(arguments.drive));
  const StereoRig rig = StereoFrontEnd(drive->rig()).rig();
  CARMAP_ASSIGN_OR_RETURN(const SearchedMap map, ReadMap(arguments.map, rig));
  CARMAP_ASSIGN_OR_RETURN(const EvaluatedMap evaluated,
                          AlignToTruth(map.keyframes, arguments.map, arguments.map_truth));
  FrameFinder finder(
      arguments.by == "appearance" ? ByAppearance(map, rig) : ByPlaceSearch(map, rig), evaluated);
  if (arguments.trace.empty()) {
    FindFrames(*drive, finder);
  } else {
    CARMAP_RETURN_IF_ERROR(FindTrace(arguments.trace, *drive, finder));
  }
  OutputFiles files;
  files.Write(arguments.report, [&] {
    return WriteReport(arguments.report, {{"frames", finder.frames().size()},
                                          {"map_bytes", map.bytes},
                                          {"frames_detail", finder.frames()}});
  });
  PrintSummary(finder);
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateFrames(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "frames", "Find each frame of a drive in a map by itself, in the ways to compare");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive, with poses.txt")->required();
  command
      ->add_option("--map", arguments->map, "A lean map, or a full one of `carmap map --full-map`")
      ->required()
      ->type_name("MAP");
  command->add_option("--map-truth", arguments->map_truth, "The drive that the map was made from")
      ->required()
      ->type_name("DRIVE");
  command
      ->add_option(
          "--by", arguments->by,
          "place-search: GPS, words, size and position, as `carmap localize` looks for its "
          "place; appearance: words and descriptors alone")
      ->check(CLI::IsMember({"place-search", "appearance"}))
      ->capture_default_str();
  command
      ->add_option("--trace", arguments->trace,
                   "The full map of DRIVE: look for its keyframes instead of all frames")
      ->type_name("F.cfull");
  command
      ->add_option(
          "--report", arguments->report,
          "Write each frame's errors as JSON, as `carmap evaluate localization` reads them")
      ->type_name("R.json");
  command->footer(
      R"(Each frame by itself, as if nothing were known of the frames before it.

By place-search the best hypothesis is taken, however weak; `carmap localize` believes one only if it agrees
with the vehicle's motion. By appearance the paper's baselines: keyframes that resemble the frame by words,
the landmarks of one of them at a time matched by descriptor, PnP, and a guided search, without GPS. All
frames in a full map is ORB-SLAM2's way, a trace in a full map QuickSketch's.

Example:
  carmap evaluate frames busy --map empty.cmap --map-truth empty
  carmap evaluate frames busy --by appearance --map empty.cfull --map-truth empty --report R.json

Exit codes: 0 measured, whatever the result, 1 error, 2 wrong usage, 3 measured but the report could
not be written)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateFrames(*arguments); }; });
}

}  // namespace carmap
