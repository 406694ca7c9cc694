#include "carmap/update/overlap.h"

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

namespace carmap {
namespace {

/// 0 … count-1 from coarse to fine, the ends first: a segment mostly overlaps where it begins or
/// ends.
std::vector<uint32_t> CoarseToFine(uint32_t count) {
  std::vector<uint32_t> order;
  std::vector<bool> is_listed(count, false);
  const auto list = [&](uint32_t i) {
    if (!is_listed[i]) order.push_back(i);
    is_listed[i] = true;
  };
  if (count > 0) list(count - 1);
  uint32_t stride = 1;
  while (stride < count) stride *= 2;
  for (; stride > 0; stride /= 2) {
    for (uint32_t i = 0; i < count; i += stride) list(i);
  }
  return order;
}

const Rigid3& SegmentFromCamera(const ReconstructedMap& segment, const LocatedKeyframe& located) {
  return segment.snapshot.keyframes[located.keyframe_idx].map_from_camera;
}

bool Agree(const LocatedKeyframe& a, const LocatedKeyframe& b, const ReconstructedMap& segment,
           const OverlapOptions& options) {
  const Rigid3 &segment_from_a = SegmentFromCamera(segment, a),
               &segment_from_b = SegmentFromCamera(segment, b);
  const double apart_m = (segment_from_a.translation - segment_from_b.translation).norm();
  // From where a puts the segment to where b does, as seen at a.
  const Rigid3 difference =
      segment_from_a * a.base_from_camera.Inverse() * b.base_from_camera * segment_from_b.Inverse();
  const Eigen::Vector3d& center = segment_from_a.translation;
  return (difference * center - center).norm() <=
             options.agreement_m + options.agreement_drift * apart_m &&
         RotationAngle(difference.rotation) <= options.agreement_rad;
}

/// The largest set of keyframes that agrees with one of its members, each at one place. Empty for
/// no keyframes. The places of a keyframe follow one another.
std::vector<size_t> LargestGroup(const std::vector<LocatedKeyframe>& located,
                                 const ReconstructedMap& segment, const OverlapOptions& options) {
  std::vector<size_t> largest;
  for (const LocatedKeyframe& center : located) {
    std::vector<size_t> group;
    for (size_t i = 0; i < located.size(); ++i) {
      const bool is_in =
          !group.empty() && located[group.back()].keyframe_idx == located[i].keyframe_idx;
      if (!is_in && Agree(center, located[i], segment, options)) group.push_back(i);
    }
    if (group.size() > largest.size()) largest = std::move(group);
  }
  return largest;
}

/// Moves the members of the group out of `located`.
std::vector<LocatedKeyframe> TakeOut(const std::vector<size_t>& group,
                                     std::vector<LocatedKeyframe>& located) {
  std::vector<LocatedKeyframe> taken, rest;
  for (size_t i = 0; i < located.size(); ++i) {
    const bool is_member = std::binary_search(group.begin(), group.end(), i);
    (is_member ? taken : rest).push_back(located[i]);
  }
  located = std::move(rest);
  return taken;
}

OverlapVotes VotesOf(const std::vector<LocatedKeyframe>& group) {
  OverlapVotes votes;
  for (const LocatedKeyframe& located : group) {
    ++votes.keyframes;
    votes.near_fix += located.is_near_fix;
  }
  return votes;
}

bool IsByGps(const OverlapVotes& votes) { return 2 * votes.near_fix > votes.keyframes; }

/// The place with most votes comes first, unless fixes speak for another that has enough.
void CountVotes(std::vector<LocatedKeyframe> located, const ReconstructedMap& segment,
                const OverlapOptions& options, Overlap& overlap) {
  auto agreeing = TakeOut(LargestGroup(located, segment, options), located);
  auto dissenting = TakeOut(LargestGroup(located, segment, options), located);
  if (static_cast<double>(dissenting.size()) >
          options.max_dissent * static_cast<double>(agreeing.size()) &&
      IsByGps(VotesOf(dissenting)) && !IsByGps(VotesOf(agreeing))) {
    std::swap(agreeing, dissenting);
  }
  overlap.agreeing = VotesOf(agreeing);
  overlap.dissenting = VotesOf(dissenting);
  overlap.best = *std::max_element(
      agreeing.begin(), agreeing.end(),
      [](const LocatedKeyframe& a, const LocatedKeyframe& b) { return a.inliers < b.inliers; });
}

}  // namespace

bool Overlap::IsAmbiguous(const OverlapOptions& options) const {
  return static_cast<double>(dissenting.keyframes) >
             options.max_dissent * static_cast<double>(agreeing.keyframes) &&
         !(IsByGps(agreeing) && !IsByGps(dissenting));
}

Overlap FindOverlap(const ReconstructedMap& segment, const OverlapOptions& options,
                    KeyframeLocator& locator) {
  Overlap overlap;
  std::vector<LocatedKeyframe> located;
  std::vector<uint32_t> order =
      CoarseToFine(static_cast<uint32_t>(segment.snapshot.keyframes.size()));
  std::stable_partition(order.begin(), order.end(),
                        [&](uint32_t keyframe_idx) { return locator.IsNearBase(keyframe_idx); });
  for (const uint32_t keyframe_idx : order) {
    if (overlap.tried == options.max_tries) break;
    ++overlap.tried;
    const std::vector<LocatedKeyframe> places = locator.Locate(keyframe_idx);
    if (places.empty()) continue;
    ++overlap.found;
    located.insert(located.end(), places.begin(), places.end());
    CountVotes(located, segment, options, overlap);
    if (overlap.found == options.max_keyframes) break;
    if (overlap.agreeing.keyframes >= options.enough_keyframes && !overlap.IsAmbiguous(options))
      break;
  }
  return overlap;
}

}  // namespace carmap
