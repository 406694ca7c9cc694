// A street that leads back to where it begins, and what driving along it maps. For the tests of
// loops.
//
// Frames follow each other so closely that all are keyframes; they are tracked as MapDrive does it.
#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

#include "carmap/map/test_street.h"
#include "carmap/slam/local_mapper.h"
#include "carmap/slam/tracker.h"

namespace carmap {

/// Where a vehicle is that has driven so far on a circle, in a world where y points down.
inline Rigid3 OnRound(double driven_m, double circumference_m) {
  const double radius = circumference_m / (2 * std::numbers::pi), angle = driven_m / radius;
  return {RotationExp({0, angle, 0}),
          {radius * (1 - std::cos(angle)), 0, radius * std::sin(angle)}};
}

/// Façades on both sides of a circle. `period_m`, if positive, is the length after which all of it
/// looks the same again.
inline Street MakeRoundStreet(uint64_t seed, double circumference_m, double period_m = 0,
                              double corners_per_m = 20) {
  StreetRandom random(seed);
  Street street;
  const double length_m = period_m > 0 ? period_m : circumference_m;
  for (int i = 0; i < static_cast<int>(length_m * corners_per_m); ++i) {
    const double side = random.Bits() % 2 ? 1 : -1;
    const Eigen::Vector3d beside(side * random.Uniform(7, 14), random.Uniform(-5, 1.5), 0);
    const double along_m = random.Uniform(0, length_m);
    const Descriptor descriptor = random.RandomDescriptor();
    const double level_at_1m = random.Uniform(15, 20);
    for (double shift_m = 0; shift_m < circumference_m - 1e-6; shift_m += length_m) {
      street.corners.push_back(
          {OnRound(along_m + shift_m, circumference_m) * beside, descriptor, level_at_1m});
    }
  }
  return street;
}

struct RoundOptions {
  double circumference_m = 240;
  double step_m = 1.5;
  StreetNoise noise{.pixel_px = 0.2, .descriptor_bits = 6};
  /// Of the camera that sees, against the rig that the mapper believes in: the map drifts.
  double focal_error = 0.01;
};

/// Drives on and on, one keyframe a step.
class RoundDrive {
 public:
  RoundDrive(const Street& street, const RoundOptions& options)
      : street_(street), options_(options), mapper_(kStreetRig, kDrive, {}), tracker_({}) {}

  static constexpr DriveId kDrive{7};

  /// The next keyframe; nothing when it could not be tracked.
  std::optional<KeyframeId> Step() {
    const uint32_t index = next_++;
    const Timestamp timestamp = Timestamp::FromSeconds(0.15 * index);
    StereoRig seeing = kStreetRig;
    seeing.camera.fx *= 1 + options_.focal_error;
    auto features = std::make_shared<const std::vector<Feature>>(
        SeeStreet(street_, seeing, Truth(index), options_.noise, index + 1));
    TrackedFrame tracked = tracker_.Track(timestamp, *features, local_.get());
    if (!tracked.reference && !tracked.wants_keyframe) return std::nullopt;
    NewKeyframe keyframe;
    keyframe.keyframe.id = {kDrive, index};
    keyframe.keyframe.timestamp = timestamp;
    keyframe.keyframe.map_from_camera = tracked.map_from_camera;
    keyframe.keyframe.features = features;
    if (fix_) keyframe.keyframe.gps = fix_(Truth(index).translation);
    keyframe.landmark_of_feature = tracked.landmark_of_feature;
    local_ = mapper_.Insert(keyframe);
    return keyframe.keyframe.id;
  }

  /// Goes on in the map as others have changed it.
  void Follow(KeyframeId newest) { local_ = mapper_.MapAround(newest); }

  /// Gives each keyframe from now on a GPS fix, made of its true position.
  void SetFixes(std::function<std::optional<GpsFix>(const Eigen::Vector3d&)> fix) {
    fix_ = std::move(fix);
  }

  Rigid3 Truth(uint32_t index) const {
    return OnRound(options_.step_m * index, options_.circumference_m);
  }
  /// Distance of a keyframe from where it truly is relative to another.
  double ErrorBetween(KeyframeId from, KeyframeId to) const {
    const Rigid3 estimated = mapper_.map().Find(from)->map_from_camera.Inverse() *
                             mapper_.map().Find(to)->map_from_camera;
    return (estimated.translation - (Truth(from.index).Inverse() * Truth(to.index)).translation)
        .norm();
  }
  LocalMapper& mapper() { return mapper_; }
  const Map& map() const { return mapper_.map(); }

 private:
  const Street& street_;
  const RoundOptions options_;
  LocalMapper mapper_;
  Tracker tracker_;
  std::shared_ptr<const LocalMap> local_;
  std::function<std::optional<GpsFix>(const Eigen::Vector3d&)> fix_;
  uint32_t next_ = 0;
};

}  // namespace carmap
