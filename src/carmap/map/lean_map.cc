#include "carmap/map/lean_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "carmap/base/status_macros.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

absl::Status Broken(const char* kind, size_t idx, const std::string& what) {
  return absl::InvalidArgumentError(fmt::format("{} {} of the map {}", kind, idx, what));
}

bool IsUsable(const StereoRig& rig) {
  const PinholeCamera& camera = rig.camera;
  const auto is_between = [](double low, double value, double high) {
    return low <= value && value <= high;  // false of what is not finite
  };
  const Eigen::Vector3d& bias_px = rig.disparity_bias.coefficients_px;
  constexpr double kMaxBiasPx = 100;
  return is_between(1, camera.fx, kMaxRigPx) && is_between(1, camera.fy, kMaxRigPx) &&
         is_between(-kMaxRigPx, camera.cx, kMaxRigPx) &&
         is_between(-kMaxRigPx, camera.cy, kMaxRigPx) && camera.width > 0 && camera.height > 0 &&
         camera.width <= kMaxImageSidePx && camera.height <= kMaxImageSidePx &&
         is_between(1e-6, rig.baseline_m, kMaxBaselineM) && bias_px.allFinite() &&
         bias_px.cwiseAbs().maxCoeff() <= kMaxBiasPx;
}

/// The records' ids must rise; `kind` names one.
template <typename Record>
absl::Status CheckAscending(const std::vector<Record>& records, const char* kind) {
  for (size_t i = 1; i < records.size(); ++i) {
    if (records[i - 1].id >= records[i].id) {
      return Broken(kind, i, "does not follow the one before it in the order of ids");
    }
  }
  return absl::OkStatus();
}

absl::Status CheckKeyframe(const LeanMap& map, size_t idx) {
  const LeanKeyframe& keyframe = map.keyframes[idx];
  if (FindDrive(map.drives, keyframe.id.drive) == nullptr) {
    return Broken("keyframe", idx, "belongs to a drive that the map does not list");
  }
  if (!keyframe.timestamp.is_in_range()) {
    return Broken("keyframe", idx, "has a time more than 95 years from 0");
  }
  if (!IsRigid(keyframe.map_from_camera)) {
    return Broken("keyframe", idx, "has a pose that is not finite or not a rotation");
  }
  if (keyframe.gps && !IsValid(*keyframe.gps)) {
    return Broken("keyframe", idx, "has a GPS fix that is not on the globe");
  }
  return absl::OkStatus();
}

absl::Status CheckLandmark(const LeanMap& map, size_t idx) {
  const LeanLandmark& landmark = map.landmarks[idx];
  if (FindDrive(map.drives, landmark.id.drive) == nullptr) {
    return Broken("landmark", idx, "belongs to a drive that the map does not list");
  }
  if (!landmark.position_in_map.allFinite()) {
    return Broken("landmark", idx, "has a position that is not finite");
  }
  if (landmark.anchor_level >= kLevelCount) {
    return Broken("landmark", idx, fmt::format("has pyramid level {}", landmark.anchor_level));
  }
  if (landmark.drive_count == 0) return Broken("landmark", idx, "was seen by no drive");
  const std::vector<uint32_t>& seen_by = landmark.keyframe_idxs;
  if (seen_by.empty()) return Broken("landmark", idx, "is seen by no keyframe");
  const auto is_not_below = [](uint32_t a, uint32_t b) { return a >= b; };
  if (std::adjacent_find(seen_by.begin(), seen_by.end(), is_not_below) != seen_by.end()) {
    return Broken("landmark", idx, "has a keyframe list that does not ascend");
  }
  if (seen_by.back() >= map.keyframes.size()) {
    return Broken("landmark", idx, "is seen by a keyframe that the map does not list");
  }
  if (!std::binary_search(seen_by.begin(), seen_by.end(), landmark.anchor_idx)) {
    return Broken("landmark", idx, "has an anchor that does not see it");
  }
  return absl::OkStatus();
}

/// A keyframe sees each of its landmarks as a feature of its own.
absl::Status CheckLandmarksOfKeyframes(const LeanMap& map) {
  std::vector<size_t> counts(map.keyframes.size(), 0);
  for (const LeanLandmark& landmark : map.landmarks) {
    for (const uint32_t keyframe_idx : landmark.keyframe_idxs) ++counts[keyframe_idx];
  }
  for (size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] <= kMaxLandmarksOfKeyframe) continue;
    return Broken("keyframe", i,
                  fmt::format("sees {} landmarks, more than the {} that an image can show",
                              counts[i], kMaxLandmarksOfKeyframe));
  }
  return absl::OkStatus();
}

}  // namespace

const LeanDrive* FindDrive(const std::vector<LeanDrive>& drives, DriveId id) {
  return FindById(drives, id);
}

absl::Status CheckConsistency(const LeanMap& map) {
  CARMAP_RETURN_IF_ERROR(CheckAscending(map.drives, "drive"));
  CARMAP_RETURN_IF_ERROR(CheckAscending(map.keyframes, "keyframe"));
  CARMAP_RETURN_IF_ERROR(CheckAscending(map.landmarks, "landmark"));
  for (size_t i = 0; i < map.drives.size(); ++i) {
    if (!IsUsable(map.drives[i].rig)) {
      return Broken("drive", i, "has a stereo rig that no camera can have");
    }
    if (map.drives[i].unix_start && !map.drives[i].unix_start->is_in_range()) {
      return Broken("drive", i, "begins more than 95 years from 1970");
    }
  }
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    CARMAP_RETURN_IF_ERROR(CheckKeyframe(map, i));
  }
  for (size_t i = 0; i < map.landmarks.size(); ++i) {
    CARMAP_RETURN_IF_ERROR(CheckLandmark(map, i));
  }
  return CheckLandmarksOfKeyframes(map);
}

Eigen::Vector3d PositionInAnchor(const LeanMap& map, const LeanLandmark& landmark) {
  const Rigid3& map_from_camera = map.keyframes[landmark.anchor_idx].map_from_camera;
  return map_from_camera.rotation.conjugate() *
         (landmark.position_in_map - map_from_camera.translation);
}

LeanMap Moved(LeanMap map, const Rigid3& new_from_map) {
  for (LeanKeyframe& keyframe : map.keyframes) {
    keyframe.map_from_camera = new_from_map * keyframe.map_from_camera;
  }
  for (LeanLandmark& landmark : map.landmarks) {
    landmark.position_in_map = new_from_map * landmark.position_in_map;
  }
  return map;
}

double PathLengthM(const LeanMap& map) {
  double length_m = 0;
  for (size_t i = 1; i < map.keyframes.size(); ++i) {
    const LeanKeyframe &from = map.keyframes[i - 1], &to = map.keyframes[i];
    if (from.id.drive != to.id.drive) continue;
    length_m += (to.map_from_camera.translation - from.map_from_camera.translation).norm();
  }
  return length_m;
}

}  // namespace carmap
