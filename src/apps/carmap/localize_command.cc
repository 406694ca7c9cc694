#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/drive_localizer.h"
#include "apps/carmap/evaluated_map.h"
#include "apps/carmap/health_report.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/segmenter_option.h"
#include "carmap/base/exceptions.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/image_file.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/error_picture.h"
#include "carmap/eval/frame_picture.h"
#include "carmap/eval/localization_error.h"
#include "carmap/eval/map_truth.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/index/reconstruct.h"
#include "carmap/ingest/base_map.h"
#include "carmap/semantics/segmenter_choice.h"
#include "carmap/slam/drive_mapper.h"
#include "carmap/slam/drive_sample.h"
#include "carmap/slam/fix_judgement.h"
#include "carmap/slam/frame_extraction.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/vehicle/base_tracker.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, map, map_truth, segmenter, trajectory, report, picture, frame_picture,
      error_picture;
  FrameRange range;
};

/// Lays the map on --map-truth; nothing if that was not asked for.
absl::StatusOr<std::optional<EvaluatedMap>> AlignMap(const LoadedMap& loaded,
                                                     const KittiDrive& drive,
                                                     const Arguments& arguments) {
  if (arguments.map_truth.empty()) return std::nullopt;
  CARMAP_ASSIGN_OR_RETURN(
      EvaluatedMap evaluated,
      AlignToTruth(loaded.lean, arguments.map, arguments.map_truth, loaded.base != nullptr));
  CARMAP_RETURN_IF_ERROR(CheckTruth(drive, arguments.drive));
  return evaluated;
}

LocalizedDrive LocalizeDrive(KittiDrive& drive, LoadedMap& loaded,
                             std::shared_ptr<Segmenter> segmenter) {
  const RowMisalignment misalignment = FindMisalignment(drive);
  FrameExtraction frames(drive, {.misalignment = misalignment}, /*sequential=*/false);
  DriveLocalizer localizer(loaded, drive.rig(), frames.front_end(), std::move(segmenter));
  Progress progress("localizing", drive.size());
  const absl::Status driven = CatchExceptions([&] {
    for (size_t taken = 1; const auto frame = frames.Next(); ++taken) {
      localizer.Take(*frame);
      progress.Update(taken, fmt::format("{} localized", localizer.drive().localized()));
    }
  });
  localizer.drive().failure = std::string(driven.message());
  localizer.drive().labelling = localizer.labelling();
  localizer.drive().health = localizer.Health();
  localizer.drive().undone = misalignment;
  if (const auto& follower = localizer.follower()) {
    localizer.drive().tiles_read = follower->tiles_read();
    localizer.drive().damaged_tiles = follower->damaged();
    if (const auto used = follower->Used(); used.ok()) {
      loaded.lean = Moved(used->map(), localizer.first_from_view());
    }
  }
  if (drive.gps() != nullptr) {
    localizer.drive().gps =
        JudgeFixes(*drive.gps(), localizer.drive().trajectory, GeoreferenceOf(loaded.lean, {}), {});
  }
  return std::move(localizer.drive());
}

const char* WordOf(KnownBy known_by) {
  switch (known_by) {
    case KnownBy::kMap:
      return "map";
    case KnownBy::kDeadReckoning:
      return "dead_reckoning";
    case KnownBy::kLost:
      break;
  }
  return "lost";
}

/// Root of the mean squared error of the position that the covariance states.
double StatedErrorM(const UncertainPose& pose) {
  return std::sqrt(pose.covariance.topLeftCorner<3, 3>().trace());
}

void AddErrors(const UncertainPose& pose, const Rigid3& world_from_camera,
               const EvaluatedMap& evaluated, nlohmann::ordered_json& detail) {
  AddErrors(evaluated, pose.camera_from_base.Inverse(), world_from_camera, detail);
  const Rigid3 true_camera_from_base = evaluated.truth.InMap(world_from_camera).Inverse();
  detail["squared_mahalanobis"] =
      NormalizedErrorOf(pose.camera_from_base, pose.covariance, true_camera_from_base).position;
}

nlohmann::ordered_json DetailOf(const FrameResult& frame) {
  nlohmann::ordered_json json;
  json["index"] = frame.index;
  json["known_by"] = WordOf(frame.pose.known_by);
  json["dead_reckoned_m"] = frame.pose.dead_reckoned_m;
  json["inliers"] = frame.pose.inliers.size();
  json["ms"] = frame.frame_ms;
  if (frame.pose.pose) json["sigma_m"] = StatedErrorM(*frame.pose.pose);
  return json;
}

/// Each frame, with its errors where the truth is known.
nlohmann::ordered_json DetailsOf(const LocalizedDrive& localized, const Trajectory& truth,
                                 const std::optional<EvaluatedMap>& evaluated) {
  auto details = nlohmann::ordered_json::array();
  for (size_t i = 0; i < localized.frames.size(); ++i) {
    const FrameResult& frame = localized.frames[i];
    details.push_back(DetailOf(frame));
    if (!evaluated || !frame.pose.pose || !truth[i].world_from_camera) continue;
    AddErrors(*frame.pose.pose, *truth[i].world_from_camera, *evaluated, details.back());
  }
  return details;
}

nlohmann::ordered_json ToJson(const LoadedMap& loaded, const LocalizedDrive& localized) {
  nlohmann::ordered_json report;
  report["frames"] = localized.trajectory.size();
  report["localized_frames"] = localized.localized();
  report["known_by"] = {{"map", localized.by_map},
                        {"dead_reckoning", localized.by_dead_reckoning},
                        {"lost", localized.lost_frames.size()}};
  report["longest_dead_reckoning_m"] = localized.longest_dead_reckoning_m;
  report["load_ms"] = {{"read", loaded.read_ms},
                       {"decode", loaded.decode_ms},
                       {"rebuild", loaded.rebuild_ms},
                       {"total", loaded.read_ms + loaded.decode_ms + loaded.rebuild_ms}};
  if (loaded.base) {
    report["base"] = {{"tiles_read", localized.tiles_read},
                      {"views", localized.views},
                      {"damaged_tiles", localized.damaged_tiles}};
  } else {
    report["map_bytes"] = loaded.bytes;
  }
  report["frame_ms"] = ToJson(Summarize(localized.frame_ms));
  report["peak_rss_mb"] = PeakMemoryMb();
  report["health"] = ToJson(localized.health, localized.gps);
  report["misalignment_undone"] = ToJson(localized.undone);
  report["unusable_frames"] = ToJson(localized.unusable_frames);
  report["lost_frames"] = ToJson(localized.lost_frames);
  if (!localized.failure.empty()) report["failure"] = localized.failure;
  return report;
}

void AddErrors(const MapAlignment& alignment, const LocalizationError& error,
               nlohmann::ordered_json& report) {
  report["position_error_m"] = ToJson(error.position_m);
  report["rotation_error_deg"] = ToJson(error.rotation_deg);
  report["map_alignment"] = {{"keyframes", alignment.keyframes}, {"rmse_m", alignment.rmse_m}};
}

/// Nothing where the truth is not known.
std::optional<LocalizationError> ErrorOf(const LocalizedDrive& localized,
                                         const std::optional<EvaluatedMap>& evaluated,
                                         const Trajectory& truth) {
  if (!evaluated) return std::nullopt;
  return EvaluateLocalization(localized.trajectory, truth, evaluated->alignment.world_from_map);
}

nlohmann::ordered_json ReportOf(const LoadedMap& loaded, const LocalizedDrive& localized,
                                const std::optional<EvaluatedMap>& evaluated,
                                const Trajectory& truth) {
  nlohmann::ordered_json report = ToJson(loaded, localized);
  if (const auto error = ErrorOf(localized, evaluated, truth)) {
    AddErrors(evaluated->alignment, *error, report);
  }
  report["frames_detail"] = DetailsOf(localized, truth, evaluated);
  return report;
}

absl::Status WriteMapFromAbove(const LoadedMap& loaded, const LocalizedDrive& localized,
                               const std::optional<EvaluatedMap>& evaluated,
                               const Trajectory& truth, const Arguments& arguments) {
  std::vector<PicturePath> paths;
  if (evaluated) {
    paths.push_back(
        PathOf("ground truth", kTruthColour, truth, evaluated->alignment.world_from_map.Inverse()));
  }
  paths.push_back(PathOf("localized", kEstimateColour, localized.trajectory));
  const std::string title =
      fmt::format("{} localized in {}", NameOf(arguments.drive), NameOf(arguments.map));
  return WriteMapPicture(arguments.picture, PictureOf(loaded.lean, title, paths));
}

/// Errors of each frame over the distance along the truth.
cv::Mat DrawErrors(const LocalizedDrive& localized, const MapAlignment& alignment,
                   const Trajectory& truth, const Arguments& arguments) {
  ErrorCurve position{"position (m)", {}}, rotation{"rotation (deg)", {}};
  for (const FrameError& error :
       LocalizationErrors(localized.trajectory, truth, alignment.world_from_map)) {
    position.values.emplace_back(error.path_m, error.position_m);
    rotation.values.emplace_back(error.path_m, error.rotation_deg);
  }
  return RenderErrorPicture(
      fmt::format("Error of {} localized in {}", NameOf(arguments.drive), NameOf(arguments.map)),
      {position, rotation});
}

void WritePictures(const LoadedMap& loaded, const LocalizedDrive& localized,
                   const std::optional<EvaluatedMap>& evaluated, const Trajectory& truth,
                   const Arguments& arguments, OutputFiles& files) {
  files.Write(arguments.picture,
              [&] { return WriteMapFromAbove(loaded, localized, evaluated, truth, arguments); });
  files.Write(arguments.frame_picture, [&] {
    return WritePng(arguments.frame_picture, RenderFramePicture(localized.best_frame));
  });
  files.Write(arguments.error_picture, [&]() -> absl::Status {
    if (!evaluated)
      return absl::FailedPreconditionError("--error-picture: no truth to compare with");
    return WritePng(arguments.error_picture,
                    DrawErrors(localized, evaluated->alignment, truth, arguments));
  });
}

void PrintSummary(const LoadedMap& loaded, const LocalizedDrive& localized,
                  const std::optional<LocalizationError>& error) {
  fmt::print("localized     {} of {}: {} by the map, {} by dead reckoning ({:.1f} m at most)\n",
             localized.localized(), Count(localized.trajectory.size(), "frame"), localized.by_map,
             localized.by_dead_reckoning, localized.longest_dead_reckoning_m);
  if (loaded.base) {
    fmt::print("base          opened in {:.1f} ms; {} read around the vehicle, in {}\n",
               loaded.read_ms, Count(localized.tiles_read, "tile"), Count(localized.views, "view"));
  } else {
    fmt::print("map           loaded in {:.1f} ms (read {:.1f}, decode {:.1f}, rebuild {:.1f})\n",
               loaded.read_ms + loaded.decode_ms + loaded.rebuild_ms, loaded.read_ms,
               loaded.decode_ms, loaded.rebuild_ms);
  }
  fmt::print("frame         {} ms\n", ToText(Summarize(localized.frame_ms), 1));
  PrintUndone(localized.undone);
  PrintHealth(localized.health, localized.gps);
  if (!error) return;
  fmt::print("position      {} m off\n", ToText(error->position_m, 3));
  fmt::print("rotation      {} deg off\n", ToText(error->rotation_deg, 3));
}

/// Which frames have no pose, summed up in one line.
void PrintNotFound(const LocalizedDrive& localized) {
  constexpr size_t kMaxRanges = 5;
  if (localized.lost_frames.empty()) return;
  std::vector<std::pair<uint32_t, uint32_t>> ranges;
  for (const LostFrame& frame : localized.lost_frames) {
    if (ranges.empty() || frame.index != ranges.back().second + 1) {
      ranges.emplace_back(frame.index, frame.index);
    }
    ranges.back().second = frame.index;
  }
  std::vector<std::string> words;
  for (const auto& [first, last] : ranges) {
    if (words.size() == kMaxRanges) {
      words.push_back("...");
      break;
    }
    words.push_back(first == last ? fmt::format("{}", first) : fmt::format("{}-{}", first, last));
  }
  fmt::print("not found     {}: {}; where the map does not show the road, or not yet known\n",
             Count(localized.lost_frames.size(), "frame"), fmt::join(words, ", "));
}

absl::Status NoFrameFound(const LocalizedDrive& localized, const Arguments& arguments) {
  if (!localized.health.suspicions.empty()) {
    const Suspicion& suspicion = localized.health.suspicions.front();
    return absl::NotFoundError(fmt::format("{}: no frame of {} was found in {}: {}; {}",
                                           arguments.drive, localized.trajectory.size(),
                                           arguments.map, suspicion.finding, suspicion.remedy));
  }
  return absl::NotFoundError(fmt::format(
      "{}: no frame of {} was found in {} (the first: {}); take a map of the road that it drives",
      arguments.drive, localized.trajectory.size(), arguments.map,
      localized.failure.empty() ? localized.lost_frames.front().reason : localized.failure));
}

absl::Status CheckFiles(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  AddFiles(FoldersOfBase(arguments.map), inputs);
  if (!arguments.map_truth.empty()) {
    AddFiles(FilesOfDrive(arguments.map_truth), inputs);
  }
  AddFiles(FilesOfSegmenter(arguments.segmenter, arguments.drive), inputs);
  return CheckOutputs({arguments.trajectory, arguments.report, arguments.picture,
                       arguments.frame_picture, arguments.error_picture},
                      inputs);
}

/// Whether nothing of what was asked for is missing; says on standard error what is.
bool CheckComplete(const LocalizedDrive& localized, const Arguments& arguments,
                   const OutputFiles& files) {
  const bool is_sound = CheckSound(localized.health.suspicions, arguments.drive);
  const bool agrees_with_gps = CheckGps(localized.gps, arguments.drive);
  PrintLostFrames(arguments.drive, localized.unusable_frames);
  for (const std::string& tile : localized.damaged_tiles) PrintProblem(tile);
  const bool is_whole = CheckWhole(localized.failure, arguments.drive);
  const bool is_filtered = CheckLabelling(localized.labelling, arguments.segmenter,
                                          "the vehicle may have tracked itself by traffic");
  const bool is_written = files.Finish();
  return is_whole && is_filtered && is_sound && agrees_with_gps && is_written &&
         localized.unusable_frames.empty() && localized.damaged_tiles.empty();
}

absl::StatusOr<ExitCode> RunLocalize(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckFiles(arguments));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive, arguments.range));
  CARMAP_ASSIGN_OR_RETURN(LoadedMap loaded, LoadMap(arguments.map, drive->rig()));
  std::optional<EvaluatedMap> evaluated;
  if (!loaded.base) {
    CARMAP_ASSIGN_OR_RETURN(evaluated, AlignMap(loaded, *drive, arguments));
  }
  const PinholeCamera& camera = drive->rig().camera;
  CARMAP_ASSIGN_OR_RETURN(auto segmenter, MakeSegmenter(arguments.segmenter, arguments.drive,
                                                        {camera.width, camera.height}));
  const LocalizedDrive localized = LocalizeDrive(*drive, loaded, std::move(segmenter));
  OutputFiles files;
  const bool is_found = localized.localized() > 0;
  bool is_aligned = true;
  if (loaded.base && is_found) {  // what was found stays, also where the truth does not fit it
    if (auto aligned = AlignMap(loaded, *drive, arguments); aligned.ok()) {
      evaluated = *std::move(aligned);
    } else {
      PrintProblem(std::string(aligned.status().message()));
      is_aligned = false;
    }
  }
  if (is_found) {
    files.Write(arguments.trajectory,
                [&] { return WriteTrajectory(arguments.trajectory, localized.trajectory); });
    WritePictures(loaded, localized, evaluated, drive->truth(), arguments, files);
  }
  // After them, as its peak of memory is that of all of the work.
  files.Write(arguments.report, [&] {
    return WriteReport(arguments.report, ReportOf(loaded, localized, evaluated, drive->truth()));
  });
  if (!is_found) return NoFrameFound(localized, arguments);
  PrintSummary(loaded, localized, ErrorOf(localized, evaluated, drive->truth()));
  PrintNotFound(localized);
  return CheckComplete(localized, arguments, files) && is_aligned ? kSuccess : kIncomplete;
}

}  // namespace

void AddLocalizeCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("localize", "Find each frame of a drive in a map");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  command->add_option("--map", arguments->map, "The map (.cmap), or the folder of a base map")
      ->required()
      ->type_name("MAP");
  command->add_option("--first", arguments->range.first, "First frame to localize, from 0")
      ->type_name("N");
  command
      ->add_option("--last", arguments->range.last, "Last frame to localize (default: the drive's)")
      ->type_name("M");
  command
      ->add_option("--map-truth", arguments->map_truth,
                   "The drive that the map was made from: its poses.txt aligns the map, once and "
                   "rigidly, to the world in which the poses.txt of DRIVE is the truth")
      ->type_name("DRIVE");
  command
      ->add_option("--trajectory", arguments->trajectory,
                   "Write the pose of each frame in the map's frame, metres: TUM form if named "
                   "*.tum, else KITTI form")
      ->type_name("T.txt");
  command
      ->add_option("--report", arguments->report,
                   "Write counts, times (ms) and, with --map-truth, errors (m, deg) as JSON")
      ->type_name("R.json");
  command
      ->add_option("--picture", arguments->picture,
                   "Draw landmarks, localized path and truth from above")
      ->type_name("P.png");
  command
      ->add_option("--frame-picture", arguments->frame_picture,
                   "Draw the frame that was found best, with its features")
      ->type_name("P.png");
  command
      ->add_option("--error-picture", arguments->error_picture,
                   "Draw the errors over the distance driven")
      ->needs("--map-truth")
      ->type_name("P.png");
  AddSegmenterOption(*command, arguments->segmenter);
  command->footer(fmt::format(
      R"(The vehicle tracks itself in a map of its own; the landmarks of MAP that it sees correct its pose. A
frame that shows none is known by dead reckoning, with a covariance that grows. While the vehicle
does not know where it is, it looks near its fix, if the drive has gps.txt and the map has GPS
fixes, and then in the whole map, and believes in a place that agrees with its own motion.

Of a base only the tiles around the vehicle are read, as it drives: at first by its fix, or by what it
sees. The trajectory is in the frame of the first tile: x east, y down, z north, metres.

With a segmenter the vehicle does not track itself by traffic (the paper's dynamic object filter).

{}

The report tells of each frame how its pose is known (map, dead_reckoning, lost), how far it was
dead reckoned, and the covariance (6x6, metres and radians in the camera: translation, rotation).

The report's load_ms is the time to read the file, decode it, and rebuild what it leaves out;
frame_ms is from images in memory to the frame's pose. frames_detail has each frame: by what it is
known, sigma_m (the root mean squared error of the position that the covariance states) and, with
--map-truth, its errors against the truth, against the map's own trajectory (map_…: without the map's
scale and drift), and squared_mahalanobis: of the latter position error, 3 degrees of freedom.

Frames that are not found in the map are counted and do not change the exit code as long as one is
found; the report is written even if none is. Frames whose images cannot be used (unreadable, black,
frozen) are listed, and do. A file that cannot be written costs no other; lines say which were
written and which not.

Examples:
  carmap localize kitti06_000-050 --map road.cmap --trajectory localized.txt
  carmap localize kitti06_000-050 --map road.cmap --map-truth kitti06_000-050 --report r.json

`health` tells, as `carmap map` does, what the drive shows of its own soundness.

Exit codes: 0 done, 1 error or no frame found, 2 wrong usage, 3 done but without unusable images,
the drive is suspect or its GPS contradicts it, the segmenter failed, or a file could not be written)",
      kSegmenterHelp));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunLocalize(*arguments); }; });
}

}  // namespace carmap
