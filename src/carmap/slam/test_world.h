// A street of textured planes and the stereo drive through it, rendered pixel by pixel. For tests
// that need images with known truth.
//
// The texture is a hash of world coordinates, so each machine renders the same.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "carmap/dataset/frame_source.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

inline const StereoRig kTestWorldRig{{180, 180, 160, 55, 320, 120}, 0.54};

/// A road between two walls, with a wall at its end. The street runs along z, x points right, y
/// down, the camera's height is y = 0.
class TestWorld {
 public:
  explicit TestWorld(uint32_t seed = 1) : seed_(seed) {}

  cv::Mat Render(const PinholeCamera& camera, const Rigid3& world_from_camera,
                 uint32_t frame) const {
    cv::Mat image(camera.height, camera.width, CV_8UC1);
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        const Eigen::Vector3d ray = world_from_camera.rotation * camera.Unproject({u, v}, 1);
        const double noise = 3 * (Hash(frame, u, v, 99) + Hash(frame, u, v, 98) - 1);  // 1.2 greys
        image.at<uint8_t>(v, u) =
            cv::saturate_cast<uint8_t>(Grey(world_from_camera.translation, ray, camera.fx) + noise);
      }
    }
    return image;
  }

 private:
  static constexpr double kRoadY = 1.65, kWallX = 6, kEndZ = 60, kWallTopY = -6;

  double Grey(const Eigen::Vector3d& origin, const Eigen::Vector3d& ray, double focal_px) const {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    const double wall_x = ray.x() > 0 ? kWallX : -kWallX;
    const double to_road = ray.y() > 0 ? (kRoadY - origin.y()) / ray.y() : kFar;
    const double to_wall = ray.x() != 0 ? (wall_x - origin.x()) / ray.x() : kFar;
    const double to_end = ray.z() > 0 ? (kEndZ - origin.z()) / ray.z() : kFar;
    const double distance = std::min({to_road, to_wall, to_end});
    const Eigen::Vector3d p = origin + distance * ray;
    if (p.y() < kWallTopY) return 200;  // sky
    const double pixel_m = distance / focal_px;
    if (distance == to_road) return Texture(p.x(), p.z(), pixel_m, 1);
    if (distance == to_wall) return Texture(p.y(), p.z(), pixel_m, wall_x > 0 ? 2 : 3);
    return Texture(p.x(), p.y(), pixel_m, 4);
  }

  /// Noise of several cell sizes, without those that pixels of this size would alias.
  double Texture(double a, double b, double pixel_m, uint32_t surface) const {
    double grey = 110;
    for (const double cell_m : {0.06, 0.15, 0.4, 1.0, 2.5}) {
      const double weight = std::clamp(cell_m / pixel_m / 1.5 - 1, 0.0, 1.0);
      if (weight > 0) grey += 75 * weight * (Smooth(a / cell_m, b / cell_m, surface) - 0.5);
    }
    return grey;
  }

  /// Random values at whole coordinates, blended in between.
  double Smooth(double a, double b, uint32_t surface) const {
    const double a0 = std::floor(a), b0 = std::floor(b);
    const auto ia = static_cast<int>(a0), ib = static_cast<int>(b0);
    const auto ease = [](double t) { return t * t * (3 - 2 * t); };
    const double ta = ease(a - a0), tb = ease(b - b0);
    return (1 - ta) * ((1 - tb) * Hash(ia, ib, 0, surface) + tb * Hash(ia, ib + 1, 0, surface)) +
           ta * ((1 - tb) * Hash(ia + 1, ib, 0, surface) + tb * Hash(ia + 1, ib + 1, 0, surface));
  }

  /// 0 to 1.
  double Hash(uint32_t a, uint32_t b, uint32_t c, uint32_t d) const {
    uint32_t h = seed_;
    for (const uint32_t value : {a, b, c, d}) {
      h = (h ^ value) * 0x9E3779B1u;
      h ^= h >> 15;
    }
    h *= 0x85EBCA77u;
    h ^= h >> 13;
    return h * 0x1p-32;
  }

  uint32_t seed_;
};

struct TestDrive {
  StereoRig rig;
  std::vector<StereoFrame> frames;        ///< ten a second
  std::vector<Rigid3> world_from_camera;  ///< the truth
};

/// What a rig sees at each of the poses, ten a second.
inline TestDrive RenderAlong(const std::vector<Rigid3>& world_from_camera,
                             const TestWorld& world = TestWorld(),
                             const StereoRig& rig = kTestWorldRig) {
  TestDrive drive{.rig = rig, .frames = {}, .world_from_camera = world_from_camera};
  for (uint32_t i = 0; i < world_from_camera.size(); ++i) {
    const Rigid3& pose = world_from_camera[i];
    const Rigid3 right_pose{pose.rotation, pose * Eigen::Vector3d(rig.baseline_m, 0, 0)};
    drive.frames.push_back({.index = i,
                            .timestamp = Timestamp::FromSeconds(0.1 * i),
                            .left = world.Render(rig.camera, pose, 2 * i),
                            .right = world.Render(rig.camera, right_pose, 2 * i + 1),
                            .gps = {}});
  }
  return drive;
}

/// On the way straight on with a slight weave.
inline Rigid3 WeavingPose(double z_m) {
  return {RotationExp({0.004 * std::sin(z_m), 0.03 * std::sin(z_m / 4), 0}),
          {0.5 * std::sin(z_m / 5), 0.02 * std::sin(2 * z_m), z_m}};
}

/// A drive along it, 0.6 m a frame.
inline TestDrive RenderTestDrive(uint32_t frame_count, const TestWorld& world = TestWorld(),
                                 const StereoRig& rig = kTestWorldRig) {
  std::vector<Rigid3> poses;
  for (uint32_t i = 0; i < frame_count; ++i) poses.push_back(WeavingPose(0.6 * i));
  return RenderAlong(poses, world, rig);
}

/// Frames in memory. Those of `unreadable` are errors.
class MemorySource : public FrameSource {
 public:
  explicit MemorySource(TestDrive drive, std::vector<uint32_t> unreadable = {})
      : drive_(std::move(drive)), unreadable_(std::move(unreadable)) {}

  const StereoRig& rig() const override { return drive_.rig; }
  std::optional<size_t> frame_count() const override { return drive_.frames.size(); }
  std::optional<StereoFrame> Next() override {
    if (next_ == drive_.frames.size()) return std::nullopt;
    StereoFrame frame = drive_.frames[next_++];
    if (std::count(unreadable_.begin(), unreadable_.end(), frame.index) > 0) {
      frame.left = frame.right = cv::Mat();
      frame.status = absl::DataLossError("frame " + std::to_string(frame.index) + " is cut short");
    }
    return frame;
  }

 private:
  TestDrive drive_;
  std::vector<uint32_t> unreadable_;
  size_t next_ = 0;
};

}  // namespace carmap
