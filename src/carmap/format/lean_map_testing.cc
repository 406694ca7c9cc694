#include "carmap/format/lean_map_testing.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace carmap {
namespace {

class Dice {
 public:
  explicit Dice(uint64_t seed) : generator_(seed) {}

  uint64_t Bits() { return generator_(); }
  uint32_t Below(uint32_t bound) { return static_cast<uint32_t>(generator_() % bound); }
  /// Uniform between the two.
  double Between(double low, double high) {
    return low + (high - low) * static_cast<double>(generator_() >> 11) * 0x1p-53;
  }

 private:
  std::mt19937_64 generator_;
};

LeanDrive RandomDrive(Dice& dice) {
  LeanDrive drive;
  drive.id = {dice.Bits(), dice.Bits()};
  drive.rig.camera = {
      dice.Between(300, 1000), dice.Between(300, 1000), 601.887, 183.110, 1226, 370};
  drive.rig.baseline_m = dice.Between(0.1, 1);
  for (double& value : drive.rig.disparity_bias.coefficients_px) value = dice.Between(-1, 1);
  if (dice.Below(2) == 0) drive.unix_start = Timestamp{1'700'000'000'000'000'000 + dice.Below(999)};
  drive.faults = static_cast<unsigned long>(dice.Between(0, 1 << kDriveFaultCount));
  return drive;
}

/// Keyframes along a road that starts anywhere.
void AppendKeyframes(DriveId drive, uint32_t count, Dice& dice, LeanMap& map) {
  Rigid3 pose;
  pose.rotation = RotationExp({0, dice.Between(-3, 3), 0});
  pose.translation = {dice.Between(-100, 100), 0, dice.Between(-100, 100)};
  KeyframeId id{drive, dice.Below(5)};
  int64_t ns = 0;
  const bool has_gps = dice.Below(2) == 0;
  for (uint32_t i = 0; i < count; ++i) {
    LeanKeyframe keyframe;
    keyframe.id = id;
    keyframe.timestamp = {ns};
    keyframe.map_from_camera = pose;
    if (has_gps && dice.Below(4) != 0) {
      keyframe.gps = GpsFix{49 + 1e-5 * i, 8.4 + dice.Between(0, 1e-5), dice.Between(110, 113)};
    }
    keyframe.is_stub = dice.Below(8) == 0;
    map.keyframes.push_back(keyframe);
    id.index += 1 + dice.Below(3);
    ns += 103'000'000 + dice.Below(1'000'000);
    const Rigid3 step{RotationExp({dice.Between(-0.01, 0.01), dice.Between(-0.05, 0.05), 0}),
                      {0, 0, dice.Between(0.7, 1.3)}};
    pose = pose * step;
  }
}

LeanLandmark RandomLandmark(uint32_t first_keyframe, Dice& dice, const LeanMap& map) {
  LeanLandmark landmark;
  const double depth = 4 * std::exp(dice.Between(0, std::log(150.0 / 4)));
  const Eigen::Vector3d p_in_camera{dice.Between(-0.85, 0.85) * depth,
                                    dice.Between(-0.26, 0.26) * depth, depth};
  landmark.position_in_map = map.keyframes[first_keyframe].map_from_camera * p_in_camera;
  for (uint64_t& word : landmark.descriptor.words) word = dice.Bits();
  landmark.anchor_level = static_cast<uint8_t>(std::min(dice.Below(8), dice.Below(8)));
  uint32_t keyframe = first_keyframe;
  do {
    landmark.keyframe_idxs.push_back(keyframe);
    keyframe += dice.Below(12) == 0 ? 2 : 1;
  } while (keyframe < map.keyframes.size() && dice.Below(5) != 0);
  landmark.drive_count = static_cast<uint8_t>(1 + dice.Below(3));
  const auto views = static_cast<uint32_t>(landmark.keyframe_idxs.size());
  landmark.anchor_idx = dice.Below(4) == 0 ? landmark.keyframe_idxs[dice.Below(views)]
                                           : landmark.keyframe_idxs.back();
  return landmark;
}

bool AreIdentical(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

}  // namespace

LeanMap RandomStreet(uint64_t seed, const RandomMapOptions& options) {
  Dice dice(seed);
  LeanMap map;
  for (uint32_t i = 0; i < options.drives; ++i) map.drives.push_back(RandomDrive(dice));
  const auto is_before = [](const LeanDrive& a, const LeanDrive& b) { return a.id < b.id; };
  std::sort(map.drives.begin(), map.drives.end(), is_before);
  for (const LeanDrive& drive : map.drives) {
    AppendKeyframes(drive.id, options.keyframes_per_drive, dice, map);
  }
  LandmarkId id;
  for (uint32_t k = 0; k < map.keyframes.size(); ++k) {
    const DriveId drive = map.keyframes[k].id.drive;
    if (drive != id.drive) id = {drive, 0};
    for (uint32_t i = 0; i < options.landmarks_per_keyframe; ++i) {
      map.landmarks.push_back(RandomLandmark(k, dice, map));
      map.landmarks.back().id = id;
      id.index += 1 + (dice.Below(3) == 0 ? dice.Below(4) : 0);
    }
  }
  return map;
}

bool AreIdentical(const LeanMap& a, const LeanMap& b) {
  const auto same_drive = [](const LeanDrive& x, const LeanDrive& y) {
    return x.id == y.id && x.rig == y.rig && x.faults == y.faults && x.unix_start == y.unix_start;
  };
  const auto same_keyframe = [](const LeanKeyframe& x, const LeanKeyframe& y) {
    return x.id == y.id && x.timestamp == y.timestamp && x.gps == y.gps && x.is_stub == y.is_stub &&
           AreIdentical(x.map_from_camera, y.map_from_camera);
  };
  const auto same_landmark = [](const LeanLandmark& x, const LeanLandmark& y) {
    return x.id == y.id && x.position_in_map == y.position_in_map && x.descriptor == y.descriptor &&
           x.anchor_level == y.anchor_level && x.drive_count == y.drive_count &&
           x.anchor_idx == y.anchor_idx && x.keyframe_idxs == y.keyframe_idxs;
  };
  return std::equal(a.drives.begin(), a.drives.end(), b.drives.begin(), b.drives.end(),
                    same_drive) &&
         std::equal(a.keyframes.begin(), a.keyframes.end(), b.keyframes.begin(), b.keyframes.end(),
                    same_keyframe) &&
         std::equal(a.landmarks.begin(), a.landmarks.end(), b.landmarks.begin(), b.landmarks.end(),
                    same_landmark);
}

}  // namespace carmap
