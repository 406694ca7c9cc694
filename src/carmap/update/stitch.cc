#include "carmap/update/stitch.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cstdint>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "carmap/base/status_macros.h"
#include "carmap/index/reconstruct.h"
#include "carmap/update/landmark_pairs.h"

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
  for (const AnchoredKeyframe& anchor : anchors)
    largest_m = std::max(largest_m, DistanceM(anchor, fit));
  return largest_m;
}

/// Where a landmark of the segment goes that the base has too, and how far apart the two are.
struct MergedLandmark {
  LandmarkPair pair;
  Eigen::Vector3d position_in_base;
  double distance_m = 0;
};

/// A segment fitted to a base map, and what both saw.
struct Join {
  SegmentFit fit;
  Strain strain;
  std::vector<Eigen::Vector3d> positions_in_base;  ///< of the segment's landmarks
  size_t matches = 0;
  std::vector<MergedLandmark> merged;
};

absl::Status CheckFit(const Join& join, const StitchOptions& options) {
  const SegmentFit& fit = join.fit;
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
  if (join.strain.ratio > options.max_strain) {
    return absl::FailedPreconditionError(fmt::format(
        "the segment contradicts the base map: to fit it, {:.0f} m of it from keyframe {} on would "
        "have to be bent by {:.1f} m, {:.1f} m are allowed; one of the two maps is wrong there",
        kStrainStretchM, join.strain.keyframe_idx, kStrainStretchM * join.strain.ratio,
        kStrainStretchM * options.max_strain));
  }
  const size_t inliers = join.merged.size();
  if (keyframes >= options.min_keyframes && inliers >= options.min_inliers &&
      static_cast<double>(inliers) >=
          options.min_inlier_ratio * static_cast<double>(join.matches)) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(fmt::format(
      "the segment hardly overlaps the base map: {} keyframes and {} landmarks match, of which {} "
      "lie in one place; {} keyframes, {} landmarks and {:.0f} % in one place are needed; map "
      "further into road that the base map holds",
      keyframes, join.matches, inliers, options.min_keyframes, options.min_inliers,
      100 * options.min_inlier_ratio));
}

/// Landmarks ride on the keyframe that stands nearest to them, which knows best where they are.
std::vector<Eigen::Vector3d> PositionsInBase(const ReconstructedMap& segment,
                                             const std::vector<Rigid3>& base_from_camera) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(segment.snapshot.landmarks.size());
  for (uint32_t i = 0; i < segment.snapshot.landmarks.size(); ++i) {
    const Eigen::Vector3d& position = segment.snapshot.landmarks[i].position_in_map;
    const auto distance_from = [&](uint32_t keyframe_idx) {
      const auto& keyframe = segment.snapshot.keyframes[keyframe_idx];
      return (keyframe.map_from_camera.translation - position).squaredNorm();
    };
    const auto viewers = segment.keyframes_of_landmark[i];
    const uint32_t nearest = *std::min_element(
        viewers.begin(), viewers.end(),
        [&](uint32_t a, uint32_t b) { return distance_from(a) < distance_from(b); });
    const Rigid3& segment_from_camera = segment.snapshot.keyframes[nearest].map_from_camera;
    positions.push_back(base_from_camera[nearest] * (segment_from_camera.Inverse() * position));
  }
  return positions;
}

/// Both positions weighted by what is known of them; nothing if they are not of one place.
std::optional<MergedLandmark> MergePositions(const ReconstructedMap& base,
                                             const ReconstructedMap& segment,
                                             const LandmarkPair& pair, const Join& join,
                                             const MeasurementNoise& noise) {
  constexpr double kFitSigmaM = 0.05;         // of the bent segment, common to its landmarks there
  constexpr double kChiSquareBound = 16.266;  // 99.9 %, three degrees of freedom
  const uint32_t viewer = segment.keyframes_of_landmark[pair.segment_idx].front();
  const Eigen::Matrix3d base_from_segment =
      (join.fit.base_from_camera[viewer].rotation *
       segment.snapshot.keyframes[viewer].map_from_camera.rotation.conjugate())
          .toRotationMatrix();
  const Eigen::Matrix3d by_base = LandmarkCovariance(base, pair.base_idx, noise);
  Eigen::Matrix3d by_segment = base_from_segment *
                               LandmarkCovariance(segment, pair.segment_idx, noise) *
                               base_from_segment.transpose();
  by_segment.diagonal().array() += kFitSigmaM * kFitSigmaM;
  const Eigen::Vector3d& p_by_base = base.snapshot.landmarks[pair.base_idx].position_in_map;
  const Eigen::Vector3d difference = join.positions_in_base[pair.segment_idx] - p_by_base;
  const Eigen::Vector3d weighted = (by_base + by_segment).inverse() * difference;
  if (difference.dot(weighted) > kChiSquareBound) return std::nullopt;
  return MergedLandmark{pair, p_by_base + by_base * weighted, difference.norm()};
}

Join JoinMaps(const ReconstructedMap& base, const ReconstructedMap& segment,
              const LocatedKeyframe& start, const StitchOptions& options,
              KeyframeLocator& locator) {
  Join join;
  join.fit = FitSegment(base, segment, start, options.fit, locator);
  join.strain = LargestStrain(segment, join.fit);
  join.positions_in_base = PositionsInBase(segment, join.fit.base_from_camera);
  const auto pairs = MatchLandmarks(base, segment, join.fit, options.fit);
  join.matches = pairs.size();
  for (const LandmarkPair& pair : pairs) {
    if (const auto merged = MergePositions(base, segment, pair, join, options.fit.tracking.noise)) {
      join.merged.push_back(*merged);
    }
  }
  return join;
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

/// What the segment saw of a landmark that the base has.
void MergeInto(LeanLandmark& kept, const LeanLandmark& landmark) {
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

LeanMap Merge(const LeanMap& base, const LeanMap& segment, const Join& join) {
  const auto by_id = [](const auto& a, const auto& b) { return a.id < b.id; };
  LeanMap merged = base;
  merged.drives.insert(merged.drives.end(), segment.drives.begin(), segment.drives.end());
  std::sort(merged.drives.begin(), merged.drives.end(), by_id);
  for (size_t i = 0; i < segment.keyframes.size(); ++i) {
    merged.keyframes.push_back(segment.keyframes[i]);
    merged.keyframes.back().map_from_camera = join.fit.base_from_camera[i];
  }
  std::sort(merged.keyframes.begin(), merged.keyframes.end(), by_id);

  std::vector<uint32_t> base_places;
  const auto segment_places = MergeById(base.keyframes, segment.keyframes, base_places);
  for (LeanLandmark& landmark : merged.landmarks) {
    for (uint32_t& idx : landmark.keyframe_idxs) idx = base_places[idx];
  }
  std::vector<const MergedLandmark*> in_base(segment.landmarks.size(), nullptr);
  for (const MergedLandmark& landmark : join.merged) in_base[landmark.pair.segment_idx] = &landmark;
  for (size_t i = 0; i < segment.landmarks.size(); ++i) {
    LeanLandmark landmark = segment.landmarks[i];
    for (uint32_t& idx : landmark.keyframe_idxs) idx = segment_places[idx];
    if (!in_base[i]) {
      landmark.position_in_map = join.positions_in_base[i];
      merged.landmarks.push_back(std::move(landmark));
      continue;
    }
    LeanLandmark& kept = merged.landmarks[in_base[i]->pair.base_idx];
    kept.position_in_map = in_base[i]->position_in_base;
    MergeInto(kept, landmark);
  }
  std::sort(merged.landmarks.begin(), merged.landmarks.end(), by_id);
  return merged;
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

double MedianDistanceM(std::vector<MergedLandmark> merged) {
  const auto middle = merged.begin() + static_cast<ptrdiff_t>(merged.size() / 2);
  std::nth_element(merged.begin(), middle, merged.end(),
                   [](const auto& a, const auto& b) { return a.distance_m < b.distance_m; });
  return middle->distance_m;
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
  if (base.keyframes.empty()) return StitchedMap{segment, {}};
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
  const Join join = JoinMaps(base_map, segment_map, overlap.best, options, locator);
  CARMAP_RETURN_IF_ERROR(CheckFit(join, options));

  StitchedMap stitched{Merge(base, segment, join), {}};
  stitched.report = {.segment_keyframes_tried = overlap.tried,
                     .segment_keyframes_found = overlap.found,
                     .segment_keyframes_overlapping = join.fit.anchors.size(),
                     .segment_keyframes_contradicting = join.fit.contradicting.size(),
                     .base_keyframes_overlapping = CountBaseKeyframes(base_map, join.merged),
                     .matches = join.matches,
                     .inliers = join.merged.size(),
                     .median_distance_m = MedianDistanceM(join.merged),
                     .largest_misfit_m = LargestDistanceM(join.fit.anchors, join.fit),
                     .largest_strain = join.strain.ratio,
                     .scale = Scale(join.fit, segment)};
  CARMAP_RETURN_IF_ERROR(CheckConsistency(stitched.map));
  return stitched;
}

}  // namespace carmap
