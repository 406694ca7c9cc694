#include "carmap/update/keyframe_locator.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/localize/keyframe_view.h"

namespace carmap {
namespace {

/// Drops those with too few inliers, alone or beside the first, which has most.
std::vector<LocatedKeyframe> Strong(std::vector<LocatedKeyframe> located,
                                    const LocatorOptions& options) {
  if (located.empty()) return located;
  const double enough =
      std::max(static_cast<double>(options.min_inliers),
               options.min_rival_share * static_cast<double>(located.front().inliers));
  std::erase_if(located, [&](const LocatedKeyframe& place) {
    return static_cast<double>(place.inliers) < enough;
  });
  return located;
}

}  // namespace

KeyframeLocator::KeyframeLocator(const ReconstructedMap& base, const ReconstructedMap& segment,
                                 const LocatorOptions& options)
    : base_(base),
      segment_(segment),
      options_(options),
      search_(base, {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()},
              options.place_search) {
  if (options.by_appearance) by_appearance_.emplace(base.snapshot, DefaultVocabulary());
}

bool KeyframeLocator::IsNearBase(uint32_t keyframe_idx) const {
  const auto& gps = segment_.snapshot.keyframes[keyframe_idx].gps;
  return gps && base_.gps &&
         !base_.gps->KeyframesNear(*gps, options_.place_search.gps_radius_m, 1).empty();
}

std::vector<LocatedKeyframe> KeyframeLocator::Locate(uint32_t keyframe_idx) {
  const StereoRig& rig = RigOf(segment_, keyframe_idx);
  const KeyframeView view = ViewFrom(segment_, keyframe_idx, options_.view_neighbours);
  std::vector<LocatedKeyframe> located;
  if (by_appearance_) {
    if (const auto pose = by_appearance_->Localize(view.features, rig)) {
      located.push_back({keyframe_idx, pose->inliers.size(), pose->camera_from_map.Inverse()});
    }
    return Strong(std::move(located), options_);
  }
  const FeatureGrid grid(view.features, rig.camera.width, rig.camera.height);
  search_.Forget();  // the keyframes are far from each other
  const auto& gps = segment_.snapshot.keyframes[keyframe_idx].gps;
  for (const PlaceHypothesis& place : search_.Search(grid, rig, gps)) {
    located.push_back(
        {keyframe_idx, place.inliers.size(), place.camera_from_map.Inverse(), place.is_near_fix});
  }
  return Strong(std::move(located), options_);
}

}  // namespace carmap
