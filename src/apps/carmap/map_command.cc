#include <fmt/format.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/health_report.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/run_id.h"
#include "apps/carmap/segmenter_option.h"
#include "apps/carmap/time_option.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/camera_replay.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/dataset/world_frame.h"
#include "carmap/eval/full_map.h"
#include "carmap/eval/georeferenced_error.h"
#include "carmap/eval/map_composition.h"
#include "carmap/eval/trajectory_metrics.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/feature/vocabulary_file.h"
#include "carmap/format/lean_codec.h"
#include "carmap/map/strip.h"
#include "carmap/semantics/segmenter_choice.h"
#include "carmap/slam/drive_sample.h"
#include "carmap/slam/map_drive.h"
#include "carmap/solve/alignment.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, out, full_map, vocabulary, segmenter, trajectory, report, picture, start_time;
  FrameRange range;
  std::optional<double> replay_hz;
  size_t segment_every = 1;
  bool sequential = false, no_loops = false;
};

/// What a run made, and what it took to make it.
struct Run {
  DriveId id;
  RowMisalignment undone;  ///< of the right images
  MappedDrive mapped;
  StrippedMap stripped;
  bool has_map = false;  ///< that it is written
  size_t lean_bytes = 0;
  double path_length_m = 0;
  double wall_s = 0;
  std::optional<TrajectoryEvaluation> evaluation;
  std::optional<Summary> georeferenced_error_m;
  size_t dropped_frames = 0;  ///< in a replay
};

absl::StatusOr<MappedDrive> MapWithProgress(FrameSource& drive, DriveId id,
                                            const Arguments& arguments,
                                            const RowMisalignment& misalignment) {
  MapDriveOptions options;
  const PinholeCamera& camera = drive.rig().camera;
  CARMAP_ASSIGN_OR_RETURN(options.segmenter, MakeSegmenter(arguments.segmenter, arguments.drive,
                                                           {camera.width, camera.height}));
  options.front_end.misalignment = misalignment;
  options.labelling.every = arguments.segment_every;
  options.labelling.real_time = arguments.replay_hz.has_value();
  options.sequential = arguments.sequential;
  options.loops.close_loops = !arguments.no_loops;
  if (arguments.vocabulary.empty()) {
    options.vocabulary = {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()};
  } else {
    CARMAP_ASSIGN_OR_RETURN(Vocabulary vocabulary, ReadVocabulary(arguments.vocabulary));
    options.vocabulary = std::make_shared<const Vocabulary>(std::move(vocabulary));
  }
  Progress progress("mapping", drive.frame_count().value_or(0));
  auto mapped = MapDrive(drive, id, options, [&](size_t frames, size_t keyframes) {
    progress.Update(frames, Count(keyframes, "keyframe"));
  });
  if (!mapped.ok()) return WithName(arguments.drive, mapped.status());
  return mapped;
}

/// Where the drive says where on the Earth its truth is, and its fixes told where the map is.
std::optional<Summary> GeoreferencedError(const MappedDrive& mapped, const Trajectory& truth,
                                          const std::optional<GpsFix>& truth_origin) {
  if (!mapped.georeference || truth.empty() || !truth_origin) return std::nullopt;
  const auto& [origin, enu_from_map] = *mapped.georeference;
  const auto errors_m =
      GeoreferencedErrorsM(mapped.trajectory, enu_from_map, origin, truth, *truth_origin);
  if (!errors_m.ok()) return std::nullopt;
  return Summarize(*errors_m);
}

/// The input's and that of all that changes the result; with a replay, which no other run repeats,
/// its own.
absl::StatusOr<DriveId> IdOfRun(const DriveId& drive, const Arguments& arguments) {
  if (arguments.replay_hz) {
    std::random_device random;
    return DriveId{drive.input, (uint64_t{random()} << 32) | random()};
  }
  std::vector<std::string> files = FilesOfSegmenter(arguments.segmenter, arguments.drive);
  if (!arguments.vocabulary.empty()) files.push_back(arguments.vocabulary);
  return IdOfRun(drive,
                 fmt::format("loops {} segmenter {} every {}", !arguments.no_loops,
                             arguments.segmenter, arguments.segment_every),
                 files);
}

/// As fast as it goes, or as a camera gives frames.
absl::Status MapFrames(KittiDrive& drive, const Arguments& arguments, Run& run) {
  CARMAP_ASSIGN_OR_RETURN(run.id, IdOfRun(drive.id(), arguments));
  run.undone = FindMisalignment(drive);
  if (!arguments.replay_hz) {
    CARMAP_ASSIGN_OR_RETURN(run.mapped, MapWithProgress(drive, run.id, arguments, run.undone));
    return absl::OkStatus();
  }
  CameraReplay replay(drive, {.rate_hz = *arguments.replay_hz});
  CARMAP_ASSIGN_OR_RETURN(run.mapped, MapWithProgress(replay, run.id, arguments, run.undone));
  run.dropped_frames = replay.dropped_count();
  return absl::OkStatus();
}

/// A map that nobody can be localized by replaces none that was made before.
absl::Status CheckHoldsLandmarks(const Run& run, const std::string& drive) {
  if (!run.stripped.lean.landmarks.empty()) return absl::OkStatus();
  if (const auto& suspicions = run.mapped.health.suspicions; !suspicions.empty()) {
    return absl::FailedPreconditionError(fmt::format("{}: the map is empty: {}; {}", drive,
                                                     suspicions.front().finding,
                                                     suspicions.front().remedy));
  }
  return absl::FailedPreconditionError(fmt::format(
      "{}: the map is empty: no landmark was seen by {} keyframes; map more of the drive", drive,
      StripOptions().min_observations));
}

absl::Status WriteMap(const Arguments& arguments, Run& run) {
  const auto bytes = EncodeLeanMap(run.stripped.lean);
  if (!bytes.ok()) return WithName(arguments.out, bytes.status());
  run.lean_bytes = bytes->size();
  CARMAP_RETURN_IF_ERROR(CheckHoldsLandmarks(run, arguments.drive));
  return WriteFileAtomically(arguments.out, *bytes);
}

absl::Status WriteFullMap(const Run& run, const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckHoldsLandmarks(run, arguments.drive));
  return WriteFileAtomically(arguments.full_map,
                             EncodeFullMap(FullMapOf(run.mapped.map, {run.id, run.mapped.rig})));
}

/// Maps the drive and writes the map: what the reported time and memory are of.
absl::StatusOr<Run> MapAndWrite(KittiDrive& drive, const Arguments& arguments,
                                const Stopwatch& watch, OutputFiles& files) {
  Run run;
  std::optional<GpsFix> truth_origin;
  std::optional<Timestamp> unix_start = drive.unix_start();
  if (!arguments.start_time.empty()) {
    CARMAP_ASSIGN_OR_RETURN(unix_start, ParseTime("--start-time", arguments.start_time));
  }
  if (!drive.truth().empty()) {
    CARMAP_ASSIGN_OR_RETURN(truth_origin, ReadWorldOrigin(arguments.drive));
  }
  CARMAP_RETURN_IF_ERROR(MapFrames(drive, arguments, run));
  run.stripped =
      Strip(run.mapped.map, {run.id, run.mapped.rig, run.mapped.health.faults(), unix_start});
  if (run.mapped.georeference) ReplaceFixes(*run.mapped.georeference, run.stripped.lean);
  run.has_map = files.Write(arguments.out, [&] { return WriteMap(arguments, run); });
  run.wall_s = watch.ElapsedMs() * 1e-3;
  run.path_length_m = PathLengthM(run.mapped.trajectory);
  if (drive.truth().empty()) return run;
  // Of a range of which no frame has both poses there is nothing to evaluate.
  if (auto evaluation = EvaluateTrajectory(run.mapped.trajectory, drive.truth()); evaluation.ok()) {
    run.evaluation = *std::move(evaluation);
  }
  run.georeferenced_error_m = GeoreferencedError(run.mapped, drive.truth(), truth_origin);
  return run;
}

nlohmann::ordered_json MeanStageMs(const Run& run, size_t frames) {
  nlohmann::ordered_json stages;
  for (const auto& [stage, total_ms] : run.mapped.stage_ms) {
    stages[stage] = total_ms / static_cast<double>(frames);
  }
  return stages;
}

nlohmann::ordered_json ToJson(const std::vector<Loop>& loops, size_t rejected_keyframes) {
  nlohmann::ordered_json json = {{"closed", nlohmann::ordered_json::array()},
                                 {"rejected_keyframes", rejected_keyframes}};
  for (const Loop& loop : loops) {
    json["closed"].push_back({{"index", loop.back().keyframe_id.index},
                              {"place_index", loop.back().place_id.index},
                              {"keyframes", loop.size()}});
  }
  return json;
}

nlohmann::ordered_json ToJson(const Map& map, const Georeference& georeference) {
  const GpsFix& origin = georeference.origin;
  return {{"origin",
           {{"latitude_deg", origin.latitude_deg},
            {"longitude_deg", origin.longitude_deg},
            {"altitude_m", origin.altitude_m}}},
          {"fix_error_m", ToJson(Summarize(FixErrorsM(map, georeference)))}};
}

size_t NonStaticCount(const Map& map) {
  size_t count = 0;
  for (const auto& [id, landmark] : map.landmarks()) count += landmark.is_non_static();
  return count;
}

nlohmann::ordered_json ToJson(const LabellingSummary& labelling, const Map& map) {
  return {{"keyframes", labelling.keyframes},
          {"labelled", labelling.labelled},
          {"landmarks", map.landmarks().size()},
          {"non_static_landmarks", NonStaticCount(map)},
          {"failure", labelling.failure}};
}

void AddErrors(const TrajectoryEvaluation& evaluation, nlohmann::ordered_json& report) {
  nlohmann::ordered_json errors = ToJson(evaluation);
  for (const char* key : {"matched_frames", "lost_frames", "path_length_m"}) errors.erase(key);
  report.update(errors);
}

nlohmann::ordered_json ToJson(const Run& run, size_t frames, const Arguments& arguments,
                              const CompositionBytes& composition) {
  const LeanMap& lean = run.stripped.lean;
  const double bytes = static_cast<double>(run.lean_bytes);
  const Eigen::Vector3d& bias = run.mapped.rig.disparity_bias.coefficients_px;
  nlohmann::ordered_json report;
  report["frames"] = frames;
  report["tracked_frames"] = run.mapped.tracked_frames();
  report["keyframes"] = lean.keyframes.size();
  report["landmarks"] = lean.landmarks.size();
  report["observations"] = ObservationCount(lean);
  report["lean_bytes"] = run.lean_bytes;
  report["bytes_per_landmark"] = Ratio(bytes, static_cast<double>(lean.landmarks.size()));
  report["path_length_m"] = run.path_length_m;
  report["lean_mb_per_km"] = Ratio(bytes * 1e-6, run.path_length_m * 1e-3);
  report["wall_s"] = run.wall_s;
  report["peak_rss_mb"] = PeakMemoryMb();
  report["frame_ms"] = ToJson(Summarize(run.mapped.frame_ms));
  report["stage_ms"] = MeanStageMs(run, frames);
  report["left_out_edits"] = run.mapped.left_out;
  if (run.mapped.labelling) report["labelling"] = ToJson(*run.mapped.labelling, run.mapped.map);
  if (arguments.replay_hz) {
    report["replay"] = {{"rate_hz", *arguments.replay_hz}, {"dropped_frames", run.dropped_frames}};
  }
  report["composition_bytes"] = {{"full", composition.full},
                                 {"no_index", composition.no_index},
                                 {"no_keyframe_features", composition.no_keyframe_features},
                                 {"lean", composition.lean}};
  report["disparity_bias_px"] = {bias.x(), bias.y(), bias.z()};
  report["health"] = ToJson(run.mapped.health, run.mapped.gps);
  report["misalignment_undone"] = ToJson(run.undone);
  report["lost_frames"] = ToJson(run.mapped.lost_frames);
  if (!run.mapped.failure.empty()) report["failure"] = run.mapped.failure;
  for (const MapPart& part : run.mapped.parts) {
    report["parts"].push_back({{"first_index", part.first_index}, {"keyframes", part.keyframes}});
  }
  report["loops"] = ToJson(run.mapped.loops, run.mapped.rejected_loop_keyframes);
  if (run.mapped.georeference) {
    report["georeference"] = ToJson(run.mapped.map, *run.mapped.georeference);
  }
  if (run.evaluation) AddErrors(*run.evaluation, report);
  if (run.georeferenced_error_m) {
    report["georeferenced_error_m"] = ToJson(*run.georeferenced_error_m);
  }
  return report;
}

/// Truth moved to where it fits the trajectory; nothing where both have too few poses.
std::optional<Rigid3> MapFromWorld(const Trajectory& trajectory, const Trajectory& truth) {
  std::vector<Rigid3> in_map, in_world;
  for (size_t i = 0; i < std::min(trajectory.size(), truth.size()); ++i) {
    if (!trajectory[i].world_from_camera || !truth[i].world_from_camera) continue;
    in_map.push_back(*trajectory[i].world_from_camera);
    in_world.push_back(*truth[i].world_from_camera);
  }
  return AlignTrajectories(in_world, in_map);
}

absl::Status WritePicture(const Run& run, const Trajectory& truth, const Arguments& arguments) {
  const Trajectory& trajectory = run.mapped.trajectory;
  std::vector<PicturePath> paths;
  if (const auto map_from_world = MapFromWorld(trajectory, truth)) {
    paths.push_back(PathOf("ground truth", kTruthColour, truth, *map_from_world));
  }
  paths.push_back(PathOf("trajectory", kEstimateColour, trajectory));
  return WriteMapPicture(arguments.picture,
                         PictureOf(run.stripped.lean, "Map of " + NameOf(arguments.drive), paths));
}

void PrintSummary(const Run& run, size_t frames, const Arguments& arguments) {
  const LeanMap& lean = run.stripped.lean;
  const double bytes = static_cast<double>(run.lean_bytes);
  fmt::print("mapped        {} of {}, {:.1f} m, in {:.1f} s\n", run.mapped.tracked_frames(),
             Count(frames, "frame"), run.path_length_m, run.wall_s);
  fmt::print("frame         {} ms\n", ToText(Summarize(run.mapped.frame_ms), 1));
  if (arguments.replay_hz) {
    fmt::print("replay        at {} Hz, {} dropped\n", *arguments.replay_hz,
               Count(run.dropped_frames, "frame"));
  }
  if (run.has_map) {
    fmt::print("map           {}, {}, {}, {}\n", arguments.out, BytesText(bytes),
               Count(lean.keyframes.size(), "keyframe"), Count(lean.landmarks.size(), "landmark"));
  }
  if (const auto& labelling = run.mapped.labelling) {
    fmt::print("segmented     {} of {}, {} of {} non-static\n", labelling->labelled,
               Count(labelling->keyframes, "keyframe"), NonStaticCount(run.mapped.map),
               Count(run.mapped.map.landmarks().size(), "landmark"));
  }
  if (!run.mapped.loops.empty()) {
    fmt::print("loops         {}\n", Count(run.mapped.loops.size(), "loop"));
  }
  if (run.mapped.georeference) {
    const auto errors_m = FixErrorsM(run.mapped.map, *run.mapped.georeference);
    fmt::print("georeference  fixes are {:.2f} m off in the median\n", Summarize(errors_m).median);
  }
  if (run.mapped.parts.size() > 1) {
    fmt::print("parts         {}, that only the vehicle's speed connects\n",
               run.mapped.parts.size());
  }
  PrintUndone(run.undone);
  PrintHealth(run.mapped.health, run.mapped.gps);
  if (!run.evaluation) return;
  if (run.evaluation->ate) {
    fmt::print("ground truth  absolute error {:.3f} m (RMSE)", run.evaluation->ate->rmse_m);
    if (const auto& relative = run.evaluation->relative()) {
      fmt::print(", relative {:.2f} % and {:.2f} deg/100 m", relative->t_rel_percent,
                 relative->r_rel_deg_per_100m);
    }
    fmt::print("\n");
  }
}

absl::Status WriteReportOf(const Run& run, size_t frames, const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const CompositionBytes composition,
                          MeasureComposition(run.mapped.map, run.stripped));
  return WriteReport(arguments.report, ToJson(run, frames, arguments, composition));
}

/// What was asked for besides the map.
void WriteOthers(const Run& run, const KittiDrive& drive, const Arguments& arguments,
                 OutputFiles& files) {
  files.Write(arguments.full_map, [&] { return WriteFullMap(run, arguments); });
  files.Write(arguments.trajectory,
              [&] { return WriteTrajectory(arguments.trajectory, run.mapped.trajectory); });
  files.Write(arguments.picture, [&] { return WritePicture(run, drive.truth(), arguments); });
  // Last, as its peak of memory is that of all of the work.
  files.Write(arguments.report, [&] { return WriteReportOf(run, drive.size(), arguments); });
}

/// Whether nothing of what was asked for is missing; says on standard error what is.
bool CheckComplete(const Run& run, const Arguments& arguments, const OutputFiles& files) {
  const bool is_sound = CheckSound(run.mapped.health.suspicions, arguments.drive);
  const bool agrees_with_gps = CheckGps(run.mapped.gps, arguments.drive);
  PrintLostFrames(arguments.drive, run.mapped.lost_frames);
  const bool is_whole = CheckWhole(run.mapped.failure, arguments.drive);
  const bool is_filtered = CheckLabelling(run.mapped.labelling, arguments.segmenter,
                                          "the map may hold what was parked or moved");
  const bool is_written = files.Finish();
  return is_whole && is_filtered && is_sound && agrees_with_gps && is_written &&
         run.mapped.lost_frames.empty();
}

absl::StatusOr<ExitCode> RunMap(const Arguments& arguments) {
  const Stopwatch watch;
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  if (!arguments.vocabulary.empty()) inputs.push_back(arguments.vocabulary);
  AddFiles(FilesOfSegmenter(arguments.segmenter, arguments.drive), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.out, arguments.full_map, arguments.trajectory,
                                       arguments.report, arguments.picture},
                                      inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive, arguments.range));
  OutputFiles files;
  CARMAP_ASSIGN_OR_RETURN(const Run run, MapAndWrite(*drive, arguments, watch, files));
  WriteOthers(run, *drive, arguments, files);
  PrintSummary(run, drive->size(), arguments);
  const bool is_complete = CheckComplete(run, arguments, files);
  return !run.has_map ? kError : is_complete ? kSuccess : kIncomplete;
}

}  // namespace

void AddMapCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("map", "Make a lean map of a drive");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("DRIVE", arguments->drive, "Folder of the drive")->required();
  command->add_option("--out", arguments->out, "The map to write")
      ->required()
      ->type_name("SEGMENT.cmap");
  command->add_option("--first", arguments->range.first, "First frame to map, from 0")
      ->type_name("N");
  command->add_option("--last", arguments->range.last, "Last frame to map (default: the drive's)")
      ->type_name("M");
  command->add_flag("--sequential", arguments->sequential,
                    "Work on one stage at a time. The same drive gives the same map, byte by byte, "
                    "with this and without, unless --replay drops frames");
  command
      ->add_option("--replay", arguments->replay_hz,
                   "Feed frames at this rate, as a camera would, to see whether the machine keeps "
                   "up: it holds three; what comes beyond is dropped")
      ->check(CLI::Range(0.1, 1000.0))
      ->type_name("HZ");
  command
      ->add_option("--start-time", arguments->start_time,
                   "When the drive's clock showed 0, for maps that live long: "
                   "2026-11-28T04:17:55Z, or seconds since 1970 (default: known where times.txt is "
                   "in Unix time)")
      ->type_name("TIME");
  command->add_flag("--no-loops", arguments->no_loops,
                    "Leave loops open, to see how far the vehicle drifts");
  command
      ->add_option(
          "--vocabulary", arguments->vocabulary,
          "Recognize places by this vocabulary's words (default: the one that comes with the "
          "program)")
      ->type_name("V.cmvoc");
  AddSegmenterOption(*command, arguments->segmenter);
  command
      ->add_option("--segment-every", arguments->segment_every,
                   "Segment every n-th keyframe alone. With --replay the segmenter never holds the "
                   "drive up: keyframes that come while it is busy stay unlabelled")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str()
      ->type_name("N");
  command
      ->add_option("--full-map", arguments->full_map,
                   "Write the map with all features of its keyframes too, for `carmap evaluate "
                   "appearance`")
      ->type_name("F.cfull");
  command
      ->add_option("--trajectory", arguments->trajectory,
                   "Write the pose of each frame in the map's frame, metres: TUM form if named "
                   "*.tum, else KITTI form")
      ->type_name("T.txt");
  command
      ->add_option("--report", arguments->report,
                   "Write counts, sizes (bytes), times (ms), and errors against the drive's "
                   "poses.txt (m, %, deg) as JSON")
      ->type_name("R.json");
  command
      ->add_option("--picture", arguments->picture,
                   "Draw landmarks, trajectory and truth from above")
      ->type_name("P.png");
  command->footer(fmt::format(
      R"(The map's frame is the left camera of the first frame: x right, y down, z forward, metres.

The report's frame_ms is from images in memory to the frame's pose; stage_ms is the mean per frame
of each stage (reading, tracking and mapping overlap unless --sequential); wall_s is up to the written
map, peak_rss_mb (10^6 bytes) of all of it; composition_bytes compares the map with what it would take
with its index and the features of its keyframes.

A frame that cannot be read or tracked is left out: a line says which and why, the map holds the
rest, and the exit code is 3. The map is written first; a file besides it that cannot be written
costs no other, and lines say which were written and which not. A map without a landmark is not
written, and replaces none. Where the vehicle was blind for long and what it saw after is not in
the map, a new part of the map begins, put where its speed led to; the report lists the parts.

The line and the report's object `health` tell what the drive shows of its own soundness: whether
rows of the two images meet, whether they are of one moment (every tenth pair is looked at, as by
`carmap check`), the share of features with depth and of landmarks nearer than 40 baselines, and the
largest acceleration. What contradicts a sound rig or a vehicle is named with its remedy and listed
under `suspect`; the map says so too (`carmap info`), and `stitch` takes no suspect drive unless told
to. A right camera that is turned by less than 0.7 degrees is straightened by what the images show.

With a segmenter the map holds only what stays (the paper's dynamic object filter): each keyframe
votes on the landmarks that it sees, its labels coming two keyframes late, and what two in three call
non-static holds no pose and is left out of the map.

{}

Where the drive comes back to a place the loop is closed, and the whole map adjusted. If the drive
has gps.txt its fixes hold the map too, and each keyframe gets the place on Earth that all of them
together tell; the report's georeference.fix_error_m is how far single fixes are from there, and
georeferenced_error_m, of drives with a world.json, how far the frames are from their true places;
both are horizontal.

Examples:
  carmap map kitti06_000-050 --out road.cmap
  carmap map kitti06_000-050 --first 18 --last 50 --out part.cmap --report part.json

Exit codes: 0 done, 1 error (no map is written, unless only standard output cannot be), 2 wrong
usage, 3 map written but frames were lost, the drive is suspect or its GPS contradicts it, the segmenter failed, or another
file could not be written)",
      kSegmenterHelp));
  command->callback([arguments, &chosen] { chosen = [arguments] { return RunMap(*arguments); }; });
}

}  // namespace carmap
