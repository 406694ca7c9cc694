#include "carmap/map/map_edit.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace carmap {

/// The steps of Apply. Each says whether the record still fits the map.
class EditApplication {
 public:
  EditApplication(uint64_t base_version, Map& map)
      : base_version_(base_version), new_version_(map.version_ + 1), map_(map) {}

  bool AddKeyframe(const Keyframe& keyframe) {
    if (!keyframe.features || !IsRigid(keyframe.map_from_camera) || map_.Find(keyframe.id)) {
      return false;
    }
    map_.landmarks_of_[keyframe.id].resize(keyframe.features->size());
    map_.keyframes_.emplace(keyframe.id, keyframe).first->second.placed_in = new_version_;
    return true;
  }

  bool AddLandmark(const Landmark& landmark) {
    if (!landmark.position_in_map.allFinite() || map_.Find(landmark.id)) return false;
    map_.merged_into_.erase(landmark.id);
    Landmark bare = landmark;
    bare.placed_in = new_version_;
    bare.observations.clear();
    bare.votes = {};
    map_.landmarks_.emplace(landmark.id, std::move(bare));
    bool all_fit = !landmark.observations.empty();
    for (const Observation& observation : landmark.observations) {
      all_fit &= AddObservation({landmark.id, observation});
    }
    RemoveIfUnseen(landmark.id);
    return all_fit;
  }

  bool AddObservation(const MapEdit::LandmarkObservation& added) {
    const auto landmark = map_.landmarks_.find(map_.Heir(added.landmark_id));
    const auto links = map_.landmarks_of_.find(added.observation.keyframe_id);
    if (landmark == map_.landmarks_.end() || links == map_.landmarks_of_.end()) return false;
    const int32_t feature_idx = added.observation.feature_idx;
    if (feature_idx < 0 || static_cast<size_t>(feature_idx) >= links->second.size()) return false;
    auto& observations = landmark->second.observations;
    const auto place = FirstNotBefore(observations, added.observation.keyframe_id);
    if (links->second[feature_idx] || Holds(observations, place, added.observation.keyframe_id)) {
      return false;
    }
    links->second[feature_idx] = landmark->first;
    observations.insert(place, added.observation);
    Vote(added.observation, 1, landmark->second);
    return true;
  }

  bool RemoveObservation(const MapEdit::LandmarkObservation& removed) {
    const auto landmark = map_.landmarks_.find(map_.Heir(removed.landmark_id));
    if (landmark == map_.landmarks_.end()) return false;
    auto& observations = landmark->second.observations;
    const auto place = FirstNotBefore(observations, removed.observation.keyframe_id);
    if (place == observations.end() || *place != removed.observation) return false;
    map_.landmarks_of_.at(place->keyframe_id)[place->feature_idx].reset();
    observations.erase(place);
    Vote(removed.observation, -1, landmark->second);
    RemoveIfUnseen(landmark->first);
    return true;
  }

  bool LabelKeyframe(const MapEdit::KeyframeLabels& labels) {
    const auto found = map_.keyframes_.find(labels.id);
    if (found == map_.keyframes_.end() || found->second.mobility || !labels.mobility ||
        labels.mobility->size() != found->second.features->size()) {
      return false;
    }
    found->second.mobility = labels.mobility;
    const auto& links = map_.landmarks_of_.at(labels.id);
    for (size_t i = 0; i < links.size(); ++i) {
      if (!links[i]) continue;
      Vote({labels.id, static_cast<int32_t>(i)}, 1, map_.landmarks_.find(*links[i])->second);
    }
    return true;
  }

  bool MergeLandmarks(const MapEdit::Merge& merge) {
    const LandmarkId from_id = map_.Heir(merge.from), into_id = map_.Heir(merge.into);
    const Landmark* from = map_.Find(from_id);
    if (!from || !map_.Find(into_id) || from_id == into_id) return false;
    const std::vector<Observation> observations = from->observations;
    RemoveLandmark(from_id);
    map_.merged_into_[from_id] = into_id;
    for (const Observation& observation : observations) AddObservation({into_id, observation});
    return true;
  }

  bool MoveKeyframe(const MapEdit::KeyframePose& pose) {
    const auto found = map_.keyframes_.find(pose.id);
    if (found == map_.keyframes_.end() || !IsRigid(pose.map_from_camera)) return false;
    if (WasPlacedSince(found->second.placed_in)) return false;
    found->second.map_from_camera = pose.map_from_camera;
    found->second.placed_in = new_version_;
    return true;
  }

  bool MoveLandmark(const MapEdit::LandmarkPosition& moved) {
    const auto found = map_.landmarks_.find(moved.id);
    if (found == map_.landmarks_.end() || !moved.position_in_map.allFinite()) return false;
    if (WasPlacedSince(found->second.placed_in)) return false;
    found->second.position_in_map = moved.position_in_map;
    found->second.placed_in = new_version_;
    return true;
  }

  bool ChangeDescriptor(const MapEdit::LandmarkDescriptor& changed) {
    const auto found = map_.landmarks_.find(changed.id);
    if (found == map_.landmarks_.end()) return false;
    found->second.descriptor = changed.descriptor;
    return true;
  }

  bool RemoveLandmark(const LandmarkId& id) {
    const auto found = map_.landmarks_.find(id);
    if (found == map_.landmarks_.end()) return false;
    for (const Observation& observation : found->second.observations) {
      map_.landmarks_of_.at(observation.keyframe_id)[observation.feature_idx].reset();
    }
    map_.landmarks_.erase(found);
    return true;
  }

  bool RemoveKeyframe(const KeyframeId& id) {
    const auto links = map_.landmarks_of_.find(id);
    if (links == map_.landmarks_of_.end()) return false;
    for (const auto& link : links->second) {
      if (!link) continue;
      auto& observations = map_.landmarks_.find(*link)->second.observations;
      observations.erase(FirstNotBefore(observations, id));
      RemoveIfUnseen(*link);
    }
    map_.landmarks_of_.erase(links);
    map_.keyframes_.erase(id);
    return true;
  }

  void CountVersion() { map_.version_ = new_version_; }

 private:
  using Observations = std::vector<Observation>;

  static Observations::iterator FirstNotBefore(Observations& observations, KeyframeId id) {
    return std::lower_bound(
        observations.begin(), observations.end(), id,
        [](const Observation& o, KeyframeId value) { return o.keyframe_id < value; });
  }
  static bool Holds(const Observations& observations, Observations::iterator place, KeyframeId id) {
    return place != observations.end() && place->keyframe_id == id;
  }
  /// The keyframe's vote on the landmark that it sees so, or its withdrawal.
  void Vote(const Observation& observation, int count, Landmark& landmark) {
    const auto& mobility = map_.keyframes_.at(observation.keyframe_id).mobility;
    if (mobility) landmark.votes.Add((*mobility)[observation.feature_idx], count);
  }
  /// By another edit than this one.
  bool WasPlacedSince(uint64_t placed_in) const {
    return placed_in > base_version_ && placed_in != new_version_;
  }
  void RemoveIfUnseen(LandmarkId id) {
    const auto found = map_.landmarks_.find(id);
    if (found != map_.landmarks_.end() && found->second.observations.empty())
      map_.landmarks_.erase(found);
  }

  const uint64_t base_version_, new_version_;
  Map& map_;
};

namespace {

template <typename Record>
size_t CountLeftOut(EditApplication& application, bool (EditApplication::*step)(const Record&),
                    const std::vector<Record>& records) {
  size_t left_out = 0;
  for (const Record& record : records) left_out += !(application.*step)(record);
  return left_out;
}

}  // namespace

absl::StatusOr<size_t> Apply(const MapEdit& edit, Map& map) {
  if (edit.base_version > map.version()) {
    return absl::InvalidArgumentError(fmt::format(
        "edit of version {} of a map that is at version {}", edit.base_version, map.version()));
  }
  using Application = EditApplication;
  Application application(edit.base_version, map);
  size_t left_out = 0;
  left_out += CountLeftOut(application, &Application::AddKeyframe, edit.added_keyframes);
  left_out += CountLeftOut(application, &Application::AddLandmark, edit.added_landmarks);
  left_out += CountLeftOut(application, &Application::AddObservation, edit.added_observations);
  left_out += CountLeftOut(application, &Application::RemoveObservation, edit.removed_observations);
  left_out += CountLeftOut(application, &Application::LabelKeyframe, edit.labelled_keyframes);
  left_out += CountLeftOut(application, &Application::MergeLandmarks, edit.merges);
  left_out += CountLeftOut(application, &Application::MoveKeyframe, edit.moved_keyframes);
  left_out += CountLeftOut(application, &Application::MoveLandmark, edit.moved_landmarks);
  left_out += CountLeftOut(application, &Application::ChangeDescriptor, edit.changed_descriptors);
  left_out += CountLeftOut(application, &Application::RemoveLandmark, edit.removed_landmarks);
  left_out += CountLeftOut(application, &Application::RemoveKeyframe, edit.removed_keyframes);
  application.CountVersion();
  return left_out;
}

}  // namespace carmap
