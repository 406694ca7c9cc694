#include "carmap/update/overlap.h"

#include <algorithm>
#include <utility>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/localize/appearance_localizer.h"

namespace carmap {
namespace {

/// A keyframe of the segment and a place of the base map where it fits.
struct Located {
  uint32_t keyframe_idx = 0;
  size_t inliers = 0;
  Rigid3 base_from_segment;
};

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

/// Finds keyframes of a segment in a base map.
class KeyframeLocator {
 public:
  KeyframeLocator(const ReconstructedMap& base, const ReconstructedMap& segment,
                  const OverlapOptions& options)
      : segment_(segment),
        min_inliers_(options.min_inliers),
        min_rival_share_(options.min_rival_share),
        search_(base, {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()},
                options.place_search) {
    if (options.by_appearance) by_appearance_.emplace(base.snapshot, DefaultVocabulary());
  }

  /// All places that explain the keyframe about as well as the best: façades repeat.
  std::vector<Located> Locate(uint32_t keyframe_idx) {
    const StereoRig& rig = RigOf(segment_, keyframe_idx);
    const std::vector<Feature> features = FeaturesOf(segment_, keyframe_idx);
    const SnapshotKeyframe& keyframe = segment_.snapshot.keyframes[keyframe_idx];
    if (by_appearance_) {
      const auto pose = by_appearance_->Localize(features, rig);
      if (!pose) return {};
      return LocatedAt(keyframe_idx, std::vector{*pose});
    }
    const FeatureGrid grid(features, rig.camera.width, rig.camera.height);
    search_.Forget();  // the keyframes are far from each other
    return LocatedAt(keyframe_idx, search_.Search(grid, rig, keyframe.gps));
  }

 private:
  /// `poses` by falling numbers of inliers.
  template <typename Pose>
  std::vector<Located> LocatedAt(uint32_t keyframe_idx, const std::vector<Pose>& poses) const {
    const Rigid3& segment_from_camera = segment_.snapshot.keyframes[keyframe_idx].map_from_camera;
    std::vector<Located> located;
    for (const Pose& pose : poses) {
      const size_t inliers = pose.inliers.size();
      const auto most = static_cast<double>(poses.front().inliers.size());
      if (inliers < min_inliers_ || static_cast<double>(inliers) < min_rival_share_ * most) break;
      located.push_back(
          {keyframe_idx, inliers, (segment_from_camera * pose.camera_from_map).Inverse()});
    }
    return located;
  }

  const ReconstructedMap& segment_;
  const size_t min_inliers_;
  const double min_rival_share_;
  PlaceSearch search_;
  std::optional<AppearanceLocalizer> by_appearance_;
};

bool Agree(const Located& a, const Located& b, const ReconstructedMap& segment,
           const OverlapOptions& options) {
  const auto center = [&](const Located& located) -> const Eigen::Vector3d& {
    return segment.snapshot.keyframes[located.keyframe_idx].map_from_camera.translation;
  };
  const double apart_m = (center(a) - center(b)).norm();
  const Rigid3 difference = a.base_from_segment.Inverse() * b.base_from_segment;
  return (difference * center(a) - center(a)).norm() <=
             options.agreement_m + options.agreement_drift * apart_m &&
         RotationAngle(difference.rotation) <= options.agreement_rad;
}

/// The largest set of keyframes that agrees with one of its members, each at one place. Empty for
/// no keyframes. The places of a keyframe follow one another.
std::vector<size_t> LargestGroup(const std::vector<Located>& located,
                                 const ReconstructedMap& segment, const OverlapOptions& options) {
  std::vector<size_t> largest;
  for (const Located& center : located) {
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
std::vector<Located> TakeOut(const std::vector<size_t>& group, std::vector<Located>& located) {
  std::vector<Located> taken, rest;
  for (size_t i = 0; i < located.size(); ++i) {
    const bool is_member = std::binary_search(group.begin(), group.end(), i);
    (is_member ? taken : rest).push_back(located[i]);
  }
  located = std::move(rest);
  return taken;
}

void CountVotes(std::vector<Located> located, const ReconstructedMap& segment,
                const OverlapOptions& options, CoarseOverlap& overlap) {
  const std::vector<Located> agreeing = TakeOut(LargestGroup(located, segment, options), located);
  overlap.agreeing = agreeing.size();
  overlap.dissenting = LargestGroup(located, segment, options).size();
  overlap.base_from_segment =
      std::max_element(agreeing.begin(), agreeing.end(), [](const Located& a, const Located& b) {
        return a.inliers < b.inliers;
      })->base_from_segment;
}

constexpr int kTaken = -1;

struct CountedPair {
  LandmarkPair pair;
  int count = 0;
};

/// Of all matches, each with how many keyframes made it, those that are the most frequent one of
/// both landmarks; of equally frequent ones the first.
std::vector<LandmarkPair> PairUp(std::vector<LandmarkPair> matches, size_t base_count,
                                 size_t segment_count) {
  std::sort(matches.begin(), matches.end());
  std::vector<CountedPair> counted;
  for (const LandmarkPair& match : matches) {
    if (counted.empty() || counted.back().pair != match) counted.push_back({match, 0});
    ++counted.back().count;
  }
  std::vector<int> most_of_base(base_count, 0), most_of_segment(segment_count, 0);
  for (const auto& [pair, count] : counted) {
    most_of_base[pair.base_idx] = std::max(most_of_base[pair.base_idx], count);
    most_of_segment[pair.segment_idx] = std::max(most_of_segment[pair.segment_idx], count);
  }
  std::vector<LandmarkPair> pairs;
  for (const auto& [pair, count] : counted) {
    int &of_base = most_of_base[pair.base_idx], &of_segment = most_of_segment[pair.segment_idx];
    if (count != of_base || count != of_segment) continue;
    of_base = of_segment = kTaken;
    pairs.push_back(pair);
  }
  return pairs;
}

}  // namespace

bool CoarseOverlap::IsAmbiguous(const OverlapOptions& options) const {
  return static_cast<double>(dissenting) > options.max_dissent * static_cast<double>(agreeing);
}

CoarseOverlap FindOverlap(const ReconstructedMap& base, const ReconstructedMap& segment,
                          const OverlapOptions& options) {
  KeyframeLocator locator(base, segment, options);
  CoarseOverlap overlap;
  std::vector<Located> located;
  for (const uint32_t keyframe_idx :
       CoarseToFine(static_cast<uint32_t>(segment.snapshot.keyframes.size()))) {
    if (overlap.tried == options.max_tries) break;
    ++overlap.tried;
    const std::vector<Located> places = locator.Locate(keyframe_idx);
    if (places.empty()) continue;
    ++overlap.found;
    located.insert(located.end(), places.begin(), places.end());
    CountVotes(located, segment, options, overlap);
    if (overlap.found == options.max_keyframes) break;
    if (overlap.agreeing >= options.enough_keyframes && !overlap.IsAmbiguous(options)) break;
  }
  return overlap;
}

FineOverlap MatchOverlap(const ReconstructedMap& base, const ReconstructedMap& segment,
                         const Rigid3& base_from_segment, const OverlapOptions& options) {
  FineOverlap overlap;
  std::vector<LandmarkPair> matches;
  for (uint32_t k = 0; k < segment.snapshot.keyframes.size(); ++k) {
    const Rigid3 base_from_camera =
        base_from_segment * segment.snapshot.keyframes[k].map_from_camera;
    const auto landmark_idxs = LandmarksAround(base, base_from_camera, options.neighbourhood);
    if (landmark_idxs.empty()) continue;
    const StereoRig& rig = RigOf(segment, k);
    const std::vector<Feature> features = FeaturesOf(segment, k);
    const FeatureGrid grid(features, rig.camera.width, rig.camera.height);
    const auto pose = TrackByProjection(base.snapshot, landmark_idxs, grid, rig,
                                        base_from_camera.Inverse(), options.tracking);
    if (!pose) continue;
    overlap.segment_keyframes.push_back(k);
    overlap.positions_in_base.push_back(pose->camera_from_map.Inverse().translation);
    for (const auto& [landmark_idx, feature_idx] : pose->inliers) {
      matches.push_back({landmark_idx, segment.features_of_keyframe[k][feature_idx].landmark_idx});
    }
  }
  overlap.pairs =
      PairUp(std::move(matches), base.snapshot.landmarks.size(), segment.snapshot.landmarks.size());
  return overlap;
}

}  // namespace carmap
