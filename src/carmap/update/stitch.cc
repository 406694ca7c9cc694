#include "carmap/update/stitch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/index/reconstruct.h"

namespace carmap {
namespace {

absl::Status CheckInputs(const LeanMap& base, const LeanMap& segment) {
  CARMAP_RETURN_IF_ERROR(CheckConsistency(base));
  CARMAP_RETURN_IF_ERROR(CheckConsistency(segment));
  for (const LeanDrive& drive : segment.drives) {
    const bool is_known = std::any_of(base.drives.begin(), base.drives.end(),
                                      [&](const LeanDrive& known) { return known.id == drive.id; });
    if (is_known) {
      return absl::AlreadyExistsError(fmt::format(
          "drive {:016x} of the segment is in the base map already; stitch each segment once",
          drive.id.value));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckOverlap(const Overlap& overlap, const StitchOptions& options) {
  if (overlap.agreeing.keyframes < options.min_keyframes) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment does not overlap the base map: of {} keyframes looked for {} were found there "
        "and {} agree on a place, {} are needed; map further into road that the base map holds",
        overlap.tried, overlap.found, overlap.agreeing.keyframes, options.min_keyframes));
  }
  if (overlap.IsAmbiguous(options.overlap)) {
    return absl::FailedPreconditionError(
        fmt::format("the segment fits the base map in two places: {} keyframes agree on one, {} on "
                    "another; map further into road that the base map holds, or with GPS",
                    overlap.agreeing.keyframes, overlap.dissenting.keyframes));
  }
  return absl::OkStatus();
}

double DistanceM(const AnchoredKeyframe& anchor, const SegmentFit& fit) {
  return (anchor.base_from_camera.translation -
          fit.base_from_camera[anchor.keyframe_idx].translation)
      .norm();
}

double LargestDistanceM(const std::vector<AnchoredKeyframe>& anchors, const SegmentFit& fit) {
  double largest_m = 0;
  for (const AnchoredKeyframe& anchor : anchors) {
    largest_m = std::max(largest_m, DistanceM(anchor, fit));
  }
  return largest_m;
}

absl::Status CheckFit(const PlacedSegment& placed, const Strain& strain,
                      const StitchOptions& options) {
  const SegmentFit& fit = placed.fit;
  const size_t keyframes = fit.anchors.size(), contradicting = fit.contradicting.size();
  if (static_cast<double>(contradicting) >
      options.max_contradicting_ratio * static_cast<double>(keyframes + contradicting)) {
    const AnchoredKeyframe& first = fit.contradicting.front();
    return absl::FailedPreconditionError(fmt::format(
        "the segment contradicts the base map: of {} keyframes that see landmarks of both, these "
        "put {} elsewhere than the rest, by up to {:.1f} m, the first is number {}; one of the two "
        "maps is wrong there, or the places only look alike",
        keyframes + contradicting, contradicting, LargestDistanceM(fit.contradicting, fit),
        first.keyframe_idx));
  }
  if (strain.ratio > options.max_strain) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment contradicts the base map: to fit it, {:.0f} m of it from keyframe {} on would "
        "have to be bent by {:.1f} m, {:.1f} m are allowed; one of the two maps is wrong there",
        kStrainStretchM, strain.keyframe_idx, kStrainStretchM * strain.ratio,
        kStrainStretchM * options.max_strain));
  }
  const size_t inliers = placed.merged.size();
  if (keyframes >= options.min_keyframes && inliers >= options.min_inliers &&
      static_cast<double>(inliers) >=
          options.min_inlier_ratio * static_cast<double>(placed.matches)) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(fmt::format(
      "the segment hardly overlaps the base map: {} keyframes and {} landmarks match, of which {} "
      "lie in one place; {} keyframes, {} landmarks and {:.0f} % in one place are needed; map "
      "further into road that the base map holds",
      keyframes, placed.matches, inliers, options.min_keyframes, options.min_inliers,
      100 * options.min_inlier_ratio));
}

size_t CountBaseKeyframes(const ReconstructedMap& base, const std::vector<MergedLandmark>& merged) {
  std::vector<bool> sees(base.snapshot.keyframes.size(), false);
  for (const MergedLandmark& landmark : merged) {
    for (const uint32_t keyframe_idx : base.keyframes_of_landmark[landmark.pair.base_idx]) {
      sees[keyframe_idx] = true;
    }
  }
  return static_cast<size_t>(std::count(sees.begin(), sees.end(), true));
}

double MedianDistanceM(const std::vector<MergedLandmark>& merged) {
  std::vector<double> distances_m;
  for (const MergedLandmark& landmark : merged) distances_m.push_back(landmark.distance_m);
  return Summarize(std::move(distances_m)).median;
}

double MedianMisfitM(const SegmentFit& fit) {
  std::vector<double> misfits_m;
  for (const AnchoredKeyframe& anchor : fit.anchors) misfits_m.push_back(DistanceM(anchor, fit));
  return Summarize(std::move(misfits_m)).median;
}

/// Of the ways between successive keyframes that both are anchors.
double Scale(const SegmentFit& fit, const LeanMap& segment) {
  double in_base_m = 0, in_segment_m = 0;
  for (size_t i = 1; i < fit.anchors.size(); ++i) {
    const uint32_t from = fit.anchors[i - 1].keyframe_idx, to = fit.anchors[i].keyframe_idx;
    if (segment.keyframes[from].id.drive != segment.keyframes[to].id.drive) continue;
    const auto step_m = [&](const Rigid3& a, const Rigid3& b) {
      return (b.translation - a.translation).norm();
    };
    in_base_m += step_m(fit.base_from_camera[from], fit.base_from_camera[to]);
    in_segment_m +=
        step_m(segment.keyframes[from].map_from_camera, segment.keyframes[to].map_from_camera);
  }
  return in_segment_m > 0 ? in_base_m / in_segment_m : 1;
}

}  // namespace

absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckInputs(base, segment));
  if (base.keyframes.empty()) {
    return StitchedMap{segment, {.segment_keyframes_added = segment.keyframes.size()}};
  }
  if (segment.landmarks.empty()) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment has no landmarks in its {} keyframes, so it cannot be placed in the base map; "
        "map a longer drive",
        segment.keyframes.size()));
  }

  const ReconstructedMap segment_map = Reconstruct(segment);
  const ReconstructedMap base_map = Reconstruct(base, segment_map.focal_length_px);
  KeyframeLocator locator(base_map, segment_map, options.locator);
  const Overlap overlap = FindOverlap(segment_map, options.overlap, locator);
  CARMAP_RETURN_IF_ERROR(CheckOverlap(overlap, options));
  const PlacedSegment placed = PlaceSegment(
      base_map, segment_map, FitSegment(base_map, segment_map, overlap.best, options.fit, locator),
      options.fit);
  const Strain strain = LargestStrain(segment_map, placed.fit);
  CARMAP_RETURN_IF_ERROR(CheckFit(placed, strain, options));

  StitchedMap stitched{MergeSegment(base, segment, base_map, segment_map, placed, options.merge),
                       {}};
  stitched.report = {
      .segment_keyframes_tried = overlap.tried,
      .segment_keyframes_found = overlap.found,
      .segment_keyframes_overlapping = placed.fit.anchors.size(),
      .segment_keyframes_contradicting = placed.fit.contradicting.size(),
      .segment_keyframes_added = stitched.map.keyframes.size() - base.keyframes.size(),
      .base_keyframes_overlapping = CountBaseKeyframes(base_map, placed.merged),
      .matches = placed.matches,
      .inliers = placed.merged.size(),
      .median_distance_m = MedianDistanceM(placed.merged),
      .median_misfit_m = MedianMisfitM(placed.fit),
      .largest_strain = strain.ratio,
      .scale = Scale(placed.fit, segment)};
  CARMAP_RETURN_IF_ERROR(CheckConsistency(stitched.map));
  return stitched;
}

}  // namespace carmap
