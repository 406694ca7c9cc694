#include "carmap/eval/landmark_votes.h"

#include <absl/container/flat_hash_set.h>

namespace carmap {
namespace {

MobilityVotes VotesOn(const Landmark& landmark, const FrameLabels& labels,
                      const absl::flat_hash_set<KeyframeId>& voters) {
  MobilityVotes votes;
  for (const auto& [keyframe_id, feature_idx] : landmark.observations) {
    if (!voters.contains(keyframe_id)) continue;
    const auto of_frame = labels.find(keyframe_id.index);
    if (of_frame == labels.end()) continue;
    const Mobility mobility = of_frame->second[feature_idx];
    votes.is_static += mobility == Mobility::kStatic;
    votes.non_static += mobility == Mobility::kNonStatic;
  }
  return votes;
}

/// By the same majority as in a map.
Mobility Elected(const MobilityVotes& votes) {
  if (votes.is_static + votes.non_static == 0) return Mobility::kUnknown;
  return Landmark{.votes = votes}.is_non_static() ? Mobility::kNonStatic : Mobility::kStatic;
}

absl::flat_hash_set<KeyframeId> EveryNth(const Map& map, size_t n) {
  absl::flat_hash_set<KeyframeId> chosen;
  for (size_t i = 0; const auto& [id, keyframe] : map.keyframes()) {
    if (i++ % n == 0) chosen.insert(id);
  }
  return chosen;
}

}  // namespace

MobilityConfusion VoteOnLandmarks(const Map& map, const FrameLabels& truth, const FrameLabels& told,
                                  size_t cycle, size_t min_observations) {
  const auto all = EveryNth(map, 1), labelled = EveryNth(map, cycle);
  MobilityConfusion confusion;
  for (const auto& [id, landmark] : map.landmarks()) {
    if (landmark.observations.size() < min_observations) continue;
    confusion.Add(Elected(VotesOn(landmark, truth, all)),
                  Elected(VotesOn(landmark, told, labelled)));
  }
  return confusion;
}

}  // namespace carmap
