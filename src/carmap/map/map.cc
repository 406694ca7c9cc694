#include "carmap/map/map.h"

#include <fmt/format.h>

namespace carmap {

const Keyframe* Map::Find(KeyframeId id) const {
  const auto found = keyframes_.find(id);
  return found == keyframes_.end() ? nullptr : &found->second;
}

const Landmark* Map::Find(LandmarkId id) const {
  const auto found = landmarks_.find(id);
  return found == landmarks_.end() ? nullptr : &found->second;
}

LandmarkId Map::Heir(LandmarkId id) const {
  for (auto next = merged_into_.find(id); next != merged_into_.end();
       next = merged_into_.find(id)) {
    id = next->second;
  }
  return id;
}

const std::vector<std::optional<LandmarkId>>& Map::LandmarksOf(KeyframeId id) const {
  return landmarks_of_.at(id);
}

namespace {

absl::Status CheckLandmark(const Map& map, const Landmark& landmark) {
  const auto broken = [&](const char* what) {
    return absl::InternalError(fmt::format("landmark {}: {}", landmark.id.index, what));
  };
  if (landmark.observations.empty()) return broken("has no observation");
  if (!landmark.position_in_map.allFinite()) return broken("has no finite position");
  MobilityVotes votes;  // of the keyframes that are still there
  for (size_t i = 0; i < landmark.observations.size(); ++i) {
    const auto& [keyframe_id, feature_idx] = landmark.observations[i];
    if (i > 0 && !(landmark.observations[i - 1].keyframe_id < keyframe_id)) {
      return broken("has observations out of order");
    }
    if (!map.Find(keyframe_id)) return broken("is observed by a keyframe that is not there");
    const auto& links = map.LandmarksOf(keyframe_id);
    if (feature_idx < 0 || static_cast<size_t>(feature_idx) >= links.size()) {
      return broken("is observed by a feature that is not there");
    }
    if (links[feature_idx] != landmark.id)
      return broken("is not known to a feature that observes it");
    if (const auto& mobility = map.Find(keyframe_id)->mobility) votes.Add((*mobility)[feature_idx]);
  }
  if (landmark.votes.is_static < votes.is_static || landmark.votes.non_static < votes.non_static)
    return broken("lacks votes of keyframes that observe it");
  return absl::OkStatus();
}

}  // namespace

absl::Status CheckConsistency(const Map& map) {
  size_t observation_count = 0;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (absl::Status status = CheckLandmark(map, landmark); !status.ok()) return status;
    observation_count += landmark.observations.size();
  }
  for (const auto& [id, keyframe] : map.keyframes()) {
    const auto& links = map.LandmarksOf(id);
    if (!keyframe.features || links.size() != keyframe.features->size()) {
      return absl::InternalError(
          fmt::format("keyframe {}: links and features differ in number", id.index));
    }
    if (keyframe.mobility && keyframe.mobility->size() != links.size()) {
      return absl::InternalError(
          fmt::format("keyframe {}: labels and features differ in number", id.index));
    }
    for (const auto& link : links) observation_count -= link.has_value();
  }
  if (observation_count != 0)
    return absl::InternalError("features know landmarks that do not know them");
  return absl::OkStatus();
}

}  // namespace carmap
