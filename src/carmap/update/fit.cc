#include "carmap/update/fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/index/reconstruct.h"
#include "carmap/update/merged_position.h"

namespace carmap {
namespace {

absl::Status CheckOverlap(const Overlap& overlap, const FitOptions& options) {
  if (overlap.agreeing.keyframes < options.min_keyframes) {
    return absl::NotFoundError(fmt::format(
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

absl::Status CheckAgreement(const SegmentFit& fit, const Strain& strain,
                            const FitOptions& options) {
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
  return absl::OkStatus();
}

absl::Status CheckSize(size_t keyframes, size_t matches, size_t inliers,
                       const FitOptions& options) {
  if (keyframes >= options.min_anchors && inliers >= options.min_inliers &&
      static_cast<double>(inliers) >= options.min_inlier_ratio * static_cast<double>(matches)) {
    return absl::OkStatus();
  }
  return absl::NotFoundError(fmt::format(
      "the segment hardly overlaps the base map: {} keyframes and {} landmarks match, of which {} "
      "lie in one place; {} keyframes, {} landmarks and {:.0f} % in one place are needed; map "
      "further into road that the base map holds",
      keyframes, matches, inliers, options.min_anchors, options.min_inliers,
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

/// The segment where the fit puts it; landmarks ride on their nearest keyframes.
LeanMap Bent(const LeanMap& segment, const ReconstructedMap& segment_map, const SegmentFit& fit) {
  LeanMap bent = segment;
  for (uint32_t i = 0; i < segment.landmarks.size(); ++i) {
    const Eigen::Vector3d& position = segment.landmarks[i].position_in_map;
    const auto distance_from = [&](uint32_t keyframe_idx) {
      const LeanKeyframe& keyframe = segment.keyframes[keyframe_idx];
      return (keyframe.map_from_camera.translation - position).squaredNorm();
    };
    const auto viewers = segment_map.keyframes_of_landmark[i];
    const uint32_t nearest = *std::min_element(
        viewers.begin(), viewers.end(),
        [&](uint32_t a, uint32_t b) { return distance_from(a) < distance_from(b); });
    const Rigid3& segment_from_camera = segment.keyframes[nearest].map_from_camera;
    bent.landmarks[i].position_in_map =
        fit.base_from_camera[nearest] * (segment_from_camera.Inverse() * position);
  }
  for (uint32_t i = 0; i < segment.keyframes.size(); ++i) {
    bent.keyframes[i].map_from_camera = fit.base_from_camera[i];
  }
  return bent;
}

std::vector<SameLandmark> NamesOf(const std::vector<MergedLandmark>& merged, const LeanMap& base,
                                  const LeanMap& segment) {
  std::vector<SameLandmark> names;
  for (const auto& [pair, position_in_base, distance_m] : merged) {
    names.push_back({base.landmarks[pair.base_idx].id, segment.landmarks[pair.segment_idx].id});
  }
  std::sort(names.begin(), names.end());
  return names;
}

/// What both maps have, once it is known where the segment's keyframes are.
absl::StatusOr<FittedSegment> Finish(const LeanMap& base, const ReconstructedMap& base_map,
                                     const LeanMap& segment, const ReconstructedMap& segment_map,
                                     const SegmentFit& fit, const FitOptions& options) {
  const std::vector<LandmarkPair> matches =
      MatchLandmarks(base_map, segment_map, fit, options.bend);
  LeanMap bent = Bent(segment, segment_map, fit);
  const std::vector<MergedLandmark> merged =
      MergePositions(base_map, Reconstruct(bent), matches, options.bend.tracking.noise);
  const Strain strain = LargestStrain(segment_map, fit);
  CARMAP_RETURN_IF_ERROR(CheckAgreement(fit, strain, options));

  FittedSegment fitted;
  fitted.diff.seen_again = NamesOf(merged, base, segment);
  fitted.diff.drive = std::move(bent);
  fitted.report = {.segment_keyframes_overlapping = fit.anchors.size(),
                   .segment_keyframes_contradicting = fit.contradicting.size(),
                   .base_keyframes_overlapping = CountBaseKeyframes(base_map, merged),
                   .matches = matches.size(),
                   .inliers = merged.size(),
                   .median_distance_m = MedianDistanceM(merged),
                   .median_misfit_m = MedianMisfitM(fit),
                   .largest_strain = strain.ratio,
                   .scale = Scale(fit, segment)};
  fitted.anchors = fit.anchors;
  fitted.steps = fit.steps;
  return fitted;
}

}  // namespace

absl::StatusOr<FittedSegment> Fit(const LeanMap& base, const LeanMap& segment,
                                  const FitOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckConsistency(base));
  CARMAP_RETURN_IF_ERROR(CheckConsistency(segment));
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

  const SegmentFit fit = FitSegment(base_map, segment_map, overlap.best, options.bend, locator);
  CARMAP_ASSIGN_OR_RETURN(FittedSegment fitted,
                          Finish(base, base_map, segment, segment_map, fit, options));
  FitReport& report = fitted.report;
  report.segment_keyframes_tried = overlap.tried;
  report.segment_keyframes_found = overlap.found;
  CARMAP_RETURN_IF_ERROR(CheckSize(fit.anchors.size(), report.matches, report.inliers, options));
  return fitted;
}

absl::StatusOr<FittedSegment> FitLocalized(const LeanMap& base, const ReconstructedMap& base_map,
                                           const LeanMap& segment,
                                           std::vector<AnchoredKeyframe> anchors,
                                           const FitOptions& options) {
  const ReconstructedMap segment_map = Reconstruct(segment, base_map.focal_length_px);
  const SegmentFit fit = FitLocalized(segment_map, std::move(anchors), options.bend);
  return Finish(base, base_map, segment, segment_map, fit, options);
}

}  // namespace carmap
