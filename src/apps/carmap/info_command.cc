#include <fmt/format.h>

#include <CLI/App.hpp>
#include <Eigen/Geometry>
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/lean_codec.h"

namespace carmap {
namespace {

struct Arguments {
  std::string map;
  bool json = false;
};

size_t KeyframesOf(const LeanMap& map, DriveId drive) {
  return static_cast<size_t>(
      std::count_if(map.keyframes.begin(), map.keyframes.end(),
                    [&](const LeanKeyframe& keyframe) { return keyframe.id.drive == drive; }));
}

size_t KeyframesWithGps(const LeanMap& map) {
  return static_cast<size_t>(
      std::count_if(map.keyframes.begin(), map.keyframes.end(),
                    [](const LeanKeyframe& keyframe) { return keyframe.gps.has_value(); }));
}

/// Of keyframes and landmarks.
Eigen::AlignedBox3d BoundsOf(const LeanMap& map) {
  Eigen::AlignedBox3d bounds;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    bounds.extend(keyframe.map_from_camera.translation);
  }
  for (const LeanLandmark& landmark : map.landmarks) bounds.extend(landmark.position_in_map);
  return bounds;
}

nlohmann::ordered_json ToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::vector<std::string> FaultNames(const DriveFaults& faults) {
  std::vector<std::string> names;
  for (size_t i = 0; i < faults.size(); ++i) {
    if (faults[i]) names.emplace_back(kDriveFaultNames[i]);
  }
  return names;
}

nlohmann::ordered_json ToJson(const LeanMap& map, const LeanDrive& drive) {
  const PinholeCamera& camera = drive.rig.camera;
  return {{"id", ToHex(drive.id)},
          {"keyframes", KeyframesOf(map, drive.id)},
          {"width_px", camera.width},
          {"height_px", camera.height},
          {"fx_px", camera.fx},
          {"fy_px", camera.fy},
          {"cx_px", camera.cx},
          {"cy_px", camera.cy},
          {"baseline_m", drive.rig.baseline_m},
          {"disparity_bias_px", ToJson(drive.rig.disparity_bias.coefficients_px)},
          {"suspect", FaultNames(drive.faults)}};
}

nlohmann::ordered_json ToJson(const LeanMap& map, size_t bytes) {
  const size_t observations = ObservationCount(map);
  const double landmarks = static_cast<double>(map.landmarks.size());
  nlohmann::ordered_json json;
  json["keyframes"] = map.keyframes.size();
  json["landmarks"] = map.landmarks.size();
  json["observations"] = observations;
  json["mean_observations"] = Ratio(static_cast<double>(observations), landmarks);
  json["drives"] = map.drives.size();
  json["bytes"] = bytes;
  json["bytes_per_landmark"] = Ratio(static_cast<double>(bytes), landmarks);
  json["path_length_m"] = PathLengthM(map);
  json["gps"] = KeyframesWithGps(map) > 0;
  json["keyframes_with_gps"] = KeyframesWithGps(map);
  json["bounding_box_m"] = nullptr;
  if (const Eigen::AlignedBox3d bounds = BoundsOf(map); !bounds.isEmpty()) {
    json["bounding_box_m"] = {{"min", ToJson(bounds.min())}, {"max", ToJson(bounds.max())}};
  }
  json["drive_list"] = nlohmann::ordered_json::array();
  for (const LeanDrive& drive : map.drives) json["drive_list"].push_back(ToJson(map, drive));
  return json;
}

void PrintTable(const std::string& path, const LeanMap& map, size_t bytes) {
  const size_t observations = ObservationCount(map), landmarks = map.landmarks.size();
  const auto row = [](const char* name, const std::string& value) {
    fmt::print("{:<14}{}\n", name, value);
  };
  row("map", path);
  row("size",
      landmarks == 0
          ? BytesText(static_cast<double>(bytes))
          : fmt::format("{} ({:.1f} bytes a landmark)", BytesText(static_cast<double>(bytes)),
                        static_cast<double>(bytes) / static_cast<double>(landmarks)));
  row("keyframes", fmt::format("{}", map.keyframes.size()));
  row("landmarks", fmt::format("{}", landmarks));
  row("observations", landmarks == 0 ? "0"
                                     : fmt::format("{} ({:.1f} a landmark)", observations,
                                                   static_cast<double>(observations) /
                                                       static_cast<double>(landmarks)));
  row("path length", fmt::format("{:.1f} m", PathLengthM(map)));
  const size_t with_gps = KeyframesWithGps(map);
  row("GPS", with_gps == 0 ? "no" : fmt::format("yes, {}", Count(with_gps, "keyframe")));
  if (const Eigen::AlignedBox3d bounds = BoundsOf(map); !bounds.isEmpty()) {
    const Eigen::Vector3d &a = bounds.min(), &b = bounds.max();
    row("reaches", fmt::format("x {:.1f} to {:.1f} m (right), y {:.1f} to {:.1f} m (down), "
                               "z {:.1f} to {:.1f} m (forward)",
                               a.x(), b.x(), a.y(), b.y(), a.z(), b.z()));
  }
  for (const LeanDrive& drive : map.drives) {
    const PinholeCamera& camera = drive.rig.camera;
    row("drive", fmt::format("{}: {}, features at {}x{} px, fx {:.1f} px, baseline {:.3f} m{}",
                             ToHex(drive.id), Count(KeyframesOf(map, drive.id), "keyframe"),
                             camera.width, camera.height, camera.fx, drive.rig.baseline_m,
                             drive.faults.any() ? "; suspect: " + NamesOf(drive.faults) : ""));
  }
}

absl::StatusOr<ExitCode> Info(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(arguments.map, kMaxLeanFileBytes));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap map, DecodeLeanMap(bytes, arguments.map));
  if (arguments.json) {
    fmt::print("{}", JsonText(ToJson(map, bytes.size())));
  } else {
    PrintTable(arguments.map, map, bytes.size());
  }
  return kSuccess;
}

}  // namespace

void AddInfoCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("info", "Say what a map file holds");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("MAP", arguments->map, "Map file (.cmap)")->required();
  command->add_flag("--json", arguments->json, "Print JSON, all lengths in metres");
  command->footer(R"(The whole file is read and checked: exit 0 means that it is a sound map.

Example:
  carmap info road.cmap

Exit codes: 0 done, 1 error, 2 wrong usage)");
  command->callback([arguments, &chosen] { chosen = [arguments] { return Info(*arguments); }; });
}

}  // namespace carmap
