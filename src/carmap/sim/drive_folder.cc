#include "carmap/sim/drive_folder.h"

#include <fmt/format.h>

#include <cmath>
#include <future>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kWorldFile = "world.json";

// --- What describes the drive ---

Json ToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

/// Row-major 3×4, as a line of poses.txt.
Json ToJson(const Rigid3& pose) {
  const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
  Json numbers = Json::array();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) numbers.push_back(rotation(row, column));
    numbers.push_back(pose.translation[row]);
  }
  return numbers;
}

Json LightJson(const Light& light) {
  return {{"to_sun_in_enu", ToJson(light.to_sun_in_enu)}, {"sun", light.sun}, {"sky", light.sky}};
}

Json CameraJson(const SimulatedCamera& camera) {
  const SensorOptions& sensor = camera.sensor;
  return {{"residual_column", camera.residual.column},
          {"residual_row", camera.residual.row},
          {"sensitivity", sensor.sensitivity},
          {"black_level", sensor.black_level},
          {"vignetting", sensor.vignetting},
          {"exposure_s", sensor.exposure_s},
          {"blur_sigma_px", sensor.blur_sigma_px},
          {"read_noise", sensor.read_noise},
          {"shot_noise", sensor.shot_noise}};
}

Json GpsJson(const GpsModel& gps) {
  return {{"rate_hz", gps.rate_hz},
          {"noise_m", gps.noise_m},
          {"bias_m", gps.bias_m},
          {"bias_time_s", gps.bias_time_s},
          {"vertical_factor", gps.vertical_factor},
          {"excursions_per_km", gps.excursions_per_km},
          {"excursion_m", {gps.excursion_min_m, gps.excursion_max_m}},
          {"excursion_s", gps.excursion_s}};
}

std::string WorldText(const Json& options, const std::vector<Change>& changes,
                      const Simulation& simulation) {
  const GpsFix& origin = simulation.world().origin;
  Json json;
  json["options"] = options;
  json["frame"] = {{"name", "enu"},
                   {"axes", "x east, y north, z up, metres"},
                   {"origin_latitude_deg", origin.latitude_deg},
                   {"origin_longitude_deg", origin.longitude_deg},
                   {"origin_altitude_m", origin.altitude_m}};
  json["enu_from_first_camera"] = ToJson(*simulation.enu_from_camera().front().world_from_camera);
  json["route_length_m"] = simulation.route().length_m();
  json["light"] = LightJson(simulation.light());
  json["cameras"] = {CameraJson(simulation.cameras()[0]), CameraJson(simulation.cameras()[1])};
  json["gps"] = GpsJson(simulation.gps_model());
  json["changes"] = carmap::ToJson(changes).at("changes");
  return json.dump(2) + "\n";
}

std::string CalibrationText(const StereoRig& rig) {
  const PinholeCamera& c = rig.camera;
  const auto line = [&](const char* name, double tx) {
    return fmt::format("{}: {:.9g} 0 {:.9g} {:.9g} 0 {:.9g} {:.9g} 0 0 0 1 0\n", name, c.fx, c.cx,
                       tx, c.fy, c.cy);
  };
  return line("P0", 0) + line("P1", -c.fx * rig.baseline_m);
}

std::string TimesText(const Trajectory& trajectory) {
  std::string text;
  for (const TimedPose& pose : trajectory) {
    text += fmt::format("{:.6f}\n", pose.timestamp->seconds());
  }
  return text;
}

// --- Folders ---

absl::Status MakeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) return absl::OkStatus();
  return absl::UnavailableError(
      fmt::format("{}: cannot be made ({}); choose a place that is writable and has room",
                  folder.string(), error.message()));
}

/// Whether the nearest folder above that is there can be written to.
absl::Status CheckCanBeMade(const fs::path& folder) {
  std::error_code error;
  fs::path there = fs::absolute(folder, error).lexically_normal();
  while (there.has_relative_path() && !fs::exists(there, error)) there = there.parent_path();
  return CheckWritable(there / folder.filename());
}

/// "seed is 1 there and 2 here".
std::string Difference(const Json& there, const Json& here) {
  std::string text;
  for (const auto& [key, value] : here.items()) {
    const Json other = there.is_object() && there.contains(key) ? there.at(key) : Json();
    if (other == value) continue;
    if (!text.empty()) text += ", ";
    text += fmt::format("{} is {} there and {} here", key, other.dump(), value.dump());
  }
  return text.empty() ? "the file has other options" : text;
}

// --- Images ---

struct ImageFile {
  fs::path path;
  cv::Mat image;
};

cv::Mat InstanceImage(const RenderedView& view) {
  cv::Mat image(view.instances.size(), CV_16UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto mobility = static_cast<PlacementMobility>(view.mobilities.at<uint8_t>(y, x));
      const int first = mobility == PlacementMobility::kParked   ? kFirstParkedInstance
                        : mobility == PlacementMobility::kMoving ? kFirstMovingInstance
                                                                 : 0;
      image.at<uint16_t>(y, x) = static_cast<uint16_t>(
          mobility == PlacementMobility::kStatic ? 0 : first + view.instances.at<uint16_t>(y, x));
    }
  }
  return image;
}

cv::Mat DepthImage(const RenderedView& view) {
  cv::Mat image;
  cv::Mat depth_m = view.depth_m.clone();
  depth_m.setTo(0, depth_m > 255);
  depth_m.convertTo(image, CV_16U, 256);
  return image;
}

/// Names of one frame's files and, where `frame` is given, what is in them. The right camera's
/// image is the last: where it is, the frame is complete.
std::vector<ImageFile> FilesOf(const fs::path& folder, size_t frame_idx, const TruthImages& truths,
                               const SimulatedFrame* frame) {
  const std::string name = fmt::format("{:06}.png", frame_idx);
  std::vector<ImageFile> files;
  const auto add = [&](const std::string& subfolder, const auto& image_of) {
    files.push_back({folder / subfolder / name, frame ? image_of() : cv::Mat()});
  };
  for (const bool right : {false, true}) {
    const std::string suffix = right ? "_right" : "";
    const auto view = [=]() -> const RenderedView& {
      return right ? frame->right_truth : frame->left_truth;
    };
    if (truths.labels) add("labels" + suffix, [&] { return view().labels; });
    if (truths.instances) add("instances" + suffix, [&] { return InstanceImage(view()); });
    if (truths.depth) add("depth" + suffix, [&] { return DepthImage(view()); });
  }
  add("image_0", [&] { return frame->left; });
  add("image_1", [&] { return frame->right; });
  return files;
}

bool IsComplete(const std::vector<ImageFile>& files) {
  std::error_code error;
  return std::all_of(files.begin(), files.end(),
                     [&](const ImageFile& file) { return fs::exists(file.path, error); });
}

absl::Status WriteImages(const std::vector<ImageFile>& files) {
  for (const auto& [path, image] : files) {
    std::vector<uint8_t> bytes;
    cv::imencode(".png", image, bytes, {cv::IMWRITE_PNG_COMPRESSION, 1});
    CARMAP_RETURN_IF_ERROR(WriteFileAtomically(
        path, std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size())));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckDriveFolder(const fs::path& folder, const Json& options) {
  constexpr uint64_t kMaxWorldBytes = 1 << 26;
  std::error_code error;
  if (!fs::exists(folder, error)) return CheckCanBeMade(folder);
  if (!fs::is_directory(folder, error)) {
    return absl::FailedPreconditionError(
        fmt::format("{}: is a file; name a folder for the drive", folder.string()));
  }
  if (!fs::exists(folder / kWorldFile, error)) {
    if (fs::is_empty(folder, error)) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("{}: holds files but no simulated drive ({} is missing); nothing was "
                    "overwritten; name a new folder",
                    folder.string(), kWorldFile));
  }
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(folder / kWorldFile, kMaxWorldBytes));
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  const Json there = json.is_object() && json.contains("options") ? json.at("options") : Json();
  if (there == options) return absl::OkStatus();
  return absl::FailedPreconditionError(
      fmt::format("{}: holds another drive ({}); nothing was overwritten; name a new folder, or "
                  "remove this one",
                  folder.string(), Difference(there, options)));
}

absl::StatusOr<WrittenDrive> WriteDrive(const fs::path& folder, const Json& options,
                                        const std::vector<Change>& changes,
                                        const TruthImages& truths, Simulation& simulation,
                                        const SimulationProgress& progress) {
  CARMAP_RETURN_IF_ERROR(CheckDriveFolder(folder, options));
  for (const ImageFile& file : FilesOf(folder, 0, truths, nullptr)) {
    CARMAP_RETURN_IF_ERROR(MakeFolder(file.path.parent_path()));
  }
  const Trajectory& trajectory = simulation.enu_from_camera();
  // First what the folder is known by.
  CARMAP_RETURN_IF_ERROR(
      WriteFileAtomically(folder / kWorldFile, WorldText(options, changes, simulation)));
  CARMAP_RETURN_IF_ERROR(
      WriteFileAtomically(folder / "calib.txt", CalibrationText(simulation.rig())));
  CARMAP_RETURN_IF_ERROR(WriteFileAtomically(folder / "times.txt", TimesText(trajectory)));
  CARMAP_RETURN_IF_ERROR(WriteTrajectory(folder / "poses.txt", trajectory));
  CARMAP_RETURN_IF_ERROR(
      WriteFileAtomically(folder / "gps.txt", GpsText(simulation.fixes(), simulation.gps_model())));
  WrittenDrive written;
  std::future<absl::Status> writing;  // of the last frame, beside the next one's rendering
  while (written.frames < simulation.frame_count()) {
    const size_t frame_idx = written.frames++;
    if (IsComplete(FilesOf(folder, frame_idx, truths, nullptr))) {
      ++written.found_frames;
    } else {
      SimulatedFrame frame = simulation.Render(frame_idx);
      if (writing.valid()) CARMAP_RETURN_IF_ERROR(writing.get());
      writing = std::async(std::launch::async, [&, frame_idx, frame = std::move(frame)] {
        return WriteImages(FilesOf(folder, frame_idx, truths, &frame));
      });
    }
    if (progress) progress(written.frames);
  }
  if (writing.valid()) CARMAP_RETURN_IF_ERROR(writing.get());
  return written;
}

}  // namespace carmap
