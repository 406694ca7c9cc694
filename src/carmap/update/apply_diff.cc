#include "carmap/update/apply_diff.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/index/reconstruct.h"
#include "carmap/map/by_id.h"
#include "carmap/update/landmark_pairs.h"
#include "carmap/update/merged_position.h"

namespace carmap {
namespace {

/// Index of the record with this id, of records ascending by id.
template <typename Record>
std::optional<uint32_t> FindIdx(const std::vector<Record>& records,
                                const decltype(Record::id)& id) {
  const Record* found = FindById(records, id);
  if (found == nullptr) return std::nullopt;
  return static_cast<uint32_t>(found - records.data());
}

/// Keyframes of the base that stand for keyframes of the segment.
class StandIns {
 public:
  StandIns(const LeanMap& base_lean, const ReconstructedMap& base, const ApplyOptions& options)
      : base_lean_(base_lean), base_(base), options_(options) {
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
      if (base_lean_.keyframes[idx].is_stub || turn_rad > options_.same_place_rad ||
          landmarks_[idx] + landmarks > options_.max_landmarks) {
        continue;
      }
      landmarks_[idx] += landmarks;
      return idx;
    }
    return std::nullopt;
  }

 private:
  const LeanMap& base_lean_;
  const ReconstructedMap& base_;
  const ApplyOptions& options_;
  std::vector<size_t> landmarks_;  ///< of each keyframe of the base, with what it took in
};

/// The landmarks of both that are still there, each once.
std::vector<LandmarkPair> PairsOf(const MapDiff& diff, const LeanMap& base) {
  std::vector<LandmarkPair> pairs;
  std::vector<bool> is_paired(diff.drive.landmarks.size(), false);
  for (const SameLandmark& same : diff.seen_again) {
    const auto base_idx = FindIdx(base.landmarks, same.in_base);
    const auto drive_idx = FindIdx(diff.drive.landmarks, same.in_drive);
    if (!base_idx || !drive_idx || is_paired[*drive_idx]) continue;
    if (!pairs.empty() && pairs.back().base_idx == *base_idx) continue;
    is_paired[*drive_idx] = true;
    pairs.push_back({*base_idx, *drive_idx});
  }
  return pairs;
}

/// Puts the drive's records into the base's.
class Merger {
 public:
  Merger(const LeanMap& base, const LeanMap& drive, const ReconstructedMap& base_map,
         const ReconstructedMap& drive_map, const ApplyOptions& options)
      : base_(base), drive_(drive), drive_map_(drive_map), options_(options) {
    MergeDrives();
    MergeKeyframes(StandIns(base, base_map, options));
    places_.resize(merged_.keyframes.size());
    for (const uint32_t place : base_places_) places_[place].is_of_base = true;
    for (const LeanLandmark& landmark : base.landmarks) {
      ++places_[base_places_[landmark.anchor_idx]].of_base;
    }
  }

  LeanMap Run(const std::vector<MergedLandmark>& same) && {
    for (LeanLandmark landmark : base_.landmarks) {
      for (uint32_t& idx : landmark.keyframe_idxs) idx = base_places_[idx];
      landmark.anchor_idx = base_places_[landmark.anchor_idx];
      merged_.landmarks.push_back(std::move(landmark));
    }
    std::vector<const MergedLandmark*> in_base(drive_.landmarks.size(), nullptr);
    for (const MergedLandmark& landmark : same) in_base[landmark.pair.segment_idx] = &landmark;
    for (uint32_t i = 0; i < drive_.landmarks.size(); ++i) {
      if (in_base[i]) {
        MergeInto(merged_.landmarks[in_base[i]->pair.base_idx], i, in_base[i]->position_in_base);
      } else if (!FindIdx(base_.landmarks, drive_.landmarks[i].id)) {
        Add(i);
      }
    }
    MakeWay();
    std::sort(merged_.landmarks.begin(), merged_.landmarks.end(), kById);
    return std::move(merged_);
  }

 private:
  void MergeDrives() {
    merged_.drives = base_.drives;
    for (const LeanDrive& drive : drive_.drives) {
      if (FindDrive(base_.drives, drive.id) == nullptr) merged_.drives.push_back(drive);
    }
    std::sort(merged_.drives.begin(), merged_.drives.end(), kById);
  }

  void MergeKeyframes(StandIns stand_ins) {
    merged_.keyframes = base_.keyframes;
    std::vector<KeyframeId> shown_by;  // of each keyframe of the drive
    for (uint32_t i = 0; i < drive_.keyframes.size(); ++i) {
      const LeanKeyframe& keyframe = drive_.keyframes[i];
      shown_by.push_back(keyframe.id);
      if (FindIdx(base_.keyframes, keyframe.id)) continue;
      if (const auto stand_in = stand_ins.Find(
              keyframe.map_from_camera, drive_map_.snapshot.keyframes[i].landmark_idxs.size())) {
        shown_by.back() = base_.keyframes[*stand_in].id;
      } else {
        merged_.keyframes.push_back(keyframe);
      }
    }
    std::sort(merged_.keyframes.begin(), merged_.keyframes.end(), kById);
    for (const LeanKeyframe& keyframe : base_.keyframes) {
      base_places_.push_back(*FindIdx(merged_.keyframes, keyframe.id));
    }
    for (const KeyframeId& id : shown_by) {
      drive_places_.push_back(*FindIdx(merged_.keyframes, id));
    }
  }

  std::vector<uint32_t> PlacesOf(const LeanLandmark& landmark) const {
    std::vector<uint32_t> places;
    for (const uint32_t idx : landmark.keyframe_idxs) places.push_back(drive_places_[idx]);
    std::sort(places.begin(), places.end());
    places.erase(std::unique(places.begin(), places.end()), places.end());
    return places;
  }

  /// The level at which its anchor, which may stand for the drive's, sees the landmark.
  uint8_t AnchorLevel(const LeanLandmark& landmark, uint32_t drive_idx) const {
    const DriveId anchor_drive = merged_.keyframes[landmark.anchor_idx].id.drive;
    const StereoRig& rig = FindDrive(merged_.drives, anchor_drive)->rig;
    return FeatureOf(drive_map_, drive_map_.snapshot.landmarks[drive_idx], rig,
                     PositionInAnchor(merged_, landmark))
        .level;
  }

  void Add(uint32_t drive_idx) {
    LeanLandmark landmark = drive_.landmarks[drive_idx];
    const bool keeps_anchor = merged_.keyframes[drive_places_[landmark.anchor_idx]].id ==
                              drive_.keyframes[landmark.anchor_idx].id;
    landmark.keyframe_idxs = PlacesOf(landmark);
    landmark.anchor_idx = drive_places_[landmark.anchor_idx];
    if (!keeps_anchor) landmark.anchor_level = AnchorLevel(landmark, drive_idx);
    const size_t place = landmark.anchor_idx;
    if (places_[place].is_of_base) ++places_[place].of_drive;
    merged_.landmarks.push_back(std::move(landmark));
  }

  /// What the drive saw of a landmark that the base has.
  void MergeInto(LeanLandmark& kept, uint32_t drive_idx, const Eigen::Vector3d& position) {
    kept.position_in_map = position;
    const std::vector<uint32_t> places = PlacesOf(drive_.landmarks[drive_idx]);
    std::vector<uint32_t> seen_by;
    std::set_union(kept.keyframe_idxs.begin(), kept.keyframe_idxs.end(), places.begin(),
                   places.end(), std::back_inserter(seen_by));
    kept.keyframe_idxs = std::move(seen_by);
    kept.drive_count = static_cast<uint8_t>(std::min(255, kept.drive_count + 1));
    ++places_[kept.anchor_idx].of_drive;
    is_seen_again_.insert(kept.id);
  }

  /// Landmarks of the base that this drive did not see come first, then those that few drives saw.
  bool GoesBefore(const LeanLandmark& a, const LeanLandmark& b) const {
    const auto rank = [&](const LeanLandmark& landmark) {
      return std::tuple(landmark.drive_count + (IsNew(landmark) || IsSeenAgain(landmark)),
                        landmark.id);
    };
    return rank(a) < rank(b);
  }
  bool IsNew(const LeanLandmark& landmark) const { return !FindIdx(base_.landmarks, landmark.id); }
  bool IsSeenAgain(const LeanLandmark& landmark) const {
    return is_seen_again_.contains(landmark.id);
  }

  /// Where the base had keyframes: no more landmarks than before, or than some more than the drive
  /// would hang there by itself.
  void MakeWay() {
    std::vector<std::vector<uint32_t>> hanging(merged_.keyframes.size());
    for (uint32_t i = 0; i < merged_.landmarks.size(); ++i) {
      hanging[merged_.landmarks[i].anchor_idx].push_back(i);
    }
    std::vector<bool> goes(merged_.landmarks.size(), false);
    for (size_t k = 0; k < hanging.size(); ++k) {
      if (places_[k].of_drive == 0) continue;
      const auto of_drive = static_cast<double>(places_[k].of_drive);
      const size_t budget = std::max(
          places_[k].of_base, static_cast<size_t>(std::ceil(options_.max_growth * of_drive)));
      if (hanging[k].size() > budget) Choose(hanging[k], budget, of_drive, goes);
    }
    size_t kept = 0;
    for (size_t i = 0; i < merged_.landmarks.size(); ++i) {
      if (goes[i]) continue;
      if (kept < i) merged_.landmarks[kept] = std::move(merged_.landmarks[i]);
      ++kept;
    }
    merged_.landmarks.resize(kept);
  }

  /// Of the landmarks that hang on one keyframe, those that go.
  void Choose(std::vector<uint32_t>& hanging, size_t budget, double of_drive,
              std::vector<bool>& goes) const {
    std::sort(hanging.begin(), hanging.end(), [&](uint32_t a, uint32_t b) {
      return GoesBefore(merged_.landmarks[a], merged_.landmarks[b]);
    });
    const auto sheltered = static_cast<size_t>(options_.min_new_share * of_drive);
    size_t excess = hanging.size() - budget, new_ones = 0;
    for (const uint32_t i : hanging) new_ones += IsNew(merged_.landmarks[i]);
    for (const uint32_t i : hanging) {
      if (excess == 0) break;
      const bool is_new = IsNew(merged_.landmarks[i]);
      if (is_new && new_ones <= sheltered) continue;
      goes[i] = true;
      new_ones -= is_new;
      --excess;
    }
  }

  const LeanMap &base_, &drive_;
  const ReconstructedMap& drive_map_;
  const ApplyOptions& options_;
  LeanMap merged_;
  /// What hangs on a merged keyframe.
  struct Place {
    bool is_of_base = false;
    size_t of_base = 0;   ///< landmarks that the base had there
    size_t of_drive = 0;  ///< that the drive has there, new ones and others
  };
  std::vector<Place> places_;
  std::set<LandmarkId> is_seen_again_;
  /// Where the keyframes of both, or what stands for them, are among the merged ones.
  std::vector<uint32_t> base_places_, drive_places_;
};

}  // namespace

absl::StatusOr<LeanMap> Apply(const MapDiff& diff, const LeanMap& base,
                              const ApplyOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckConsistency(diff.drive));
  const ReconstructedMap drive_map = Reconstruct(diff.drive);
  const ReconstructedMap base_map = Reconstruct(base, drive_map.focal_length_px);
  const std::vector<MergedLandmark> same =
      MergePositions(base_map, drive_map, PairsOf(diff, base), options.noise);
  LeanMap merged = Merger(base, diff.drive, base_map, drive_map, options).Run(same);
  CARMAP_RETURN_IF_ERROR(CheckConsistency(merged));
  return merged;
}

}  // namespace carmap
