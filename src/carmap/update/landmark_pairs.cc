#include "carmap/update/landmark_pairs.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

// What the views do not tell: a corner looks a little different from elsewhere, and the poses of
// the views err together.
constexpr double kPositionFloorM = 0.02;
// Views from one drive share their keyframes' errors, so more of them do not sharpen a position.
constexpr double kMaxViewsOfDrive = 1;
// So many views, evenly out of more, say how uncertain a position is.
constexpr size_t kViewsLookedAt = 8;

constexpr double kLeastInformation = 1e-6;  // of a position known to a kilometre

constexpr int kTaken = -1;

struct CountedPair {
  LandmarkPair pair;
  int count = 0;
};

std::vector<CountedPair> Count(std::vector<LandmarkPair> matches) {
  std::sort(matches.begin(), matches.end());
  std::vector<CountedPair> counted;
  for (const LandmarkPair& match : matches) {
    if (counted.empty() || counted.back().pair != match) counted.push_back({match, 0});
    ++counted.back().count;
  }
  return counted;
}

/// What one drive tells of a landmark's position.
struct DriveInformation {
  Eigen::Matrix3d of_views = Eigen::Matrix3d::Zero();
  double views = 0;

  Eigen::Matrix3d Total() const {
    if (views == 0) return Eigen::Matrix3d::Zero();
    Eigen::Matrix3d information = of_views * std::min(1.0, kMaxViewsOfDrive / views);
    information.diagonal().array() += kLeastInformation;
    Eigen::Matrix3d covariance = information.inverse();
    covariance.diagonal().array() += kPositionFloorM * kPositionFloorM;
    return covariance.inverse();
  }
};

}  // namespace

std::vector<LandmarkPair> MostFrequent(std::vector<LandmarkPair> matches, size_t base_count,
                                       size_t segment_count) {
  const std::vector<CountedPair> counted = Count(std::move(matches));
  std::vector<int> most_of_base(base_count, 0), most_of_segment(segment_count, 0);
  for (const auto& [pair, count] : counted) {
    most_of_base[pair.base_idx] = std::max(most_of_base[pair.base_idx], count);
    most_of_segment[pair.segment_idx] = std::max(most_of_segment[pair.segment_idx], count);
  }
  std::vector<LandmarkPair> pairs;
  for (const auto& [pair, count] : counted) {
    int &of_base = most_of_base[pair.base_idx], &of_segment = most_of_segment[pair.segment_idx];
    if (count != of_base || count != of_segment) continue;
    of_base = of_segment = kTaken;
    pairs.push_back(pair);
  }
  return pairs;
}

Eigen::Matrix3d LandmarkCovariance(const ReconstructedMap& map, uint32_t landmark_idx,
                                   const MeasurementNoise& noise) {
  const SnapshotLandmark& landmark = map.snapshot.landmarks[landmark_idx];
  const std::span<const uint32_t> viewers = map.keyframes_of_landmark[landmark_idx];
  const size_t looked_at = std::min(viewers.size(), kViewsLookedAt);
  static const double max_scale = std::pow(kLevelScale, kLevelCount - 1);
  const double scale_at_1m = std::pow(kLevelScale, landmark.level_at_1m);
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  DriveInformation drive;  // of the viewers, which come drive by drive
  DriveId drive_id = map.snapshot.keyframes[viewers.front()].id.drive;
  int drives = 1;
  for (size_t i = 0; i < looked_at; ++i) {
    const uint32_t keyframe_idx = viewers[i * viewers.size() / looked_at];
    const SnapshotKeyframe& keyframe = map.snapshot.keyframes[keyframe_idx];
    if (keyframe.id.drive != drive_id) {
      information += std::exchange(drive, {}).Total();
      drive_id = keyframe.id.drive;
      ++drives;
    }
    const Rigid3& map_from_camera = keyframe.map_from_camera;
    const Eigen::Vector3d p = map_from_camera.Inverse() * landmark.position_in_map;
    if (p.z() < 0.1) continue;
    // That of the level that PredictLevel gives.
    const double scale = std::clamp(scale_at_1m / p.norm(), 1.0, max_scale);
    const WhitenedMeasurement view = Whiten(noise, {0, 0}, 1, scale);
    const Eigen::Matrix3d jacobian = WhitenedErrorJacobian(RigOf(map, keyframe_idx), view, p) *
                                     map_from_camera.rotation.conjugate().toRotationMatrix();
    drive.of_views += jacobian.transpose() * jacobian;
    ++drive.views;
  }
  information += drive.Total();
  // Drives whose keyframes the map does not keep saw it as well as those that it keeps.
  information *= std::max(1.0, static_cast<double>(landmark.drive_count) / drives);
  information.diagonal().array() += kLeastInformation;
  return information.inverse();
}

}  // namespace carmap
