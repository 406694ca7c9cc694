#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/drive_localizer.h"
#include "apps/carmap/health_report.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/part_files.h"
#include "apps/carmap/patch_files.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/run_id.h"
#include "apps/carmap/segmenter_option.h"
#include "apps/carmap/time_option.h"
#include "carmap/base/exceptions.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/format/tile_codec.h"
#include "carmap/semantics/segmenter_choice.h"
#include "carmap/slam/drive_sample.h"
#include "carmap/vehicle/diff_publisher.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, base, out, patches, segmenter, report, trajectory, start_time;
  FrameRange range;
  double every_s = 10, out_limit_mb = 64;
};

/// A part as it was written.
struct WrittenPart {
  PublishedPart part;
  size_t bytes = 0;
  double made_ms = 0;  ///< from the map and what was counted to its bytes
};

struct Driven {
  DriveId id;
  LocalizedDrive localized;
  std::vector<WrittenPart> parts;
  std::vector<std::string> unwritten;  ///< why parts were not, a line each
  size_t dropped = 0;                  ///< to keep the folder small
  size_t patches_applied = 0;
  std::vector<std::string> patch_faults;
  double length_m = 0;

  size_t bytes() const {
    size_t sum = 0;
    for (const WrittenPart& part : parts) sum += part.bytes;
    return sum;
  }
};

/// Drives, and publishes as it goes.
class Vehicle {
 public:
  Vehicle(const LoadedMap& loaded, KittiDrive& drive, const RowMisalignment& misalignment,
          std::shared_ptr<Segmenter> segmenter, DriveId id, std::optional<Timestamp> unix_start,
          const Arguments& arguments)
      : frames_(drive, {.misalignment = misalignment}, /*sequential=*/false),
        localizer_(loaded, drive.rig(), frames_.front_end(), std::move(segmenter), id),
        publisher_({.every_s = arguments.every_s}),
        patches_(arguments.patches),
        files_(arguments.out, static_cast<uint64_t>(arguments.out_limit_mb * 1e6)),
        unix_start_(unix_start) {
    driven_.id = id;
  }

  /// Throws what a stage threw.
  void Drive(Progress& progress) {
    for (size_t taken = 1; const auto frame = frames_.Next(); ++taken) {
      Take(*frame);
      progress.Update(taken,
                      fmt::format("{} localized, {} published", localizer_.drive().localized(),
                                  Count(driven_.parts.size(), "part")));
    }
  }

  /// The rest of what there is to tell, and what became of the drive.
  Driven Finish(std::string failure) {
    Publish(/*is_last=*/true);
    driven_.localized = std::move(localizer_.drive());
    driven_.localized.failure = std::move(failure);
    driven_.localized.labelling = localizer_.labelling();
    driven_.localized.health = localizer_.Health();
    driven_.localized.tiles_read = localizer_.follower()->tiles_read();
    driven_.localized.damaged_tiles = localizer_.follower()->damaged();
    driven_.patches_applied = localizer_.follower()->patches_applied();
    driven_.patch_faults = patches_.Faults();
    const auto& unfit = localizer_.follower()->patch_faults();
    driven_.patch_faults.insert(driven_.patch_faults.end(), unfit.begin(), unfit.end());
    driven_.dropped = files_.dropped();
    return std::move(driven_);
  }

 private:
  void TakePatches(Timestamp now) {
    constexpr double kEveryS = 1;
    if (patches_looked_for_ && now.seconds() - patches_looked_for_->seconds() < kEveryS) return;
    patches_looked_for_ = now;
    for (Patch& patch : patches_.New()) localizer_.TakePatch(std::move(patch));
  }

  void Take(const ExtractedFrame& frame) {
    TakePatches(frame.timestamp);
    localizer_.Take(frame);
    const VehiclePose& pose = localizer_.newest();
    std::optional<DenseDisparity> disparities;
    if (frame.features && publisher_.NeedsDisparities(pose)) {
      const StereoFrontEnd& front_end = frames_.front_end();
      disparities.emplace(front_end.AtFeatureSize(frame.left),
                          front_end.RightAtFeatureSize(frame.right), front_end.rig());
    }
    publisher_.Take(frame.timestamp, {driven_.id, frame.index}, localizer_.own_frame(), pose,
                    localizer_.own_map().rig(), view(), *localizer_.map(),
                    disparities ? &*disparities : nullptr);
    if (publisher_.IsDue()) Publish(/*is_last=*/false);
  }

  void Publish(bool is_last) {
    const Stopwatch watch;
    const DriveMapper& own = localizer_.own_map();
    const LeanDrive drive{driven_.id, own.rig(), localizer_.Health().faults(), unix_start_};
    auto part = publisher_.Publish(own.map(), drive, view(), *localizer_.map(), is_last);
    if (!part) return;
    driven_.length_m += part->length_m;
    const auto bytes = EncodeDiff(part->diff, {.zstd_level = 19});
    const double made_ms = watch.ElapsedMs();
    absl::Status status = bytes.status();
    if (status.ok()) status = files_.Write(part->diff, *bytes);
    if (!status.ok()) {
      driven_.unwritten.emplace_back(status.message());
      return;
    }
    driven_.parts.push_back({*std::move(part), bytes->size(), made_ms});
  }

  const MapView& view() const { return localizer_.follower()->view(); }

  FrameExtraction frames_;
  DriveLocalizer localizer_;
  DiffPublisher publisher_;
  PatchFolder patches_;
  std::optional<Timestamp> patches_looked_for_;
  PartFiles files_;
  const std::optional<Timestamp> unix_start_;
  Driven driven_;
};

absl::StatusOr<Driven> DriveAndPublish(const LoadedMap& loaded, KittiDrive& drive,
                                       const Arguments& arguments) {
  std::optional<Timestamp> unix_start = drive.unix_start();
  if (!arguments.start_time.empty()) {
    CARMAP_ASSIGN_OR_RETURN(unix_start, ParseTime("--start-time", arguments.start_time));
  }
  CARMAP_ASSIGN_OR_RETURN(const uint64_t sequence, loaded.base->reader().Sequence());
  CARMAP_ASSIGN_OR_RETURN(const DriveId id,
                          IdOfRun(drive.id(),
                                  fmt::format("drive base {} every {} segmenter {}", sequence,
                                              arguments.every_s, arguments.segmenter),
                                  FilesOfSegmenter(arguments.segmenter, arguments.drive)));
  const PinholeCamera& camera = drive.rig().camera;
  CARMAP_ASSIGN_OR_RETURN(auto segmenter, MakeSegmenter(arguments.segmenter, arguments.drive,
                                                        {camera.width, camera.height}));
  const RowMisalignment misalignment = FindMisalignment(drive);
  Vehicle vehicle(loaded, drive, misalignment, std::move(segmenter), id, unix_start, arguments);
  Progress progress("driving", drive.size());
  const absl::Status status = CatchExceptions([&] { vehicle.Drive(progress); });
  Driven driven = vehicle.Finish(std::string(status.message()));
  driven.localized.undone = misalignment;
  return driven;
}

nlohmann::ordered_json ToJson(const WrittenPart& written) {
  const PublishedPart& part = written.part;
  return {{"part", part.diff.part},
          {"kind", part.diff.is_placed() ? "diff" : "segment"},
          {"segment_because", part.segment_because},
          {"length_m", part.length_m},
          {"keyframes", part.diff.drive.keyframes.size()},
          {"landmarks", part.diff.drive.landmarks.size()},
          {"landmarks_of_stretch", part.landmarks_of_stretch},
          {"seen", part.seen},
          {"missed", part.missed},
          {"seen_through", part.seen_through},
          {"bytes", written.bytes},
          {"made_ms", written.made_ms}};
}

nlohmann::ordered_json ReportOf(const Driven& driven) {
  const LocalizedDrive& localized = driven.localized;
  nlohmann::ordered_json report;
  report["drive"] = ToHex(driven.id);
  report["frames"] = localized.trajectory.size();
  report["known_by"] = {{"map", localized.by_map},
                        {"dead_reckoning", localized.by_dead_reckoning},
                        {"lost", localized.lost_frames.size()}};
  report["length_m"] = driven.length_m;
  report["bytes"] = driven.bytes();
  report["parts"] = nlohmann::ordered_json::array();
  for (const WrittenPart& part : driven.parts) report["parts"].push_back(ToJson(part));
  report["patches_applied"] = driven.patches_applied;
  report["patch_faults"] = driven.patch_faults;
  report["dropped_parts"] = driven.dropped;
  report["unwritten_parts"] = driven.unwritten;
  report["frame_ms"] = ToJson(Summarize(localized.frame_ms));
  report["peak_rss_mb"] = PeakMemoryMb();
  report["health"] = ToJson(localized.health, localized.gps);
  report["lost_frames"] = ToJson(localized.lost_frames);
  if (!localized.failure.empty()) report["failure"] = localized.failure;
  return report;
}

void PrintDriven(const Driven& driven, const Arguments& arguments) {
  const LocalizedDrive& localized = driven.localized;
  fmt::print("localized     {} of {}: {} by the base, {} by dead reckoning\n",
             localized.localized(), Count(localized.trajectory.size(), "frame"), localized.by_map,
             localized.by_dead_reckoning);
  for (const WrittenPart& written : driven.parts) {
    const PublishedPart& part = written.part;
    const std::string because =
        part.segment_because.empty() ? "" : fmt::format(" ({})", part.segment_because);
    fmt::print(
        "part {:<4}     {}{} of {:.0f} m: {}, {} new of {}; of the base {} seen, {} missed, "
        "{} seen through\n",
        part.diff.part, part.diff.is_placed() ? "diff" : "segment", because, part.length_m,
        BytesText(static_cast<double>(written.bytes)), part.diff.drive.landmarks.size(),
        Count(part.landmarks_of_stretch, "landmark"), part.seen, part.missed, part.seen_through);
  }
  fmt::print("published     {} in {}: {}\n", Count(driven.parts.size(), "part"), arguments.out,
             BytesText(static_cast<double>(driven.bytes())));
  if (!arguments.patches.empty()) {
    fmt::print("patches       {} applied while it drove\n", driven.patches_applied);
  }
  PrintHealth(localized.health, localized.gps);
}

bool CheckComplete(const Driven& driven, const Arguments& arguments, const OutputFiles& files) {
  const LocalizedDrive& localized = driven.localized;
  const bool is_sound = CheckSound(localized.health.suspicions, arguments.drive);
  PrintLostFrames(arguments.drive, localized.unusable_frames);
  for (const std::string& tile : localized.damaged_tiles) PrintProblem(tile);
  for (const std::string& fault : driven.patch_faults) PrintProblem(fault);
  for (const std::string& why : driven.unwritten) {
    PrintProblem(fmt::format("a part could not be published: {}", why));
  }
  if (driven.dropped > 0) {
    PrintProblem(
        fmt::format("{}: {} made way for newer ones; take parts away while it drives, or "
                    "raise --out-limit",
                    arguments.out, Count(driven.dropped, "part")));
  }
  const bool is_whole = CheckWhole(localized.failure, arguments.drive);
  const bool is_filtered = CheckLabelling(localized.labelling, arguments.segmenter,
                                          "what is published may show traffic");
  const bool is_written = files.Finish();
  return is_sound && is_whole && is_filtered && is_written && driven.unwritten.empty() &&
         driven.patch_faults.empty() && driven.dropped == 0 && localized.unusable_frames.empty() &&
         localized.damaged_tiles.empty();
}

/// Parts lie neither in the drive nor in the base, which others read.
absl::Status CheckIsApart(const std::string& out, const std::string& input) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path from_input =
      fs::weakly_canonical(out, error).lexically_relative(fs::weakly_canonical(input, error));
  if (error || from_input.empty() || *from_input.begin() == "..") return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("--out {}: lies in {}; choose a folder of its own", out, input));
}

absl::Status CheckFiles(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckIsApart(arguments.out, arguments.drive));
  CARMAP_RETURN_IF_ERROR(CheckIsApart(arguments.out, arguments.base));
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  AddFiles(FoldersOfBase(arguments.base), inputs);
  AddFiles(FilesOfSegmenter(arguments.segmenter, arguments.drive), inputs);
  return CheckOutputs({arguments.report, arguments.trajectory}, inputs);
}

absl::StatusOr<ExitCode> RunDrive(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckFiles(arguments));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive, arguments.range));
  CARMAP_ASSIGN_OR_RETURN(const LoadedMap loaded, LoadMap(arguments.base, drive->rig()));
  if (!loaded.base) {
    return absl::InvalidArgumentError(
        fmt::format("{}: is a file; --base takes the folder of a base map (`carmap base init`)",
                    arguments.base));
  }
  CARMAP_ASSIGN_OR_RETURN(const Driven driven, DriveAndPublish(loaded, *drive, arguments));
  OutputFiles files;
  files.Write(arguments.trajectory,
              [&] { return WriteTrajectory(arguments.trajectory, driven.localized.trajectory); });
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, ReportOf(driven)); });
  if (driven.parts.empty() && driven.unwritten.empty() && driven.localized.localized() == 0) {
    return absl::NotFoundError(fmt::format(
        "{}: no frame of {} was found in {}, and nothing could be mapped; take a longer "
        "drive, and see `carmap check`",
        arguments.drive, driven.localized.trajectory.size(), arguments.base));
  }
  PrintDriven(driven, arguments);
  return CheckComplete(driven, arguments, files) ? kSuccess : kIncomplete;
}

}  // namespace

void AddDriveCommand(CLI::App& app, Command& chosen) {
  CLI::App* command =
      app.add_subcommand("drive", "Drive in a base map and publish what is new in it");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  command->add_option("--base", arguments->base, "Folder of the base map")
      ->required()
      ->type_name("BASE");
  command
      ->add_option("--out", arguments->out,
                   "Folder for the parts, one file each; `carmap base add` takes them")
      ->required()
      ->type_name("FOLDER");
  command
      ->add_option("--patches", arguments->patches,
                   "Folder into which others write patches of the base (`carmap base add "
                   "--patches`): applied while it drives")
      ->type_name("FOLDER");
  command->add_option("--every", arguments->every_s, "Seconds of driving that a part tells of")
      ->check(CLI::Range(1.0, 3600.0))
      ->capture_default_str()
      ->type_name("S");
  command
      ->add_option("--out-limit", arguments->out_limit_mb,
                   "Megabytes that the parts of this drive may take together")
      ->check(CLI::Range(0.01, 1e6))
      ->capture_default_str()
      ->type_name("MB");
  command->add_option("--first", arguments->range.first, "First frame, from 0")->type_name("N");
  command->add_option("--last", arguments->range.last, "Last frame (default: the drive's)")
      ->type_name("M");
  command
      ->add_option("--start-time", arguments->start_time,
                   "When the drive began, where its times are not Unix time: 2026-11-28T04:17:55Z, "
                   "or seconds since 1970")
      ->type_name("TIME");
  command
      ->add_option("--trajectory", arguments->trajectory,
                   "Write the pose of each frame in the frame of the first tile, metres: TUM form "
                   "if named *.tum, else KITTI form")
      ->type_name("T.txt");
  command
      ->add_option("--report", arguments->report,
                   "Write what was published, sizes (bytes), lengths (m) and times (ms) as JSON")
      ->type_name("R.json");
  AddSegmenterOption(*command, arguments->segmenter);
  command->footer(fmt::format(
      R"(The vehicle localizes in BASE as `carmap localize` does and maps at once. Every --every seconds it
publishes a part:

  diff      on road that the base has: landmarks of things that the base has not, and which of the
            base's landmarks were seen, and which missed although nothing hid them
  segment   on road that it has not: all landmarks, with some of the road before

Landmarks that one keyframe alone saw are not published; with a segmenter, those of vehicles and persons
are not either. A vehicle that stands publishes nothing. BASE is read as it was when the
drive began, and not changed: `carmap base add BASE FOLDER/*{}` does that.

If nothing takes the parts away and they exceed --out-limit, the oldest without landmarks are removed
first, and a line says how many.

{}

Example:
  carmap drive monday --base town --out parts
  carmap base add town parts/*{}

Exit codes: 0 done, 1 error, or nothing was found or published, 2 wrong usage, 3 done but without unusable images, damaged tiles or patches,
parts were dropped or could not be written, the drive is suspect, or the segmenter failed)",
      kDiffExtension, kSegmenterHelp, kDiffExtension));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunDrive(*arguments); }; });
}

}  // namespace carmap
