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
    votes.Add(of_frame->second[feature_idx]);
  }
  return votes;
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
    confusion.Add(VotesOn(landmark, truth, all).Elected(),
                  VotesOn(landmark, told, labelled).Elected());
  }
  return confusion;
}

}  // namespace carmap
