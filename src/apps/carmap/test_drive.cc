#include "apps/carmap/test_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgcodecs.hpp>

#include "carmap/dataset/trajectory.h"

namespace carmap {
namespace {

uint32_t Hash(uint32_t a, uint32_t b, uint32_t c) {
  uint32_t h = a * 0x9e3779b1u ^ b * 0x85ebca77u ^ c * 0xc2b2ae3du;
  h = (h ^ (h >> 15)) * 0x2c1b3c6du;
  h = (h ^ (h >> 12)) * 0x297a2d39u;
  return h ^ (h >> 15);
}

/// Patches of random grey, large ones with smaller ones on them, in [0, 1].
double Grey(double u_m, double v_m, uint32_t surface) {
  double grey = 0;
  for (const double cell_m : {1.0, 0.35, 0.12}) {
    const auto column = static_cast<uint32_t>(std::lround(u_m / cell_m) + 100'000);
    const auto row = static_cast<uint32_t>(std::lround(v_m / cell_m) + 100'000);
    const auto seed = surface + static_cast<uint32_t>(1000 * cell_m);
    grey += static_cast<double>(Hash(column, row, seed) % 256) / 255 / 3;
  }
  return grey;
}

/// The street: road 1.6 m below the camera's start, facades 6 m left and 7 m right, an end at 60 m.
double GreyAlong(const Eigen::Vector3d& center, const Eigen::Vector3d& direction, uint32_t world) {
  struct Plane {
    int axis, u_axis, v_axis;
    double place_m;
  };
  static constexpr Plane kPlanes[] = {{1, 0, 2, 1.6}, {0, 2, 1, -6}, {0, 2, 1, 7}, {2, 0, 1, 60}};
  double nearest = std::numeric_limits<double>::max(), grey = 0.9;
  for (uint32_t i = 0; i < std::size(kPlanes); ++i) {
    const Plane& plane = kPlanes[i];
    const double distance = (plane.place_m - center[plane.axis]) / direction[plane.axis];
    if (!(distance > 0 && distance < nearest)) continue;
    const Eigen::Vector3d hit = center + distance * direction;
    if (hit.y() < -6) continue;  // above the roofs
    nearest = distance;
    grey = Grey(hit[plane.u_axis], hit[plane.v_axis], 7919 * world + i);
  }
  return grey;
}

cv::Mat Render(const Rigid3& world_from_camera, uint32_t world) {
  const PinholeCamera& camera = kTestRig.camera;
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      double sum = 0;
      for (const double dv : {-0.25, 0.25}) {
        for (const double du : {-0.25, 0.25}) {
          const Eigen::Vector3d ray = camera.Unproject({u + du, v + dv}, 1);
          sum += GreyAlong(world_from_camera.translation, world_from_camera.rotation * ray, world);
        }
      }
      image.at<uint8_t>(v, u) = static_cast<uint8_t>(20 + 200 * sum / 4);
    }
  }
  return image;
}

}  // namespace

std::vector<Rigid3> TestDrivePoses(size_t frames) {
  std::vector<Rigid3> poses;
  for (size_t i = 0; i < frames; ++i) {
    const double z = 0.8 * static_cast<double>(i), turn = 0.004 * z;
    poses.push_back({RotationExp({0, turn, 0}), {0.002 * z * z, 0, z}});
  }
  return poses;
}

void WriteTestDrive(const std::filesystem::path& folder, const std::vector<Rigid3>& poses,
                    uint32_t world) {
  const PinholeCamera& camera = kTestRig.camera;
  std::filesystem::create_directories(folder / "image_0");
  std::filesystem::create_directories(folder / "image_1");
  const std::string left =
      fmt::format("{} 0 {} 0 0 {} {} 0 0 0 1 0", camera.fx, camera.cx, camera.fy, camera.cy);
  const std::string right = fmt::format("{} 0 {} {} 0 {} {} 0 0 0 1 0", camera.fx, camera.cx,
                                        -camera.fx * kTestRig.baseline_m, camera.fy, camera.cy);
  std::ofstream(folder / "calib.txt") << "P0: " << left << "\nP1: " << right << "\n";
  std::ofstream times(folder / "times.txt");
  Trajectory truth;
  for (size_t i = 0; i < poses.size(); ++i) {
    const std::string name = fmt::format("{:06}.png", i);
    const Rigid3 right_pose = poses[i] * Rigid3{{1, 0, 0, 0}, {kTestRig.baseline_m, 0, 0}};
    cv::imwrite((folder / "image_0" / name).string(), Render(poses[i], world));
    cv::imwrite((folder / "image_1" / name).string(), Render(right_pose, world));
    times << fmt::format("{:.1f}\n", 0.1 * static_cast<double>(i));
    truth.push_back({std::nullopt, poses[i]});
  }
  (void)WriteTrajectory(folder / "poses.txt", truth);
}

}  // namespace carmap
