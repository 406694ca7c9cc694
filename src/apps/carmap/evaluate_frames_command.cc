#include <fmt/format.h>

#include <CLI/App.hpp>
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
#include "carmap/feature/stereo_features.h"
#include "carmap/format/lean_codec.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/appearance_localizer.h"
#include "carmap/slam/frame_extraction.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, trace, map, map_truth, report;
};

/// A full or a lean map, as appearance knows both.
struct SearchedMap {
  MapSnapshot snapshot;
  LeanMap keyframes;  ///< without landmarks, if it is a full map
  size_t bytes = 0;
};

absl::StatusOr<SearchedMap> ReadMap(const std::string& path, const StereoRig& rig) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxFullMapBytes));
  const auto full = DecodeFullMap(bytes, path);
  if (full.ok()) return SearchedMap{SnapshotOf(*full), KeyframesOf(*full), bytes.size()};
  if (!absl::IsInvalidArgument(full.status())) return full.status();
  CARMAP_ASSIGN_OR_RETURN(LeanMap lean, DecodeLeanMap(bytes, path));
  MapSnapshot snapshot = Reconstruct(lean, rig.camera.fx).snapshot;
  return SearchedMap{std::move(snapshot), std::move(lean), bytes.size()};
}

/// Finds frames one by one and writes down how far off they are.
class FrameFinder {
 public:
  FrameFinder(const SearchedMap& map, const StereoRig& rig, const EvaluatedMap& evaluated)
      : rig_(rig), evaluated_(evaluated), localizer_(map.snapshot, DefaultVocabulary()) {}

  void Find(uint32_t index, const std::vector<Feature>& features,
            const std::optional<Rigid3>& world_from_camera) {
    if (!world_from_camera) return;
    const Stopwatch watch;
    const auto pose = localizer_.Localize(features, rig_);
    nlohmann::ordered_json& frame = frames_.emplace_back();
    frame = {{"index", index}, {"known_by", pose ? "map" : "lost"}, {"ms", watch.ElapsedMs()}};
    if (!pose) return;
    AddErrors(evaluated_, pose->camera_from_map.Inverse(), *world_from_camera, frame);
    frame["inliers"] = pose->inliers.size();
    errors_m_.push_back(frame["position_error_m"]);
  }

  const nlohmann::ordered_json& frames() const { return frames_; }
  const std::vector<double>& errors_m() const { return errors_m_; }

 private:
  const StereoRig rig_;
  const EvaluatedMap& evaluated_;
  const AppearanceLocalizer localizer_;
  nlohmann::ordered_json frames_ = nlohmann::ordered_json::array();
  std::vector<double> errors_m_;
};

/// Each frame of the drive, as ORB-SLAM2 would relocalize it.
void FindFrames(KittiDrive& drive, FrameFinder& finder) {
  FrameExtraction frames(drive, {}, /*sequential=*/false);
  Progress progress("localizing", drive.size());
  for (size_t n = 0; const auto frame = frames.Next(); ++n) {
    finder.Find(frame->index, frame->features ? *frame->features : std::vector<Feature>(),
                drive.truth()[n].world_from_camera);
    progress.Update(n + 1);
  }
}

/// The keyframes of the drive's trace, as QuickSketch relocalizes them.
absl::Status FindTrace(const std::string& path, const KittiDrive& drive, FrameFinder& finder) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxFullMapBytes));
  CARMAP_ASSIGN_OR_RETURN(const FullMap trace, DecodeFullMap(bytes, path));
  if (trace.drive.id != drive.id()) {
    return absl::FailedPreconditionError(
        fmt::format("{}: is not of this drive; write it with `carmap map --full-map`", path));
  }
  Progress progress("localizing", trace.keyframes.size());
  for (size_t k = 0; k < trace.keyframes.size(); ++k) {
    const FullKeyframe& keyframe = trace.keyframes[k];
    std::vector<Feature> features;
    for (const FullFeature& full : keyframe.features) features.push_back(full.feature);
    finder.Find(keyframe.index, features,
                keyframe.index < drive.truth().size()
                    ? drive.truth()[keyframe.index].world_from_camera
                    : std::nullopt);
    progress.Update(k + 1);
  }
  return absl::OkStatus();
}

absl::StatusOr<ExitCode> EvaluateAppearance(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  inputs.push_back(arguments.map);
  if (!arguments.trace.empty()) inputs.push_back(arguments.trace);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(arguments.drive));
  const StereoRig feature_rig = StereoFrontEnd(drive->rig()).rig();
  CARMAP_ASSIGN_OR_RETURN(const SearchedMap map, ReadMap(arguments.map, feature_rig));
  CARMAP_ASSIGN_OR_RETURN(const EvaluatedMap evaluated,
                          AlignToTruth(map.keyframes, arguments.map, arguments.map_truth));
  FrameFinder finder(map, AsMapped(feature_rig, map.keyframes), evaluated);
  if (arguments.trace.empty()) {
    FindFrames(*drive, finder);
  } else {
    CARMAP_RETURN_IF_ERROR(FindTrace(arguments.trace, *drive, finder));
  }
  CARMAP_RETURN_IF_ERROR(WriteReport(arguments.report, {{"frames", finder.frames().size()},
                                                        {"map_bytes", map.bytes},
                                                        {"frames_detail", finder.frames()}}));
  fmt::print("found         {} of {}\n", finder.errors_m().size(),
             Count(finder.frames().size(), "frame"));
  fmt::print("position      {} m off\n", ToText(Summarize(finder.errors_m()), 3));
  return kSuccess;
}

}  // namespace

void AddEvaluateAppearance(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "appearance", "Find a drive's frames in a map by appearance alone, to compare");
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
      ->add_option("--trace", arguments->trace,
                   "The full map of DRIVE: look for its keyframes instead of all frames")
      ->type_name("F.cfull");
  command
      ->add_option(
          "--report", arguments->report,
          "Write each frame's errors as JSON, as `carmap evaluate localization` reads them")
      ->type_name("R.json");
  command->footer(
      R"(The baselines of the paper. Each frame by itself, without GPS: keyframes that resemble it by words, the
landmarks of one of them at a time matched by descriptor, PnP, and a guided search. All frames in a
full map is ORB-SLAM2's way, a trace in a full map QuickSketch's.

Example:
  carmap evaluate appearance busy --map empty.cfull --map-truth empty --report R.json

Exit codes: 0 measured, whatever the result, 1 error, 2 wrong usage)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateAppearance(*arguments); }; });
}

}  // namespace carmap
