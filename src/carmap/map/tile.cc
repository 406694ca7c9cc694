#include "carmap/map/tile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

/// Those of both, ascending by id; of one id that of `put`.
template <typename Record>
std::vector<Record> Merged(std::vector<Record> kept, const std::vector<Record>& put) {
  std::erase_if(kept, [&](const Record& record) { return FindById(put, record.id) != nullptr; });
  const auto middle = static_cast<ptrdiff_t>(kept.size());
  kept.insert(kept.end(), put.begin(), put.end());
  std::inplace_merge(kept.begin(), kept.begin() + middle, kept.end(), kById);
  return kept;
}

/// Removes the records with these ids, all of which must be there.
template <typename Record, typename Id>
absl::Status Remove(const std::vector<Id>& ids, const char* kind, std::vector<Record>& records) {
  const size_t before = records.size();
  std::erase_if(records, [&](const Record& record) {
    return std::binary_search(ids.begin(), ids.end(), record.id);
  });
  if (before - records.size() == ids.size()) return absl::OkStatus();
  return absl::InvalidArgumentError(fmt::format("the patch removes {} {}s of which the tile has {}",
                                                ids.size(), kind, before - records.size()));
}

/// Indices into `to` of the keyframes of `from`, to.size() for those that are not there.
std::vector<uint32_t> PlacesIn(const std::vector<LeanKeyframe>& to,
                               const std::vector<LeanKeyframe>& from) {
  std::vector<uint32_t> places;
  places.reserve(from.size());
  auto place = to.begin();
  for (const LeanKeyframe& keyframe : from) {
    place = std::lower_bound(place, to.end(), keyframe, kById);
    const bool is_there = place != to.end() && place->id == keyframe.id;
    places.push_back(static_cast<uint32_t>((is_there ? place : to.end()) - to.begin()));
  }
  return places;
}

void Renumber(const std::vector<uint32_t>& places, LeanLandmark& landmark) {
  for (uint32_t& idx : landmark.keyframe_idxs) idx = places[idx];
  landmark.anchor_idx = places[landmark.anchor_idx];
}

/// Landmarks of `from` in the map that has the keyframes of `to`: they ride on their anchors.
absl::Status Rebase(const LeanMap& from, const LeanMap& to, std::vector<LeanLandmark>& landmarks) {
  const std::vector<uint32_t> places = PlacesIn(to.keyframes, from.keyframes);
  const auto is_gone = [&](uint32_t idx) { return places[idx] == to.keyframes.size(); };
  for (LeanLandmark& landmark : landmarks) {
    if (std::any_of(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(), is_gone)) {
      return absl::InvalidArgumentError(
          "the patch removes a keyframe that a landmark still names in its list");
    }
    const Rigid3& before = from.keyframes[landmark.anchor_idx].map_from_camera;
    const Rigid3& after = to.keyframes[places[landmark.anchor_idx]].map_from_camera;
    if (before.translation != after.translation ||
        before.rotation.coeffs() != after.rotation.coeffs()) {
      landmark.position_in_map = after * PositionInAnchor(from, landmark);
    }
    Renumber(places, landmark);
  }
  return absl::OkStatus();
}

void DropWhatNothingRefersTo(LeanMap& map) {
  std::vector<bool> sees(map.keyframes.size(), false);
  for (const LeanLandmark& landmark : map.landmarks) {
    for (const uint32_t idx : landmark.keyframe_idxs) sees[idx] = true;
  }
  std::vector<LeanKeyframe> kept;
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    if (sees[i] || !map.keyframes[i].is_stub) kept.push_back(map.keyframes[i]);
  }
  if (kept.size() < map.keyframes.size()) {
    const std::vector<uint32_t> places = PlacesIn(kept, map.keyframes);
    for (LeanLandmark& landmark : map.landmarks) Renumber(places, landmark);
    map.keyframes = std::move(kept);
  }

  std::vector<DriveId> used;
  for (const LeanKeyframe& keyframe : map.keyframes) used.push_back(keyframe.id.drive);
  for (const LeanLandmark& landmark : map.landmarks) used.push_back(landmark.id.drive);
  std::sort(used.begin(), used.end());
  std::erase_if(map.drives, [&](const LeanDrive& drive) {
    return !std::binary_search(used.begin(), used.end(), drive.id);
  });
}

bool AreEqual(const LeanDrive& a, const LeanDrive& b) {
  return a.rig == b.rig && a.faults == b.faults && a.unix_start == b.unix_start;
}

bool AreEqual(const LeanKeyframe& a, const LeanKeyframe& b) {
  return a.timestamp == b.timestamp && a.gps == b.gps && a.is_stub == b.is_stub &&
         a.map_from_camera.translation == b.map_from_camera.translation &&
         a.map_from_camera.rotation.coeffs() == b.map_from_camera.rotation.coeffs();
}

/// Equal but for where their anchors are.
bool AreEqual(const LeanMap& map_a, const LeanLandmark& a, const LeanMap& map_b,
              const LeanLandmark& b) {
  // Far below the grid that positions are stored on, and far above what rounding changes.
  constexpr double kSamePositionM = 1e-5;
  if (a.descriptor != b.descriptor || a.anchor_level != b.anchor_level ||
      a.drive_count != b.drive_count || a.keyframe_idxs.size() != b.keyframe_idxs.size() ||
      map_a.keyframes[a.anchor_idx].id != map_b.keyframes[b.anchor_idx].id) {
    return false;
  }
  for (size_t i = 0; i < a.keyframe_idxs.size(); ++i) {
    if (map_a.keyframes[a.keyframe_idxs[i]].id != map_b.keyframes[b.keyframe_idxs[i]].id) {
      return false;
    }
  }
  return (PositionInAnchor(map_a, a) - PositionInAnchor(map_b, b)).cwiseAbs().maxCoeff() <
         kSamePositionM;
}

template <typename Record, typename Id>
std::vector<Id> Missing(const std::vector<Record>& of, const std::vector<Record>& in,
                        Id Record::*id) {
  std::vector<Id> missing;
  AscendingSearch search(in);
  for (const Record& record : of) {
    if (search.Find(record.id) == nullptr) missing.push_back(record.*id);
  }
  return missing;
}

}  // namespace

absl::StatusOr<Tile> Applied(const Patch& patch, const Tile& tile) {
  if (patch.tile != tile.id) {
    return absl::FailedPreconditionError("the patch is of another tile");
  }
  if (patch.from_version != tile.version || patch.to_version != tile.version + 1) {
    return absl::FailedPreconditionError(
        fmt::format("the patch leads from version {} to {}, the tile has version {}; fetch the "
                    "patches between, "
                    "or the tile",
                    patch.from_version, patch.to_version, tile.version));
  }
  CARMAP_RETURN_IF_ERROR(CheckConsistency(patch.put));
  Tile next{.id = tile.id, .version = patch.to_version, .map = {}};
  std::vector<LeanKeyframe> kept_keyframes = tile.map.keyframes;
  std::vector<LeanLandmark> kept_landmarks = tile.map.landmarks;
  CARMAP_RETURN_IF_ERROR(Remove(patch.removed_keyframes, "keyframe", kept_keyframes));
  CARMAP_RETURN_IF_ERROR(Remove(patch.removed_landmarks, "landmark", kept_landmarks));
  std::erase_if(kept_landmarks, [&](const LeanLandmark& landmark) {
    return FindById(patch.put.landmarks, landmark.id) != nullptr;
  });
  next.map.drives = Merged(tile.map.drives, patch.put.drives);
  next.map.keyframes = Merged(std::move(kept_keyframes), patch.put.keyframes);
  std::vector<LeanLandmark> put = patch.put.landmarks;
  CARMAP_RETURN_IF_ERROR(Rebase(tile.map, next.map, kept_landmarks));
  CARMAP_RETURN_IF_ERROR(Rebase(patch.put, next.map, put));
  next.map.landmarks = Merged(std::move(kept_landmarks), put);
  CARMAP_RETURN_IF_ERROR(CheckConsistency(next.map));
  DropWhatNothingRefersTo(next.map);
  return next;
}

bool IsEmpty(const Patch& patch) {
  return patch.put.drives.empty() && patch.put.keyframes.empty() && patch.put.landmarks.empty() &&
         patch.removed_keyframes.empty() && patch.removed_landmarks.empty();
}

Patch DifferenceOf(const Tile& from, const Tile& to) {
  Patch patch{.tile = to.id, .from_version = from.version, .to_version = to.version};
  std::vector<bool> is_put(to.map.keyframes.size(), false);
  AscendingSearch keyframes_before(from.map.keyframes);
  for (size_t i = 0; i < to.map.keyframes.size(); ++i) {
    const LeanKeyframe* before = keyframes_before.Find(to.map.keyframes[i].id);
    is_put[i] = before == nullptr || !AreEqual(*before, to.map.keyframes[i]);
  }
  AscendingSearch landmarks_before(from.map.landmarks);
  for (const LeanLandmark& landmark : to.map.landmarks) {
    const LeanLandmark* before = landmarks_before.Find(landmark.id);
    if (before != nullptr && AreEqual(from.map, *before, to.map, landmark)) {
      continue;
    }
    patch.put.landmarks.push_back(landmark);
    for (const uint32_t idx : landmark.keyframe_idxs) is_put[idx] = true;
  }
  for (size_t i = 0; i < to.map.keyframes.size(); ++i) {
    if (is_put[i]) patch.put.keyframes.push_back(to.map.keyframes[i]);
  }
  const std::vector<uint32_t> places = PlacesIn(patch.put.keyframes, to.map.keyframes);
  for (LeanLandmark& landmark : patch.put.landmarks) Renumber(places, landmark);

  for (const LeanDrive& drive : to.map.drives) {
    const LeanDrive* before = FindDrive(from.map.drives, drive.id);
    const auto is_of_drive = [&](const auto& record) { return record.id.drive == drive.id; };
    if (before == nullptr || !AreEqual(*before, drive) ||
        std::any_of(patch.put.keyframes.begin(), patch.put.keyframes.end(), is_of_drive) ||
        std::any_of(patch.put.landmarks.begin(), patch.put.landmarks.end(), is_of_drive)) {
      patch.put.drives.push_back(drive);
    }
  }
  patch.removed_keyframes = Missing(from.map.keyframes, to.map.keyframes, &LeanKeyframe::id);
  patch.removed_landmarks = Missing(from.map.landmarks, to.map.landmarks, &LeanLandmark::id);
  return patch;
}

}  // namespace carmap
