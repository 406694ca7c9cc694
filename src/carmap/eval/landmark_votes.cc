#include "carmap/eval/landmark_votes.h"

#include <absl/container/flat_hash_set.h>

namespace carmap {
namespace {

/// Votes for static are positive, for non-static negative.
int BalanceOf(const Landmark& landmark, const FrameLabels& labels,
              const absl::flat_hash_set<KeyframeId>& voters) {
  int balance = 0;
  for (const auto& [keyframe_id, feature_idx] : landmark.observations) {
    if (!voters.contains(keyframe_id)) continue;
    const auto of_frame = labels.find(keyframe_id.index);
    if (of_frame == labels.end()) continue;
    const Mobility mobility = of_frame->second[feature_idx];
    balance += (mobility == Mobility::kStatic) - (mobility == Mobility::kNonStatic);
  }
  return balance;
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
    const int told_balance = BalanceOf(landmark, told, labelled);
    confusion.Add(BalanceOf(landmark, truth, all) < 0 ? Mobility::kNonStatic : Mobility::kStatic,
                  told_balance < 0   ? Mobility::kNonStatic
                  : told_balance > 0 ? Mobility::kStatic
                                     : Mobility::kUnknown);
  }
  return confusion;
}

}  // namespace carmap
