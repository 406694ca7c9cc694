#include "carmap/update/merge_segment.h"

#include <Eigen/LU>
#include <algorithm>
#include <cstdint>
#include <iterator>
#include <optional>
#include <utility>

namespace carmap {
namespace {

std::vector<Eigen::Vector3d> PositionsInBase(const ReconstructedMap& segment,
                                             const std::vector<Rigid3>& base_from_camera) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(segment.snapshot.landmarks.size());
  for (uint32_t i = 0; i < segment.snapshot.landmarks.size(); ++i) {
    const Eigen::Vector3d& position = segment.snapshot.landmarks[i].position_in_map;
    const auto distance_from = [&](uint32_t keyframe_idx) {
      const auto& keyframe = segment.snapshot.keyframes[keyframe_idx];
      return (keyframe.map_from_camera.translation - position).squaredNorm();
    };
    const auto viewers = segment.keyframes_of_landmark[i];
    const uint32_t nearest = *std::min_element(
        viewers.begin(), viewers.end(),
        [&](uint32_t a, uint32_t b) { return distance_from(a) < distance_from(b); });
    const Rigid3& segment_from_camera = segment.snapshot.keyframes[nearest].map_from_camera;
    positions.push_back(base_from_camera[nearest] * (segment_from_camera.Inverse() * position));
  }
  return positions;
}

/// Both positions weighted by what is known of them; nothing if they are not of one place.
std::optional<MergedLandmark> MergePositions(const ReconstructedMap& base,
                                             const ReconstructedMap& segment,
                                             const LandmarkPair& pair, const PlacedSegment& placed,
                                             const MeasurementNoise& noise) {
  constexpr double kFitSigmaM = 0.05;         // of the bent segment, common to its landmarks there
  constexpr double kChiSquareBound = 16.266;  // 99.9 %, three degrees of freedom
  const uint32_t viewer = segment.keyframes_of_landmark[pair.segment_idx].front();
  const Eigen::Matrix3d base_from_segment =
      (placed.fit.base_from_camera[viewer].rotation *
       segment.snapshot.keyframes[viewer].map_from_camera.rotation.conjugate())
          .toRotationMatrix();
  const Eigen::Matrix3d by_base = LandmarkCovariance(base, pair.base_idx, noise);
  Eigen::Matrix3d by_segment = base_from_segment *
                               LandmarkCovariance(segment, pair.segment_idx, noise) *
                               base_from_segment.transpose();
  by_segment.diagonal().array() += kFitSigmaM * kFitSigmaM;
  const Eigen::Vector3d& p_by_base = base.snapshot.landmarks[pair.base_idx].position_in_map;
  const Eigen::Vector3d difference = placed.positions_in_base[pair.segment_idx] - p_by_base;
  const Eigen::Vector3d weighted = (by_base + by_segment).inverse() * difference;
  if (difference.dot(weighted) > kChiSquareBound) return std::nullopt;
  return MergedLandmark{pair, p_by_base + by_base * weighted, difference.norm()};
}

/// Keyframes of the base that stand for keyframes of the segment.
class StandIns {
 public:
  StandIns(const ReconstructedMap& base, const MergeOptions& options)
      : base_(base), options_(options) {
    for (const SnapshotKeyframe& keyframe : base.snapshot.keyframes) {
      landmarks_.push_back(keyframe.landmark_idxs.size());
    }
  }

  /// For a keyframe there that sees so many landmarks, if there is one.
  std::optional<uint32_t> Find(const Rigid3& base_from_camera, size_t landmarks) {
    constexpr size_t kMaxLookedAt = 64;
    for (const uint32_t idx : base_.keyframe_centers.WithinRadius(
             base_from_camera.translation, options_.same_place_m, kMaxLookedAt)) {
      const Rigid3& other = base_.snapshot.keyframes[idx].map_from_camera;
      const double turn_rad = RotationAngle(base_from_camera.rotation.conjugate() * other.rotation);
      if (turn_rad > options_.same_place_rad ||
          landmarks_[idx] + landmarks > options_.max_landmarks) {
        continue;
      }
      landmarks_[idx] += landmarks;
      return idx;
    }
    return std::nullopt;
  }

 private:
  const ReconstructedMap& base_;
  const MergeOptions& options_;
  std::vector<size_t> landmarks_;  ///< of each keyframe of the base, with what it took in
};

constexpr auto kById = [](const auto& a, const auto& b) { return a.id < b.id; };

uint32_t PlaceOf(KeyframeId id, const std::vector<LeanKeyframe>& keyframes) {
  const auto place = std::lower_bound(
      keyframes.begin(), keyframes.end(), id,
      [](const LeanKeyframe& keyframe, KeyframeId wanted) { return keyframe.id < wanted; });
  return static_cast<uint32_t>(place - keyframes.begin());
}

class Merger {
 public:
  Merger(const LeanMap& base, const LeanMap& segment, const ReconstructedMap& base_map,
         const ReconstructedMap& segment_map, const PlacedSegment& placed,
         const MergeOptions& options)
      : base_(base), segment_(segment), segment_map_(segment_map), placed_(placed) {
    MergeDrives();
    MergeKeyframes(StandIns(base_map, options));
  }

  LeanMap Run() && {
    for (LeanLandmark landmark : base_.landmarks) {
      for (uint32_t& idx : landmark.keyframe_idxs) idx = base_places_[idx];
      merged_.landmarks.push_back(std::move(landmark));
    }
    std::vector<const MergedLandmark*> in_base(segment_.landmarks.size(), nullptr);
    for (const MergedLandmark& landmark : placed_.merged) {
      in_base[landmark.pair.segment_idx] = &landmark;
    }
    for (uint32_t i = 0; i < segment_.landmarks.size(); ++i) {
      if (in_base[i]) {
        MergeInto(merged_.landmarks[in_base[i]->pair.base_idx], i, in_base[i]->position_in_base);
      } else {
        Add(i);
      }
    }
    std::sort(merged_.landmarks.begin(), merged_.landmarks.end(), kById);
    return std::move(merged_);
  }

 private:
  void MergeDrives() {
    merged_.drives = base_.drives;
    merged_.drives.insert(merged_.drives.end(), segment_.drives.begin(), segment_.drives.end());
    std::sort(merged_.drives.begin(), merged_.drives.end(), kById);
  }

  void MergeKeyframes(StandIns stand_ins) {
    merged_.keyframes = base_.keyframes;
    std::vector<KeyframeId> shown_by;  // of each keyframe of the segment
    for (uint32_t i = 0; i < segment_.keyframes.size(); ++i) {
      LeanKeyframe keyframe = segment_.keyframes[i];
      keyframe.map_from_camera = placed_.fit.base_from_camera[i];
      const auto stand_in = stand_ins.Find(keyframe.map_from_camera,
                                           segment_map_.snapshot.keyframes[i].landmark_idxs.size());
      shown_by.push_back(stand_in ? base_.keyframes[*stand_in].id : keyframe.id);
      if (!stand_in) merged_.keyframes.push_back(keyframe);
    }
    std::sort(merged_.keyframes.begin(), merged_.keyframes.end(), kById);
    for (const LeanKeyframe& keyframe : base_.keyframes) {
      base_places_.push_back(PlaceOf(keyframe.id, merged_.keyframes));
    }
    for (const KeyframeId& id : shown_by) {
      segment_places_.push_back(PlaceOf(id, merged_.keyframes));
    }
  }

  std::vector<uint32_t> PlacesOf(const LeanLandmark& landmark) const {
    std::vector<uint32_t> places;
    for (const uint32_t idx : landmark.keyframe_idxs) places.push_back(segment_places_[idx]);
    std::sort(places.begin(), places.end());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    return places;
  }

  /// The level at which the first keyframe of its list sees the landmark, as the segment saw it.
  uint8_t FirstLevel(const LeanLandmark& landmark, uint32_t segment_idx) const {
    const LeanKeyframe& first = merged_.keyframes[landmark.keyframe_idxs.front()];
    const StereoRig& rig = FindDrive(merged_.drives, first.id.drive)->rig;
    return FeatureOf(segment_map_, segment_map_.snapshot.landmarks[segment_idx], rig,
                     first.map_from_camera.Inverse() * landmark.position_in_map)
        .level;
  }

  void Add(uint32_t segment_idx) {
    LeanLandmark landmark = segment_.landmarks[segment_idx];
    landmark.position_in_map = placed_.positions_in_base[segment_idx];
    landmark.keyframe_idxs = PlacesOf(landmark);
    landmark.first_level = FirstLevel(landmark, segment_idx);
    merged_.landmarks.push_back(std::move(landmark));
  }

  /// What the segment saw of a landmark that the base has.
  void MergeInto(LeanLandmark& kept, uint32_t segment_idx, const Eigen::Vector3d& position) {
    kept.position_in_map = position;
    const uint32_t first = kept.keyframe_idxs.front();
    const std::vector<uint32_t> places = PlacesOf(segment_.landmarks[segment_idx]);
    std::vector<uint32_t> seen_by;
    std::set_union(kept.keyframe_idxs.begin(), kept.keyframe_idxs.end(), places.begin(),
                   places.end(), std::back_inserter(seen_by));
    kept.keyframe_idxs = std::move(seen_by);
    if (kept.keyframe_idxs.front() != first) kept.first_level = FirstLevel(kept, segment_idx);
  }

  const LeanMap &base_, &segment_;
  const ReconstructedMap& segment_map_;
  const PlacedSegment& placed_;
  LeanMap merged_;
  /// Where the keyframes of both, or what stands for them, are among the merged ones.
  std::vector<uint32_t> base_places_, segment_places_;
};

}  // namespace

PlacedSegment PlaceSegment(const ReconstructedMap& base, const ReconstructedMap& segment,
                           SegmentFit fit, const FitOptions& options) {
  PlacedSegment placed;
  placed.fit = std::move(fit);
  placed.positions_in_base = PositionsInBase(segment, placed.fit.base_from_camera);
  const auto pairs = MatchLandmarks(base, segment, placed.fit, options);
  placed.matches = pairs.size();
  for (const LandmarkPair& pair : pairs) {
    if (const auto merged = MergePositions(base, segment, pair, placed, options.tracking.noise)) {
      placed.merged.push_back(*merged);
    }
  }
  return placed;
}

LeanMap MergeSegment(const LeanMap& base, const LeanMap& segment, const ReconstructedMap& base_map,
                     const ReconstructedMap& segment_map, const PlacedSegment& placed,
                     const MergeOptions& options) {
  return Merger(base, segment, base_map, segment_map, placed, options).Run();
}

}  // namespace carmap
