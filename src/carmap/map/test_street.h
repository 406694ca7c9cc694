// A street of landmarks and what drives along it see and map. For the tests of map/ and above.
//
// Made with whole numbers from a seeded generator, so that each machine makes the same.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "carmap/map/lean_map.h"

namespace carmap {

inline const StereoRig kStreetRig{{718, 720, 607, 185, 1226, 370}, 0.54};

/// The street runs along z of the world, x points right, y down, the camera's height is y = 0.
struct Street {
  struct Corner {
    Eigen::Vector3d p_in_world;
    Descriptor descriptor;
    double level_at_1m;
  };
  std::vector<Corner> corners;
};

class StreetRandom {
 public:
  explicit StreetRandom(uint64_t seed) : generator_(seed) {}
  uint64_t Bits() { return generator_(); }
  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(generator_() >> 11) * 0x1p-53;
  }
  double Normal(double sigma) {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += Uniform(0, 1);
    return sigma * sum;
  }
  Descriptor RandomDescriptor() {
    Descriptor descriptor;
    for (uint64_t& word : descriptor.words) word = Bits();
    return descriptor;
  }

 private:
  std::mt19937_64 generator_;
};

/// Facades on both sides, from z = 0 to length_m.
inline Street MakeStreet(uint64_t seed, double length_m, double corners_per_m = 25) {
  StreetRandom random(seed);
  Street street;
  for (int i = 0; i < static_cast<int>(length_m * corners_per_m); ++i) {
    const double side = random.Bits() % 2 ? 1 : -1;
    const Eigen::Vector3d p(side * random.Uniform(7, 14), random.Uniform(-5, 1.5),
                            random.Uniform(0, length_m));
    street.corners.push_back({p, random.RandomDescriptor(), random.Uniform(15, 20)});
  }
  return street;
}

/// From `begin_m` to `end_m` each stretch of `period_m` shows the same façades as the first, but
/// for a share of each that is its own.
inline Street WithRepeatedFacades(const Street& street, double begin_m, double end_m,
                                  double period_m, double own_share = 0) {
  StreetRandom random(6);
  Street repeated;
  for (const Street::Corner& corner : street.corners) {
    const double z = corner.p_in_world.z();
    const bool is_own = z < begin_m || z >= end_m || random.Uniform(0, 1) < own_share;
    if (is_own) repeated.corners.push_back(corner);
    if (is_own || z >= begin_m + period_m) continue;
    for (double shift_m = 0; z + shift_m < end_m; shift_m += period_m) {
      repeated.corners.push_back(corner);
      repeated.corners.back().p_in_world.z() += shift_m;
    }
  }
  return repeated;
}

/// Poses every step_m along a lane (x of the camera) with a slight weave.
inline std::vector<Rigid3> DriveAlong(double lane_m, double from_m, double to_m,
                                      double step_m = 1.5) {
  std::vector<Rigid3> world_from_camera;
  for (double z = from_m; z <= to_m; z += step_m) {
    const double turn = 0.02 * std::sin(z / 5);
    world_from_camera.push_back(
        {RotationExp({0.3 * turn, turn, 0.2 * turn}), {lane_m + 0.1 * std::cos(z / 5), 0, z}});
  }
  return world_from_camera;
}

/// Where the street's cross-section at z lies once the street winds and climbs instead of going
/// straight: to be applied to corners and poses alike.
class Winding {
 public:
  explicit Winding(double length_m) {
    Rigid3 section;
    for (double z = 0; z <= length_m + kStepM; z += kStepM) {
      sections_.push_back(section);
      section.rotation = RotationExp({0, 0.9 * std::sin(z / 110), 0}) *
                         RotationExp({0.06 * std::sin(z / 70), 0, 0});
      section.translation += kStepM * (section.rotation * Eigen::Vector3d::UnitZ());
    }
  }
  Eigen::Vector3d operator()(const Eigen::Vector3d& p) const {
    return At(p.z()) * Eigen::Vector3d(p.x(), p.y(), 0);
  }
  Rigid3 operator()(const Rigid3& pose) const {
    Rigid3 in_section = pose;
    in_section.translation.z() = 0;
    return At(pose.translation.z()) * in_section;
  }

 private:
  static constexpr double kStepM = 0.05;

  Rigid3 At(double z) const {
    const auto i = static_cast<size_t>(std::clamp(z / kStepM, 0.0, sections_.size() - 1.0));
    Rigid3 section = sections_[i];
    const double rest_m = z - static_cast<double>(i) * kStepM;
    section.translation += rest_m * (section.rotation * Eigen::Vector3d::UnitZ());
    return section;
  }

  std::vector<Rigid3> sections_;
};

inline Street Wound(Street street, const Winding& winding) {
  for (Street::Corner& corner : street.corners) corner.p_in_world = winding(corner.p_in_world);
  return street;
}

inline std::vector<Rigid3> Wound(std::vector<Rigid3> world_from_camera, const Winding& winding) {
  for (Rigid3& pose : world_from_camera) pose = winding(pose);
  return world_from_camera;
}

struct StreetNoise {
  double pixel_px = 0;      ///< of u, v and disparity
  int descriptor_bits = 0;  ///< flipped
};

/// The corner as the camera sees it, without noise; has no disparity if it cannot be seen.
inline Feature SeeCorner(const Street::Corner& corner, const StereoRig& rig,
                         const Rigid3& camera_from_world) {
  const Eigen::Vector3d p = camera_from_world * corner.p_in_world;
  if (p.z() < 2 || p.z() > 45) return {};
  const Eigen::Vector3d uvd = rig.Project(p);
  const double level =
      std::round(corner.level_at_1m -
                 std::log(p.norm() * kStreetRig.camera.fx / rig.camera.fx) / std::log(kLevelScale));
  if (!rig.camera.Contains(uvd.head<2>()) || level < 0 || level >= kLevelCount) return {};
  return {.x_px = static_cast<float>(uvd.x()),
          .y_px = static_cast<float>(uvd.y()),
          .disparity_px = static_cast<float>(uvd.z()),
          .level = static_cast<uint8_t>(level),
          .descriptor = corner.descriptor};
}

inline void FlipBits(int count, StreetRandom& random, Descriptor& descriptor) {
  for (int i = 0; i < count; ++i) {
    const uint64_t bit = random.Bits() % kSignatureBits;
    descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  }
}

/// What a camera there sees of the street.
inline std::vector<Feature> SeeStreet(const Street& street, const StereoRig& rig,
                                      const Rigid3& world_from_camera,
                                      const StreetNoise& noise = {}, uint64_t seed = 1) {
  StreetRandom random(seed);
  const Rigid3 camera_from_world = world_from_camera.Inverse();
  std::vector<Feature> features;
  for (const Street::Corner& corner : street.corners) {
    Feature feature = SeeCorner(corner, rig, camera_from_world);
    if (!feature.has_disparity()) continue;
    feature.x_px += static_cast<float>(random.Normal(noise.pixel_px));
    feature.y_px += static_cast<float>(random.Normal(noise.pixel_px));
    feature.disparity_px += static_cast<float>(random.Normal(noise.pixel_px));
    FlipBits(noise.descriptor_bits, random, feature.descriptor);
    features.push_back(feature);
  }
  return features;
}

inline Eigen::Vector3d MeasureAndTriangulate(const StereoRig& rig,
                                             const Eigen::Vector3d& p_in_camera,
                                             const StreetNoise& noise, StreetRandom& random) {
  Eigen::Vector3d uvd = rig.Project(p_in_camera);
  for (int i = 0; i < 3; ++i) uvd[i] += random.Normal(noise.pixel_px);
  return rig.Triangulate(uvd.head<2>(), uvd.z());
}

/// The lean map that a drive makes of the street: in a frame of its own, of corners that at least
/// three of its keyframes see, placed where the nearest of these measures them. Its clock shows
/// `start_s` at the first keyframe.
inline LeanMap MapStreet(const Street& street, DriveId drive, const StereoRig& rig,
                         const std::vector<Rigid3>& world_from_camera, const Rigid3& map_from_world,
                         const StreetNoise& noise = {}, double start_s = 0) {
  StreetRandom random(drive.input);
  LeanMap map;
  map.drives = {{drive, rig}};
  for (uint32_t i = 0; i < world_from_camera.size(); ++i) {
    LeanKeyframe keyframe;
    keyframe.id = {drive, 3 * i};
    keyframe.timestamp = Timestamp::FromSeconds(start_s + 0.3 * i);
    keyframe.map_from_camera = map_from_world * world_from_camera[i];
    map.keyframes.push_back(keyframe);
  }
  for (const Street::Corner& corner : street.corners) {
    LeanLandmark landmark;
    double nearest_m = 1e9;
    for (uint32_t i = 0; i < world_from_camera.size(); ++i) {
      const Feature feature = SeeCorner(corner, rig, world_from_camera[i].Inverse());
      if (!feature.has_disparity()) continue;
      landmark.anchor_idx = i;
      landmark.anchor_level = feature.level;
      landmark.keyframe_idxs.push_back(i);
      const double distance_m = rig.DepthAt(feature.disparity_px);
      if (distance_m > nearest_m) continue;
      nearest_m = distance_m;
      const Eigen::Vector3d p = MeasureAndTriangulate(
          rig, world_from_camera[i].Inverse() * corner.p_in_world, noise, random);
      landmark.position_in_map = map_from_world * (world_from_camera[i] * p);
    }
    if (landmark.keyframe_idxs.size() < 3) continue;
    landmark.id = {drive, static_cast<uint32_t>(map.landmarks.size())};
    landmark.descriptor = corner.descriptor;
    FlipBits(noise.descriptor_bits, random, landmark.descriptor);
    map.landmarks.push_back(landmark);
  }
  return map;
}

/// The map of a drive that takes all lengths for `scale` times what they are.
inline LeanMap Scaled(LeanMap map, double scale) {
  for (LeanKeyframe& keyframe : map.keyframes) keyframe.map_from_camera.translation *= scale;
  for (LeanLandmark& landmark : map.landmarks) landmark.position_in_map *= scale;
  return map;
}

/// The map of a drive that takes each step for `scale` times what it is and turns a little between
/// them, differently each `seed`; landmarks ride on their anchors.
inline LeanMap Drifted(const LeanMap& map, double scale, double turn_rad_per_m, uint64_t seed) {
  StreetRandom random(seed);
  LeanMap drifted = map;
  for (size_t i = 1; i < map.keyframes.size(); ++i) {
    const Rigid3 &before = map.keyframes[i - 1].map_from_camera,
                 &pose = map.keyframes[i].map_from_camera;
    Rigid3 step = before.Inverse() * pose;
    const double sigma_rad = turn_rad_per_m * step.translation.norm();
    step.translation *= scale;
    step.rotation = RotationExp({random.Normal(sigma_rad), random.Normal(sigma_rad),
                                 random.Normal(sigma_rad)}) *
                    step.rotation;
    drifted.keyframes[i].map_from_camera = drifted.keyframes[i - 1].map_from_camera * step;
  }
  for (LeanLandmark& landmark : drifted.landmarks) {
    landmark.position_in_map =
        drifted.keyframes[landmark.anchor_idx].map_from_camera * PositionInAnchor(map, landmark);
  }
  return drifted;
}

}  // namespace carmap
