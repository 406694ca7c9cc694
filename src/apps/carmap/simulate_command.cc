#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/sim/drive_folder.h"
#include "carmap/sim/simulation.h"

namespace carmap {
namespace {

template <typename Enum>
using Names = std::map<std::string, Enum>;

const Names<Scene> kScenes = {
    {"suburb", Scene::kSuburb}, {"downtown", Scene::kDowntown}, {"freeway", Scene::kFreeway}};
const Names<RouteShape> kShapes = {{"straight", RouteShape::kStraight},
                                   {"curves", RouteShape::kCurves},
                                   {"block", RouteShape::kBlock}};
const Names<TrafficDensity> kTraffic = {{"none", TrafficDensity::kNone},
                                        {"parked", TrafficDensity::kParked},
                                        {"moving", TrafficDensity::kMoving},
                                        {"dense", TrafficDensity::kDense}};
const Names<Weather> kWeather = {
    {"sunny", Weather::kSunny}, {"overcast", Weather::kOvercast}, {"low-sun", Weather::kLowSun}};
const Names<GpsQuality> kGps = {{"open", GpsQuality::kOpen}, {"urban", GpsQuality::kUrban}};

/// The words of the command line; what they mean is looked up in the tables above.
struct Arguments {
  std::string out, scene, path, change;
  std::string traffic = "parked", light = "sunny", gps = "open", size = "1241x376";
  std::optional<uint64_t> change_seed;
  WorldOptions world;
  DriveOptions drive;
  TruthImages truths;
};

/// Where the road goes: one of the shapes, or along the poses of a file.
struct RoadPath {
  RouteShape shape = RouteShape::kCurves;
  std::optional<Trajectory> recorded;
  std::string description;  ///< by which world.json knows it
};

std::string UsualShape(Scene scene) {
  return scene == Scene::kDowntown ? "block" : scene == Scene::kFreeway ? "straight" : "curves";
}

absl::StatusOr<RoadPath> ReadPath(const std::string& word, Scene scene) {
  const std::string path = word.empty() ? UsualShape(scene) : word;
  if (const auto shape = kShapes.find(path); shape != kShapes.end()) {
    return RoadPath{shape->second, std::nullopt, path};
  }
  CARMAP_ASSIGN_OR_RETURN(Trajectory poses, ReadTrajectory(path));
  const Rigid3 last = poses.back().world_from_camera.value_or(Rigid3());
  const std::string description =
      fmt::format("{} with {} poses, the last at {:.3f} {:.3f} {:.3f}", NameOf(path), poses.size(),
                  last.translation.x(), last.translation.y(), last.translation.z());
  return RoadPath{RouteShape::kCurves, std::move(poses), description};
}

absl::StatusOr<std::vector<Change>> ReadChanges(const Arguments& arguments,
                                                const WorldOptions& world, const RoadPath& path) {
  constexpr uint64_t kMaxChangeBytes = 1 << 24;
  if (arguments.change_seed) return DrawChangesOf(world, path.recorded, *arguments.change_seed);
  if (arguments.change.empty()) return std::vector<Change>{};
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(arguments.change, kMaxChangeBytes));
  auto changes = ChangesFromJson(text);
  if (!changes.ok()) {
    return absl::InvalidArgumentError(
        fmt::format("{}: {}; correct it, or take the world.json of a drive made with --change-seed",
                    arguments.change, std::string(changes.status().message())));
  }
  return changes;
}

/// "WIDTHxHEIGHT" in pixels.
absl::Status ParseSize(const std::string& text, DriveOptions& drive) {
  int read = 0;
  if (std::sscanf(text.c_str(), "%5dx%5d%n", &drive.width, &drive.height, &read) == 2 &&
      static_cast<size_t>(read) == text.size()) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      fmt::format("--size {}: is not WIDTHxHEIGHT in pixels; write it as in 1241x376", text));
}

/// All that the drive's bytes follow from.
nlohmann::ordered_json OptionsJson(const Arguments& arguments, const WorldOptions& world,
                                   const DriveOptions& drive, const RoadPath& path,
                                   const std::vector<Change>& changes) {
  nlohmann::ordered_json json;
  json["scene"] = arguments.scene;
  json["path"] = path.description;
  if (!path.recorded) json["length_m"] = world.length_m;
  json["seed"] = world.seed;
  json["size"] = {drive.width, drive.height};
  json["frames"] = drive.frames ? nlohmann::ordered_json(*drive.frames) : nullptr;
  json["lane"] = drive.lane;
  json["speed_mps"] = drive.speed_mps ? nlohmann::ordered_json(*drive.speed_mps) : nullptr;
  json["reverse"] = drive.reverse;
  json["traffic"] = arguments.traffic;
  json["traffic_seed"] = drive.traffic_seed;
  json["light"] = arguments.light;
  json["light_seed"] = drive.light_seed;
  json["rig_seed"] = drive.rig_seed;
  json["gps"] = arguments.gps;
  json["gps_hz"] = drive.gps_rate_hz;
  json["changes"] = ToJson(changes).at("changes");
  return json;
}

absl::StatusOr<ExitCode> RunSimulate(const Arguments& arguments) {
  const Stopwatch watch;
  WorldOptions world = arguments.world;
  DriveOptions drive = arguments.drive;
  world.scene = kScenes.at(arguments.scene);
  drive.traffic = kTraffic.at(arguments.traffic);
  drive.weather = kWeather.at(arguments.light);
  drive.gps = kGps.at(arguments.gps);
  CARMAP_RETURN_IF_ERROR(ParseSize(arguments.size, drive));
  for (const std::string& file : FilesOfDrive(arguments.out)) {
    CARMAP_RETURN_IF_ERROR(CheckKeepsInputs(file, {arguments.path, arguments.change}));
  }
  auto path = ReadPath(arguments.path, world.scene);
  if (!path.ok()) {
    return WithName("--path (straight, curves, block or a file of poses)", path.status());
  }
  world.shape = path->shape;
  CARMAP_ASSIGN_OR_RETURN(const auto changes, ReadChanges(arguments, world, *path));
  const auto options = OptionsJson(arguments, world, drive, *path, changes);
  CARMAP_RETURN_IF_ERROR(CheckDriveFolder(arguments.out, options));

  auto simulation = Simulation::Create(world, drive, path->recorded, changes);
  if (!simulation.ok()) {
    return path->recorded ? WithName(arguments.path, simulation.status()) : simulation.status();
  }
  const double build_s = watch.ElapsedMs() * 1e-3;
  const size_t frames = (*simulation)->frame_count();
  fmt::print("world         {}, {:.0f} m of road, built in {:.1f} s\n", arguments.scene,
             (*simulation)->route().length_m(), build_s);
  WrittenDrive written;
  {
    Progress progress("simulating", frames);
    CARMAP_ASSIGN_OR_RETURN(
        written, WriteDrive(arguments.out, options, changes, arguments.truths, **simulation,
                            [&](size_t done) { progress.Update(done); }));
  }
  const double render_s = watch.ElapsedMs() * 1e-3 - build_s;
  const size_t rendered = written.frames - written.found_frames;
  fmt::print("drive         {}, {}, {:.1f} m\n", arguments.out, Count(frames, "frame"),
             PathLengthM((*simulation)->enu_from_camera()));
  if (written.found_frames > 0) {
    fmt::print("found         {} of them were there already\n", written.found_frames);
  }
  if (rendered > 0) {
    fmt::print("rendered      {:.2f} s a stereo frame\n", render_s / static_cast<double>(rendered));
  }
  if (!changes.empty()) {
    fmt::print("changes       {}; see {}/world.json\n", changes.size(), arguments.out);
  }
  fmt::print("memory        {:.0f} MB at most\n", PeakMemoryMb());
  return kSuccess;
}

/// "suburb 0 to 1, in reverse 0 to 1; …"
std::string LanesText() {
  std::vector<std::string> scenes;
  for (const auto& [name, scene] : kScenes) {
    const LaneRange lanes = LanesOf(scene, false), in_reverse = LanesOf(scene, true);
    scenes.push_back(fmt::format("{} {} to {}, in reverse {} to {}", name, lanes.first, lanes.last,
                                 in_reverse.first, in_reverse.last));
  }
  return fmt::format("{}", fmt::join(scenes, "; "));
}

template <typename Enum>
CLI::IsMember OneOf(const Names<Enum>& names) {
  std::vector<std::string> words;
  for (const auto& [word, value] : names) words.push_back(word);
  return CLI::IsMember(words);
}

}  // namespace

void AddSimulateCommand(CLI::App& app, Command& chosen) {
  CLI::App* command =
      app.add_subcommand("simulate", "Make a stereo drive with ground truth in a simulated town");
  const auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  command->add_option("--out", a.out, "Folder of the drive; an interrupted run is continued")
      ->required()
      ->type_name("DRIVE");
  command
      ->add_option(
          "--scene", a.scene,
          "suburb: 2 lanes, gardens, parked cars; downtown: 2 lanes, shops, parked cars on "
          "both sides; freeway: 4 lanes a direction")
      ->required()
      ->check(OneOf(kScenes))
      ->type_name("SCENE");

  command
      ->add_option("--path", a.path,
                   "Where the road goes: straight, curves, block (a closed loop), or along a file "
                   "of poses in KITTI form (default: suburb curves, downtown block, freeway "
                   "straight)")
      ->type_name("PATH");
  command->add_option("--length", a.world.length_m, "Metres of road, unless along a file (1000)")
      ->type_name("M");
  command->add_option("--seed", a.world.seed, "Draws the town (1)")->type_name("N");
  command
      ->add_option("--change", a.change,
                   "Remove and add what this file lists: world.json of a drive with changes, or "
                   "one like it")
      ->type_name("FILE");
  command->add_option("--change-seed", a.change_seed, "Draw such changes")
      ->excludes("--change")
      ->type_name("N");

  command
      ->add_option("--frames", a.drive.frames,
                   "Stop after so many (default: at the end of the road, or after one lap)")
      ->type_name("N");
  command->add_option("--size", a.size, "Image size in pixels (1241x376)")->type_name("WxH");
  command
      ->add_option("--lane", a.drive.lane,
                   "Lanes to the left of the usual one (0); negative: to the right. " + LanesText())
      ->type_name("N");
  command
      ->add_option("--speed", a.drive.speed_mps,
                   "Metres a second, less in curves (default: the scene's, or as recorded)")
      ->type_name("V");
  command->add_flag("--reverse", a.drive.reverse, "Drive from the end of the road to its start");

  command
      ->add_option("--traffic", a.traffic,
                   "none, parked, moving (parked too) or dense (others often hide most of the "
                   "view) (parked)")
      ->check(OneOf(kTraffic))
      ->type_name("T");
  command->add_option("--traffic-seed", a.drive.traffic_seed, "Draws who is on the road (1)")
      ->type_name("N");
  command->add_option("--light", a.light, "sunny, overcast or low-sun (sunny)")
      ->check(OneOf(kWeather))
      ->type_name("L");
  command->add_option("--light-seed", a.drive.light_seed, "Draws the sun's place and clouds (1)")
      ->type_name("N");
  command
      ->add_option(
          "--rig-seed", a.drive.rig_seed,
          "Draws what calibration left of the cameras' faults, some tenths of a pixel (1); "
          "0: perfect cameras")
      ->type_name("N");
  command
      ->add_option("--gps", a.gps,
                   "open: good reception; urban: with jumps to 30-50 m between houses (open)")
      ->check(OneOf(kGps))
      ->type_name("G");
  command->add_option("--gps-hz", a.drive.gps_rate_hz, "Fixes a second, 1 to 10 (10)")
      ->type_name("F");

  command->add_flag("--labels", a.truths.labels,
                    "Write each pixel's class: labels/ and labels_right/, Cityscapes train ids");
  command->add_flag("--instances", a.truths.instances,
                    "Write each pixel's vehicle or person: instances/ and instances_right/; 0 "
                    "static, from 10000 parked, from 20000 moving");
  command->add_flag("--depth", a.truths.depth,
                    "Write each pixel's depth: depth/ and depth_right/, metres times 256, 0 none");
  command->footer(
      R"(The drive is a folder in KITTI's layout with poses.txt (truth: the left camera in the world's
frame, x east, y north, z up) and gps.txt; world.json tells options, frame, models of light, sensors
and GPS, and what was changed. Drives with the same scene, path, length and seed are of one world
and share its frame.

The same options give the same bytes on one kind of processor. Frames are written as they
are rendered; run the same command again to continue after an interruption. A folder that holds
anything else is left untouched.

Examples:
  carmap simulate --out empty --scene suburb --traffic none --frames 100
  carmap simulate --out busy --scene suburb --traffic dense --traffic-seed 5 --lane 1 --frames 100
  carmap simulate --out later --scene suburb --change-seed 3 --frames 100
  carmap simulate --out loop --scene suburb --path kitti_poses/poses/07.txt

Exit codes: 0 done, 1 error (frames that were written stay), 2 wrong usage)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunSimulate(*arguments); }; });
}

}  // namespace carmap
