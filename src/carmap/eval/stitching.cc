#include "carmap/eval/stitching.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/eval/localization_error.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/index/keyframe_tree.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/appearance_localizer.h"

namespace carmap {
namespace {

/// Of each of the segment's keyframes; nothing for one that is not placed.
using Poses = std::vector<std::optional<Rigid3>>;

LeanMap PlacedKeyframes(const LeanMap& segment, const Poses& base_from_camera) {
  LeanMap placed{.drives = segment.drives, .keyframes = {}, .landmarks = {}};
  for (size_t i = 0; i < segment.keyframes.size(); ++i) {
    if (!base_from_camera[i]) continue;
    placed.keyframes.push_back(segment.keyframes[i]);
    placed.keyframes.back().map_from_camera = *base_from_camera[i];
  }
  return placed;
}

/// The segment as far as it is placed: landmarks ride on the placed keyframe that sees them best,
/// the nearest to their anchor.
LeanMap PlacedPart(const LeanMap& segment, const Poses& base_from_camera) {
  LeanMap part = PlacedKeyframes(segment, base_from_camera);
  std::vector<uint32_t> place_of(segment.keyframes.size());
  for (uint32_t i = 0, place = 0; i < segment.keyframes.size(); ++i) {
    place_of[i] = place;
    place += base_from_camera[i].has_value();
  }
  for (const LeanLandmark& landmark : segment.landmarks) {
    std::vector<uint32_t> viewers;
    std::copy_if(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(),
                 std::back_inserter(viewers),
                 [&](uint32_t i) { return base_from_camera[i].has_value(); });
    if (viewers.empty()) continue;
    const auto steps_to_anchor = [&](uint32_t i) {
      return std::abs(static_cast<int64_t>(i) - static_cast<int64_t>(landmark.anchor_idx));
    };
    const uint32_t anchor = *std::min_element(
        viewers.begin(), viewers.end(),
        [&](uint32_t a, uint32_t b) { return steps_to_anchor(a) < steps_to_anchor(b); });
    LeanLandmark& placed = part.landmarks.emplace_back(landmark);
    placed.position_in_map =
        *base_from_camera[anchor] *
        (segment.keyframes[anchor].map_from_camera.Inverse() * landmark.position_in_map);
    placed.anchor_idx = place_of[anchor];
    placed.keyframe_idxs.clear();
    for (const uint32_t viewer : viewers) placed.keyframe_idxs.push_back(place_of[viewer]);
  }
  return part;
}

/// The base with what is placed of the segment in it, to be searched.
class GrowingBase {
 public:
  GrowingBase(const LeanMap& base, const LeanMap& segment, const ReconstructedMap& segment_map,
              const StitchOptions& options)
      : base_(base), segment_(segment), segment_map_(segment_map), options_(options) {
    Search(base);
  }

  KeyframeLocator& locator() { return *locator_; }

  absl::Status Grow(const Poses& base_from_camera) {
    MapDiff diff;
    diff.drive = PlacedPart(segment_, base_from_camera);
    CARMAP_ASSIGN_OR_RETURN(const LeanMap grown, Apply(diff, base_, options_.apply));
    Search(grown);
    return absl::OkStatus();
  }

 private:
  void Search(const LeanMap& map) {
    map_ = Reconstruct(map, segment_map_.focal_length_px);
    locator_.emplace(map_, segment_map_, options_.fit.locator);
  }

  const LeanMap &base_, &segment_;
  const ReconstructedMap& segment_map_;
  const StitchOptions& options_;
  ReconstructedMap map_;
  std::optional<KeyframeLocator> locator_;
};

/// The way to go from one of `count` keyframes: on to the end, then back from it to the first.
std::vector<uint32_t> OutwardFrom(uint32_t first, uint32_t count) {
  std::vector<uint32_t> order;
  for (uint32_t i = first + 1; i < count; ++i) order.push_back(i);
  for (uint32_t i = first; i-- > 0;) order.push_back(i);
  return order;
}

}  // namespace

absl::StatusOr<PlacedSegment> StitchSegment(const LeanMap& base, const LeanMap& segment,
                                            const StitchOptions& options) {
  const Stopwatch watch;
  CARMAP_ASSIGN_OR_RETURN(FittedSegment fitted, Fit(base, segment, options.fit));
  CARMAP_RETURN_IF_ERROR(Apply(fitted.diff, base, options.apply).status());
  PlacedSegment placed{.keyframes = std::move(fitted.diff.drive), .ms = watch.ElapsedMs()};
  placed.keyframes.landmarks.clear();
  return placed;
}

absl::StatusOr<PlacedSegment> RelocalizeProgressively(const LeanMap& base, const LeanMap& segment,
                                                      const StitchOptions& options) {
  constexpr size_t kGrowEvery = 4;  // keyframes
  Stopwatch watch;
  const ReconstructedMap segment_map = Reconstruct(segment);
  GrowingBase grown(base, segment, segment_map, options);
  const Overlap overlap = FindOverlap(segment_map, options.fit.overlap, grown.locator());
  double ms = watch.ElapsedMs();
  if (overlap.agreeing.keyframes == 0) {
    return absl::NotFoundError("no keyframe of the segment is found in the base");
  }
  Poses base_from_camera(segment.keyframes.size());
  base_from_camera[overlap.best.keyframe_idx] = overlap.best.base_from_camera;
  size_t since_growth = kGrowEvery;
  for (const uint32_t i :
       OutwardFrom(overlap.best.keyframe_idx, static_cast<uint32_t>(segment.keyframes.size()))) {
    if (since_growth >= kGrowEvery) {
      CARMAP_RETURN_IF_ERROR(grown.Grow(base_from_camera));
      since_growth = 0;
    }
    watch = Stopwatch();
    const std::vector<LocatedKeyframe> places = grown.locator().Locate(i);
    ms += watch.ElapsedMs();
    if (places.empty()) continue;
    base_from_camera[i] = places.front().base_from_camera;
    ++since_growth;
  }
  return PlacedSegment{PlacedKeyframes(segment, base_from_camera), ms};
}

absl::StatusOr<PlacedSegment> StitchTrace(const FullMap& base, const FullMap& trace) {
  const Stopwatch watch;
  const StereoRig& rig = trace.drive.rig;
  const ReconstructedMap base_map = IndexSnapshot(SnapshotOf(base), base.drive.rig.camera.fx);
  const AppearanceLocalizer localizer(base_map.snapshot, DefaultVocabulary());
  const LeanMap keyframes = KeyframesOf(trace);
  for (size_t i = 0; i < trace.keyframes.size(); ++i) {
    std::vector<Feature> features;
    for (const FullFeature& full : trace.keyframes[i].features) features.push_back(full.feature);
    const auto found = localizer.Localize(features, rig);
    if (!found) continue;
    const Rigid3 base_from_trace =
        found->camera_from_map.Inverse() * trace.keyframes[i].map_from_camera.Inverse();
    return PlacedSegment{Moved(keyframes, base_from_trace), watch.ElapsedMs()};
  }
  return absl::NotFoundError("no keyframe of the trace is found in the base by appearance");
}

std::optional<StitchingScore> ScoreStitching(const LeanMap& placed, const Trajectory& truth,
                                             const LeanMap& base, const MapTruth& base_truth,
                                             const Rigid3& world_from_base) {
  const KdTree of_base = TreeOfKeyframes(base);
  StitchingScore score;
  std::vector<double> errors_m, map_errors_m;
  for (const auto& [base_from_camera, world_from_camera] : FindTrueKeyframes(placed, truth)) {
    const Rigid3 true_in_base = base_truth.InMap(world_from_camera);
    const uint32_t nearest = of_base.Nearest(true_in_base.translation, 1).front();
    const double from_base_m = (of_base.points()[nearest] - true_in_base.translation).norm();
    const double allowed_m =
        kMaxNearErrorM + kMaxErrorPerM * std::max(0.0, from_base_m - kNearBaseM);
    errors_m.push_back(ErrorOf(world_from_base * base_from_camera, world_from_camera).position_m);
    map_errors_m.push_back(ErrorOf(base_from_camera, true_in_base).position_m);
    score.within_bounds += map_errors_m.back() <= allowed_m;
    score.farthest_m = std::max(score.farthest_m, from_base_m);
  }
  if (errors_m.empty()) return std::nullopt;
  score.keyframes = errors_m.size();
  score.error_m = Summarize(std::move(errors_m));
  score.map_error_m = Summarize(std::move(map_errors_m));
  return score;
}

}  // namespace carmap
