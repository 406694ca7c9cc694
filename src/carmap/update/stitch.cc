#include "carmap/update/stitch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/index/reconstruct.h"
#include "carmap/update/landmark_pairs.h"

namespace carmap {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

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

absl::Status CheckCoarse(const CoarseOverlap& overlap, const StitchOptions& options) {
  if (overlap.agreeing < options.min_keyframes) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment does not overlap the base map: of {} keyframes looked for {} were found there "
        "and {} agree on a place, {} are needed; map further into road that the base map holds",
        overlap.tried, overlap.found, overlap.agreeing, options.min_keyframes));
  }
  if (overlap.IsAmbiguous(options.overlap)) {
    return absl::FailedPreconditionError(
        fmt::format("the segment fits the base map in two places: {} keyframes agree on one, {} on "
                    "another; map further into road that the base map holds, or with GPS",
                    overlap.agreeing, overlap.dissenting));
  }
  return absl::OkStatus();
}

absl::Status CheckFine(const FineOverlap& overlap, const PairAlignment* alignment,
                       const StitchOptions& options) {
  const int inliers = alignment ? alignment->inlier_count : 0;
  const size_t keyframes = overlap.segment_keyframes.size(), matches = overlap.pairs.size();
  if (keyframes >= options.min_keyframes && inliers >= options.min_inliers &&
      inliers >= options.min_inlier_ratio * static_cast<double>(matches)) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(fmt::format(
      "the segment hardly overlaps the base map: {} keyframes and {} landmarks match, of which {} "
      "lie in one place; {} keyframes, {} landmarks and {:.0f} % in one place are needed; map "
      "further into road that the base map holds",
      keyframes, matches, inliers, options.min_keyframes, options.min_inliers,
      100 * options.min_inlier_ratio));
}

/// The pairs that lie in one place, and the transform that brings them there.
struct Fit {
  FineOverlap overlap;
  std::vector<LandmarkPair> inliers;
  Rigid3 base_from_segment;
  double median_distance_m = 0;
};

double LargestMisfit(const FineOverlap& overlap, const ReconstructedMap& segment,
                     const Rigid3& base_from_segment) {
  double largest_m = 0;
  for (size_t i = 0; i < overlap.segment_keyframes.size(); ++i) {
    const SnapshotKeyframe& keyframe = segment.snapshot.keyframes[overlap.segment_keyframes[i]];
    const Eigen::Vector3d put = base_from_segment * keyframe.map_from_camera.translation;
    largest_m = std::max(largest_m, (put - overlap.positions_in_base[i]).norm());
  }
  return largest_m;
}

/// FindTransform of Algorithm A.1: over the landmarks of all overlapping keyframes, where the paper
/// takes the one keyframe with most matches.
absl::StatusOr<Fit> FindTransform(const ReconstructedMap& base, const ReconstructedMap& segment,
                                  Rigid3 base_from_segment, const StitchOptions& options) {
  const MeasurementNoise& noise = options.overlap.tracking.noise;
  constexpr int kRounds = 3;  // more pairs are found with a better transform, and the reverse
  Fit fit;
  for (int round = 0; round < kRounds; ++round) {
    fit.overlap = MatchOverlap(base, segment, base_from_segment, options.overlap);
    const auto points = PointsOf(base, segment, fit.overlap.pairs, noise);
    const auto alignment = AlignPairs(points, base_from_segment);
    CARMAP_RETURN_IF_ERROR(CheckFine(fit.overlap, alignment ? &*alignment : nullptr, options));
    base_from_segment = alignment->base_from_segment;
    if (round + 1 < kRounds) continue;

    fit.base_from_segment = base_from_segment;
    std::vector<double> distances_m;
    for (size_t i = 0; i < points.size(); ++i) {
      if (!alignment->is_inlier[i]) continue;
      fit.inliers.push_back(fit.overlap.pairs[i]);
      distances_m.push_back(
          (base_from_segment * points[i].p_in_segment - points[i].p_in_base).norm());
    }
    const auto middle = distances_m.begin() + static_cast<std::ptrdiff_t>(distances_m.size() / 2);
    std::nth_element(distances_m.begin(), middle, distances_m.end());
    fit.median_distance_m = *middle;
  }
  return fit;
}

/// Where records of one map come to stand among those of the merged one.
template <typename Record>
std::vector<uint32_t> MergeById(const std::vector<Record>& base, const std::vector<Record>& segment,
                                std::vector<uint32_t>& base_places) {
  std::vector<uint32_t> segment_places;
  size_t b = 0, s = 0;
  while (b < base.size() || s < segment.size()) {
    const auto place = static_cast<uint32_t>(b + s);
    if (s == segment.size() || (b < base.size() && base[b].id < segment[s].id)) {
      base_places.push_back(place);
      ++b;
    } else {
      segment_places.push_back(place);
      ++s;
    }
  }
  return segment_places;
}

LeanMap Merge(const LeanMap& base, const LeanMap& segment, const Fit& fit) {
  const auto by_id = [](const auto& a, const auto& b) { return a.id < b.id; };
  LeanMap merged = base;
  merged.drives.insert(merged.drives.end(), segment.drives.begin(), segment.drives.end());
  std::sort(merged.drives.begin(), merged.drives.end(), by_id);
  for (LeanKeyframe keyframe : segment.keyframes) {
    keyframe.map_from_camera = fit.base_from_segment * keyframe.map_from_camera;
    merged.keyframes.push_back(keyframe);
  }
  std::sort(merged.keyframes.begin(), merged.keyframes.end(), by_id);

  std::vector<uint32_t> base_places;
  const auto segment_places = MergeById(base.keyframes, segment.keyframes, base_places);
  for (LeanLandmark& landmark : merged.landmarks) {
    for (uint32_t& idx : landmark.keyframe_idxs) idx = base_places[idx];
  }
  std::vector<uint32_t> base_of(segment.landmarks.size(), kNone);
  for (const LandmarkPair& pair : fit.inliers) base_of[pair.segment_idx] = pair.base_idx;
  for (size_t i = 0; i < segment.landmarks.size(); ++i) {
    LeanLandmark landmark = segment.landmarks[i];
    for (uint32_t& idx : landmark.keyframe_idxs) idx = segment_places[idx];
    if (base_of[i] == kNone) {
      landmark.position_in_map = fit.base_from_segment * landmark.position_in_map;
      merged.landmarks.push_back(std::move(landmark));
      continue;
    }
    LeanLandmark& kept = merged.landmarks[base_of[i]];
    // The level is that of the first keyframe in the list, whichever map it comes from.
    if (landmark.keyframe_idxs.front() < kept.keyframe_idxs.front()) {
      kept.first_level = landmark.first_level;
    }
    std::vector<uint32_t> seen_by;
    std::set_union(kept.keyframe_idxs.begin(), kept.keyframe_idxs.end(),
                   landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(),
                   std::back_inserter(seen_by));
    kept.keyframe_idxs = std::move(seen_by);
  }
  std::sort(merged.landmarks.begin(), merged.landmarks.end(), by_id);
  return merged;
}

size_t CountBaseKeyframes(const ReconstructedMap& base, const std::vector<LandmarkPair>& inliers) {
  std::vector<bool> sees(base.snapshot.keyframes.size(), false);
  for (const LandmarkPair& pair : inliers) {
    for (const uint32_t keyframe_idx : base.keyframes_of_landmark[pair.base_idx]) {
      sees[keyframe_idx] = true;
    }
  }
  return static_cast<size_t>(std::count(sees.begin(), sees.end(), true));
}

}  // namespace

absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckInputs(base, segment));
  if (base.keyframes.empty()) return StitchedMap{segment, {}};
  if (segment.landmarks.empty()) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment has no landmarks in its {} keyframes, so it cannot be placed in the base map; "
        "map a longer drive",
        segment.keyframes.size()));
  }

  const ReconstructedMap segment_map = Reconstruct(segment);
  const ReconstructedMap base_map = Reconstruct(base, segment_map.focal_length_px);
  const CoarseOverlap coarse = FindOverlap(base_map, segment_map, options.overlap);
  CARMAP_RETURN_IF_ERROR(CheckCoarse(coarse, options));
  CARMAP_ASSIGN_OR_RETURN(const Fit fit,
                          FindTransform(base_map, segment_map, coarse.base_from_segment, options));

  StitchedMap stitched{Merge(base, segment, fit), {}};
  stitched.report = {
      .segment_keyframes_tried = coarse.tried,
      .segment_keyframes_found = coarse.found,
      .segment_keyframes_overlapping = fit.overlap.segment_keyframes.size(),
      .base_keyframes_overlapping = CountBaseKeyframes(base_map, fit.inliers),
      .matches = fit.overlap.pairs.size(),
      .inliers = fit.inliers.size(),
      .duplicates_removed = fit.inliers.size(),
      .median_distance_m = fit.median_distance_m,
      .largest_misfit_m = LargestMisfit(fit.overlap, segment_map, fit.base_from_segment),
      .base_from_segment = fit.base_from_segment};
  CARMAP_RETURN_IF_ERROR(CheckConsistency(stitched.map));
  return stitched;
}

}  // namespace carmap
