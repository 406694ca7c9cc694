#include <fmt/format.h>

#include <CLI/App.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/image_file.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/dataset/read_ahead.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/error_picture.h"
#include "carmap/eval/frame_picture.h"
#include "carmap/eval/localization_error.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/format/lean_codec.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/localizer.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, map, map_truth, trajectory, report, picture, frame_picture, error_picture;
  FrameRange range;
};

struct LoadedMap {
  LeanMap lean;
  StereoRig rig;  ///< of the vehicle that localizes
  ReconstructedMap map;
  double read_ms = 0, decode_ms = 0, rebuild_ms = 0;
};

/// The rig that drives, with the disparity bias that was learnt if the same one mapped.
StereoRig AsMapped(const StereoRig& rig, const LeanMap& map) {
  for (const LeanDrive& drive : map.drives) {
    if (drive.rig.camera == rig.camera && drive.rig.baseline_m == rig.baseline_m) return drive.rig;
  }
  return rig;
}

absl::StatusOr<LoadedMap> LoadMap(const std::string& path, const StereoRig& rig) {
  LoadedMap loaded;
  const Stopwatch read_watch;
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxLeanFileBytes));
  loaded.read_ms = read_watch.ElapsedMs();
  const Stopwatch decode_watch;
  CARMAP_ASSIGN_OR_RETURN(loaded.lean, DecodeLeanMap(bytes, path));
  loaded.decode_ms = decode_watch.ElapsedMs();
  if (loaded.lean.landmarks.empty()) {
    return absl::FailedPreconditionError(
        fmt::format("{}: holds no landmark to localize by; map a longer drive", path));
  }
  const Stopwatch rebuild_watch;
  loaded.rig = AsMapped(rig, loaded.lean);
  loaded.map = Reconstruct(loaded.lean, rig.camera.fx);
  loaded.rebuild_ms = rebuild_watch.ElapsedMs();
  return loaded;
}

/// Aligns the map to --map-truth; nothing if that was not asked for.
absl::StatusOr<std::optional<MapAlignment>> AlignMap(const LeanMap& map, const KittiDrive& drive,
                                                     const Arguments& arguments) {
  if (arguments.map_truth.empty()) return std::nullopt;
  CARMAP_ASSIGN_OR_RETURN(const auto truth_drive, KittiDrive::Open(arguments.map_truth));
  for (const auto& [folder, truth] : {std::pair(&arguments.map_truth, &truth_drive->truth()),
                                      std::pair(&arguments.drive, &drive.truth())}) {
    if (truth->empty()) {
      return absl::NotFoundError(fmt::format(
          "{}/poses.txt: no such file; with --map-truth both drives need ground truth", *folder));
    }
  }
  auto alignment = AlignMapToTruth(map, truth_drive->truth());
  if (!alignment.ok()) return WithName(arguments.map, alignment.status());
  return *alignment;
}

struct LocalizedDrive {
  Trajectory trajectory;  ///< in the map's frame, one entry a frame
  std::vector<LostFrame> lost_frames;
  size_t unusable_frames = 0;  ///< of the lost ones, those whose images are at fault, not the map
  std::vector<double> frame_ms;
  size_t tracked = 0, tracked_widely = 0, relocalized = 0;
  FramePicture best_frame;  ///< the one with most landmarks

  size_t localized() const { return trajectory.size() - lost_frames.size(); }
};

/// One drive's way through the map, frame by frame.
class DriveLocalizer {
 public:
  explicit DriveLocalizer(const LoadedMap& loaded)
      : rig_(loaded.rig), front_end_(rig_), localizer_(loaded.map, rig_) {}

  void Take(const StereoFrame& frame) {
    TimedPose& pose = drive_.trajectory.emplace_back();
    pose.timestamp = frame.timestamp;
    if (HaveSamePixels(frame.left, previous_left_)) {
      return LoseUnusable(frame.index,
                          "the image is the same as the one before: the camera was frozen");
    }
    previous_left_ = frame.left;
    const Stopwatch watch;
    const std::vector<Feature> features = front_end_.Extract(frame.left, frame.right);
    const LocalizedFrame localized = localizer_.Localize(frame.timestamp, features, frame.gps);
    drive_.frame_ms.push_back(watch.ElapsedMs());
    pose.world_from_camera = localized.map_from_camera;
    Count(localized.found_by);
    if (localized.map_from_camera) return RememberIfBest(frame, features, localized.inliers);
    if (features.size() < kMinFeatures) {
      return LoseUnusable(frame.index,
                          fmt::format("only {} features in the image", features.size()));
    }
    drive_.lost_frames.push_back({frame.index, "it was not found in the map"});
  }

  void TakeUnreadable(uint32_t index, Timestamp timestamp, const absl::Status& status) {
    drive_.trajectory.push_back({timestamp, std::nullopt});
    LoseUnusable(index, std::string(status.message()));
  }

  LocalizedDrive& drive() { return drive_; }

 private:
  static constexpr size_t kMinFeatures = 50;  ///< fewer come of a black or blinded image

  void RememberIfBest(const StereoFrame& frame, const std::vector<Feature>& features,
                      const std::vector<LandmarkMatch>& inliers) {
    if (inliers.size() <= most_inliers_) return;
    most_inliers_ = inliers.size();
    drive_.best_frame = {fmt::format("Frame {} in the map", frame.index), frame.left, features,
                         std::vector<bool>(features.size())};
    for (const LandmarkMatch& match : inliers) drive_.best_frame.in_map[match.feature_idx] = true;
  }

  void LoseUnusable(uint32_t index, const std::string& reason) {
    ++drive_.unusable_frames;
    drive_.lost_frames.push_back({index, reason});
  }

  void Count(FoundBy found_by) {
    drive_.tracked += found_by == FoundBy::kTracking;
    drive_.tracked_widely += found_by == FoundBy::kWideTracking;
    drive_.relocalized += found_by == FoundBy::kRelocalization;
  }

  const StereoRig rig_;
  StereoFrontEnd front_end_;
  Localizer localizer_;
  cv::Mat previous_left_;
  size_t most_inliers_ = 0;
  LocalizedDrive drive_;
};

LocalizedDrive LocalizeDrive(KittiDrive& drive, const LoadedMap& loaded) {
  DriveLocalizer localizer(loaded);
  ReadAhead reading(drive, /*sequential=*/false);
  Progress progress("localizing", drive.frame_count());
  for (size_t n = 0; n < drive.frame_count(); ++n) {
    const auto frame = reading.Next();
    if (frame.ok()) {
      localizer.Take(**frame);
    } else {
      localizer.TakeUnreadable(drive.first_index() + static_cast<uint32_t>(n), drive.timestamp(n),
                               frame.status());
    }
    progress.Update(n + 1, fmt::format("{} localized", localizer.drive().localized()));
  }
  return std::move(localizer.drive());
}

nlohmann::ordered_json ToJson(const LoadedMap& loaded, const LocalizedDrive& localized) {
  nlohmann::ordered_json report;
  report["frames"] = localized.trajectory.size();
  report["localized_frames"] = localized.localized();
  report["found_by"] = {{"tracking", localized.tracked},
                        {"wide_tracking", localized.tracked_widely},
                        {"relocalization", localized.relocalized}};
  report["load_ms"] = {{"read", loaded.read_ms},
                       {"decode", loaded.decode_ms},
                       {"rebuild", loaded.rebuild_ms},
                       {"total", loaded.read_ms + loaded.decode_ms + loaded.rebuild_ms}};
  report["frame_ms"] = ToJson(Summarize(localized.frame_ms));
  report["peak_rss_mb"] = PeakMemoryMb();
  report["lost_frames"] = ToJson(localized.lost_frames);
  return report;
}

void AddErrors(const MapAlignment& alignment, const LocalizationError& error,
               nlohmann::ordered_json& report) {
  report["position_error_m"] = ToJson(error.position_m);
  report["rotation_error_deg"] = ToJson(error.rotation_deg);
  report["map_alignment"] = {{"keyframes", alignment.keyframes}, {"rmse_m", alignment.rmse_m}};
}

absl::Status WriteMapFromAbove(const LoadedMap& loaded, const LocalizedDrive& localized,
                               const std::optional<MapAlignment>& alignment,
                               const Trajectory& truth, const Arguments& arguments) {
  std::vector<PicturePath> paths;
  if (alignment) {
    paths.push_back(
        PathOf("ground truth", kTruthColour, truth, alignment->world_from_map.Inverse()));
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

absl::Status WritePictures(const LoadedMap& loaded, const LocalizedDrive& localized,
                           const std::optional<MapAlignment>& alignment, const Trajectory& truth,
                           const Arguments& arguments) {
  if (!arguments.picture.empty()) {
    CARMAP_RETURN_IF_ERROR(WriteMapFromAbove(loaded, localized, alignment, truth, arguments));
  }
  if (!arguments.frame_picture.empty()) {
    CARMAP_RETURN_IF_ERROR(
        WritePng(arguments.frame_picture, RenderFramePicture(localized.best_frame)));
  }
  if (!arguments.error_picture.empty()) {
    CARMAP_RETURN_IF_ERROR(
        WritePng(arguments.error_picture, DrawErrors(localized, *alignment, truth, arguments)));
  }
  return absl::OkStatus();
}

void PrintSummary(const LoadedMap& loaded, const LocalizedDrive& localized,
                  const std::optional<LocalizationError>& error) {
  fmt::print("localized     {} of {}\n", localized.localized(),
             Count(localized.trajectory.size(), "frame"));
  fmt::print("map           loaded in {:.1f} ms (read {:.1f}, decode {:.1f}, rebuild {:.1f})\n",
             loaded.read_ms + loaded.decode_ms + loaded.rebuild_ms, loaded.read_ms,
             loaded.decode_ms, loaded.rebuild_ms);
  fmt::print("frame         {} ms\n", ToText(Summarize(localized.frame_ms), 1));
  if (!error) return;
  fmt::print("position      {} m off\n", ToText(error->position_m, 3));
  fmt::print("rotation      {} deg off\n", ToText(error->rotation_deg, 3));
}

absl::StatusOr<ExitCode> RunLocalize(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  inputs.push_back(arguments.map);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.trajectory, arguments.report, arguments.picture,
                                       arguments.frame_picture, arguments.error_picture},
                                      inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive, arguments.range));
  CARMAP_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap(arguments.map, drive->rig()));
  CARMAP_ASSIGN_OR_RETURN(const std::optional<MapAlignment> alignment,
                          AlignMap(loaded.lean, *drive, arguments));

  const LocalizedDrive localized = LocalizeDrive(*drive, loaded);
  if (localized.localized() == 0) {
    return absl::NotFoundError(fmt::format(
        "{}: no frame of {} was found in {} (the first: {}); take a map of the road that it drives",
        arguments.drive, localized.trajectory.size(), arguments.map,
        localized.lost_frames.front().reason));
  }
  std::optional<LocalizationError> error;
  if (alignment) {
    error = EvaluateLocalization(localized.trajectory, drive->truth(), alignment->world_from_map);
  }

  if (!arguments.trajectory.empty()) {
    CARMAP_RETURN_IF_ERROR(WriteTrajectory(arguments.trajectory, localized.trajectory));
  }
  if (!arguments.report.empty()) {
    nlohmann::ordered_json report = ToJson(loaded, localized);
    if (error) AddErrors(*alignment, *error, report);
    CARMAP_RETURN_IF_ERROR(WriteReport(arguments.report, report));
  }
  CARMAP_RETURN_IF_ERROR(WritePictures(loaded, localized, alignment, drive->truth(), arguments));
  PrintSummary(loaded, localized, error);
  PrintLostFrames(arguments.drive, localized.lost_frames);
  return localized.unusable_frames == 0 ? kSuccess : kIncomplete;
}

}  // namespace

void AddLocalizeCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("localize", "Find each frame of a drive in a map");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  command->add_option("--map", arguments->map, "The map")->required()->type_name("MAP.cmap");
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
  command->footer(
      R"(If the drive has gps.txt and the map has GPS fixes, a frame is looked for near its fix; otherwise in
the whole map. Once found, it is followed from frame to frame.

The report's load_ms is the time to read the file, decode it, and rebuild what it leaves out;
frame_ms is from images in memory to the frame's pose.

Frames that are not found in the map are listed and do not change the exit code as long as one is
found. Frames whose images cannot be used (unreadable, black, frozen) do.

Examples:
  carmap localize kitti06_000-050 --map road.cmap --trajectory localized.txt
  carmap localize kitti06_000-050 --map road.cmap --map-truth kitti06_000-050 --report r.json

Exit codes: 0 done, 1 error or no frame found, 2 wrong usage, 3 done but without unusable images)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunLocalize(*arguments); }; });
}

}  // namespace carmap
