#include "carmap/update/segment_fit.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <queue>
#include <tuple>
#include <utility>

#include "carmap/feature/feature_grid.h"
#include "carmap/localize/keyframe_view.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/localize/landmark_shift.h"

namespace carmap {
namespace {

// Search windows grow with the error of the prediction, as it appears at a distance where most
// landmarks are not nearer, up to so much.
/// Way to an anchor where there is none.
constexpr double kFarM = 1e9;
constexpr double kNearM = 10, kMaxRadiusPx = 60;
constexpr double kLocatedSlackM = 1.5, kLocatedSlackRad = 0.1;
constexpr size_t kCovisibleLinks = 4;
// Keyframes near each other are anchored by the same landmarks, so that their errors are not their
// own: standard deviations are so many times what each for itself would have.
constexpr double kSharedErrors = 6;

/// Keyframes that the segment itself places relative to each other.
class SegmentLinks {
 public:
  explicit SegmentLinks(const ReconstructedMap& segment) : segment_(segment) {}

  /// The keyframes before and after in the drive, and those that see most of the same.
  std::vector<uint32_t> Of(uint32_t keyframe_idx) const {
    std::vector<uint32_t> linked = WithCovisible(segment_, keyframe_idx, kCovisibleLinks);
    linked.erase(linked.begin());
    if (keyframe_idx > 0 && AreInOneDrive(keyframe_idx - 1, keyframe_idx)) {
      linked.push_back(keyframe_idx - 1);
    }
    if (keyframe_idx + 1 < segment_.snapshot.keyframes.size() &&
        AreInOneDrive(keyframe_idx, keyframe_idx + 1)) {
      linked.push_back(keyframe_idx + 1);
    }
    return linked;
  }
  Rigid3 Between(uint32_t from, uint32_t to) const {  // from_from_to
    return Pose(from).Inverse() * Pose(to);
  }
  bool AreInOneDrive(uint32_t a, uint32_t b) const {
    const auto& keyframes = segment_.snapshot.keyframes;
    return keyframes[a].id.drive == keyframes[b].id.drive;
  }
  /// Whether the drive tracked itself from the keyframe to the next.
  bool IsStep(uint32_t keyframe_idx) const {
    const uint32_t next = keyframe_idx + 1;
    const auto seen_with = segment_.covisible()[next];
    return AreInOneDrive(keyframe_idx, next) &&
           std::any_of(seen_with.begin(), seen_with.end(), [&](const CovisibleKeyframe& other) {
             return other.keyframe_idx < next && AreInOneDrive(other.keyframe_idx, next);
           });
  }
  bool IsLostBetween(uint32_t a, uint32_t b) const {
    return std::max(a, b) - std::min(a, b) == 1 && AreInOneDrive(a, b) && !IsStep(std::min(a, b));
  }
  const Rigid3& Pose(uint32_t keyframe_idx) const {
    return segment_.snapshot.keyframes[keyframe_idx].map_from_camera;
  }

 private:
  const ReconstructedMap& segment_;
};

/// Where the way from an anchor leads.
struct Prediction {
  uint32_t keyframe_idx = 0;
  Rigid3 base_from_camera;
  double since_anchor_m = 0;  ///< way from the last anchor; from there the error grows
  double error_m = 0;         ///< at most
  double searched_at_m = 0;   ///< the error at which it was last looked for in vain

  /// The surest comes first.
  bool operator<(const Prediction& other) const {
    return std::tie(other.error_m, other.keyframe_idx) < std::tie(error_m, keyframe_idx);
  }
};

class AnchorSearch {
 public:
  AnchorSearch(const ReconstructedMap& base, const ReconstructedMap& segment,
               const BendOptions& options, KeyframeLocator& locator)
      : base_(base), segment_(segment), links_(segment), options_(options), locator_(locator) {}

  /// Poses of all keyframes, by anchors or by the way from the nearest one, and the anchors.
  SegmentFit Run(const LocatedKeyframe& start) {
    const Rigid3 base_from_segment =
        start.base_from_camera * links_.Pose(start.keyframe_idx).Inverse();
    SegmentFit fit;
    for (const SnapshotKeyframe& keyframe : segment_.snapshot.keyframes) {
      fit.base_from_camera.push_back(base_from_segment * keyframe.map_from_camera);
    }
    std::vector<bool> is_placed(fit.base_from_camera.size(), false);
    std::priority_queue<Prediction> open;
    open.push({start.keyframe_idx, start.base_from_camera, kFarM, 0, 0});
    while (!open.empty()) {
      Prediction next = open.top();
      open.pop();
      if (is_placed[next.keyframe_idx]) continue;
      is_placed[next.keyframe_idx] = true;
      if (auto anchor = Find(next)) {
        next = {anchor->keyframe_idx, anchor->base_from_camera, 0, 0, 0};
        fit.anchors.push_back(*std::move(anchor));
      }
      fit.base_from_camera[next.keyframe_idx] = next.base_from_camera;
      for (const uint32_t linked : links_.Of(next.keyframe_idx)) {
        if (!is_placed[linked]) open.push(Follow(next, linked));
      }
    }
    return fit;
  }

  /// Looks for the keyframe around a pose that is about right.
  std::optional<AnchoredKeyframe> FindNear(uint32_t keyframe_idx, const Rigid3& base_from_camera,
                                           double radius_px) const {
    const bool is_at_base =
        !base_.keyframe_centers
             .WithinRadius(base_from_camera.translation, options_.neighbourhood.radius_m, 1)
             .empty();
    if (!is_at_base) return std::nullopt;
    const StereoRig& rig = RigOf(segment_, keyframe_idx);
    const KeyframeView view = ViewFrom(segment_, keyframe_idx, options_.view_neighbours);
    const FeatureGrid grid(view.features, rig.camera.width, rig.camera.height);
    TrackingOptions tracking = options_.tracking;
    tracking.first_radius_px = radius_px;
    const auto pose =
        TrackAround(base_, grid, rig, base_from_camera.Inverse(), tracking, options_.neighbourhood);
    if (!pose) return std::nullopt;
    return Refine(keyframe_idx, view, grid, pose->camera_from_map);
  }

 private:
  /// With what is known of the landmarks of both maps: those that the base saw from afar only, as
  /// at its end, are metres off.
  std::optional<AnchoredKeyframe> Refine(uint32_t keyframe_idx, const KeyframeView& view,
                                         const FeatureGrid& grid,
                                         const Rigid3& camera_from_base) const {
    const StereoRig& rig = RigOf(segment_, keyframe_idx);
    const MeasurementNoise& noise = options_.tracking.noise;
    const auto matches = MatchByProjection(
        base_.snapshot, LandmarksAround(base_, camera_from_base.Inverse(), options_.neighbourhood),
        grid, rig, camera_from_base, {.radius_px = options_.tracking.final_radius_px});
    auto measurements = MeasurementsOf(base_.snapshot, view.features, rig, matches);
    const Rigid3 camera_from_segment = links_.Pose(keyframe_idx).Inverse();
    for (size_t i = 0; i < matches.size(); ++i) {
      const LandmarkMatch& match = matches[i];
      const LandmarkShift in_base =
          ShiftOf(base_.snapshot.landmarks[match.landmark_idx], rig, camera_from_base, noise);
      const LandmarkShift in_segment =
          ShiftOf(segment_.snapshot.landmarks[view.landmark_idxs[match.feature_idx]], rig,
                  camera_from_segment, noise);
      measurements[i].landmark_sigma_px =
          (in_base.sigma_px.array().square() + in_segment.sigma_px.array().square()).sqrt();
    }
    const PoseEstimate estimate = RefinePose(rig, noise, measurements, camera_from_base);
    if (estimate.inlier_count < options_.tracking.min_inliers) return std::nullopt;
    return AnchoredKeyframe{
        keyframe_idx, estimate.camera_from_map.Inverse(),
        std::hypot(kSharedErrors * SigmaM(estimate.covariance), options_.min_sigma_m),
        std::hypot(kSharedErrors * SigmaRad(estimate.covariance), options_.min_sigma_rad), 1};
  }

  Prediction Follow(const Prediction& from, uint32_t to) const {
    const Rigid3 step = links_.Between(from.keyframe_idx, to);
    const double error_m = links_.IsLostBetween(from.keyframe_idx, to)
                               ? options_.step.lost_sigma_m
                               : options_.max_drift_ratio * step.translation.norm();
    return {to, from.base_from_camera * step, from.since_anchor_m + step.translation.norm(),
            from.error_m + error_m, from.searched_at_m};
  }

  /// Near the prediction if that is sure enough, else anywhere that it allows.
  std::optional<AnchoredKeyframe> Find(Prediction& predicted) {
    if (predicted.since_anchor_m < options_.anchor_spacing_m) return std::nullopt;
    const double fx = RigOf(segment_, predicted.keyframe_idx).camera.fx;
    if (predicted.error_m > options_.max_predicted_error_m) return FindAgain(predicted);
    const double radius_px = options_.tracking.first_radius_px + fx * predicted.error_m / kNearM;
    return FindNear(predicted.keyframe_idx, predicted.base_from_camera,
                    std::min(radius_px, kMaxRadiusPx));
  }

  std::optional<AnchoredKeyframe> FindAgain(Prediction& predicted) {
    if (predicted.error_m < predicted.searched_at_m + options_.search_again_m ||
        LandmarksAround(base_, predicted.base_from_camera, options_.neighbourhood).empty()) {
      return std::nullopt;
    }
    predicted.searched_at_m = predicted.error_m;
    for (const LocatedKeyframe& located : locator_.Locate(predicted.keyframe_idx)) {
      const Rigid3 off = predicted.base_from_camera.Inverse() * located.base_from_camera;
      if (off.translation.norm() > predicted.error_m + kLocatedSlackM ||
          RotationAngle(off.rotation) > kLocatedSlackRad) {
        continue;
      }
      return FindNear(predicted.keyframe_idx, located.base_from_camera,
                      options_.tracking.first_radius_px);
    }
    return std::nullopt;
  }

  const ReconstructedMap &base_, &segment_;
  const SegmentLinks links_;
  const BendOptions& options_;
  KeyframeLocator& locator_;
};

/// Poses that the anchors and the segment's steps agree on best, and the weight of each anchor.
void Bend(const ReconstructedMap& segment, const BendOptions& options, SegmentFit& fit) {
  constexpr uint32_t kBase = 0, kFirstPose = 1;
  PoseGraph graph;
  graph.camera_from_map.push_back(Rigid3());
  for (const Rigid3& base_from_camera : fit.base_from_camera) {
    graph.camera_from_map.push_back(base_from_camera.Inverse());
  }
  graph.pose_is_fixed.assign(graph.camera_from_map.size(), false);
  graph.pose_is_fixed[kBase] = true;
  for (const AnchoredKeyframe& anchor : fit.anchors) {
    graph.edges.push_back({kBase, kFirstPose + anchor.keyframe_idx,
                           anchor.base_from_camera.Inverse(), anchor.sigma_m, anchor.sigma_rad,
                           /*is_robust=*/true});
  }
  for (const auto& [from, to, is_lost] : fit.steps) {
    const Rigid3 to_from_from = segment.snapshot.keyframes[to].map_from_camera.Inverse() *
                                segment.snapshot.keyframes[from].map_from_camera;
    graph.edges.push_back(
        StepEdge(kFirstPose + from, kFirstPose + to, to_from_from, options.step, is_lost));
  }
  const PoseGraphSummary summary = SolvePoseGraph(graph);
  for (size_t i = 0; i < fit.anchors.size(); ++i) fit.anchors[i].weight = summary.edge_weights[i];
  for (size_t i = 0; i < fit.base_from_camera.size(); ++i) {
    fit.base_from_camera[i] = graph.camera_from_map[kFirstPose + i].Inverse();
  }
}

/// Of each keyframe, the way along its drive to the nearest anchor; kFarM where there is none.
std::vector<double> WaysToAnchors(const SegmentLinks& links, const SegmentFit& fit) {
  const auto count = static_cast<uint32_t>(fit.base_from_camera.size());
  std::vector<double> ways_m(count, kFarM);
  for (const AnchoredKeyframe& anchor : fit.anchors) ways_m[anchor.keyframe_idx] = 0;
  const auto shorten = [&](uint32_t from, uint32_t to) {
    if (!links.AreInOneDrive(from, to)) return;
    ways_m[to] = std::min(ways_m[to], ways_m[from] + links.Between(from, to).translation.norm());
  };
  for (uint32_t i = 1; i < count; ++i) shorten(i - 1, i);
  for (uint32_t i = count; i-- > 1;) shorten(i, i - 1);
  return ways_m;
}

/// Looks where the bent segment puts them for keyframes far from anchors or that contradict it.
void FindMoreAnchors(const SegmentLinks& links, const AnchorSearch& search,
                     const BendOptions& options, SegmentFit& fit) {
  std::erase_if(fit.anchors,
                [&](const AnchoredKeyframe& anchor) { return anchor.weight < options.min_weight; });
  const std::vector<double> ways_m = WaysToAnchors(links, fit);
  for (uint32_t i = 0; i < ways_m.size(); ++i) {
    if (ways_m[i] < options.anchor_spacing_m) continue;
    auto anchor = search.FindNear(i, fit.base_from_camera[i], options.tracking.first_radius_px);
    if (anchor) fit.anchors.push_back(*std::move(anchor));
  }
}

/// Those that hold from those that the others contradict.
void SplitAnchors(const BendOptions& options, SegmentFit& fit) {
  const auto contradicting = std::stable_partition(
      fit.anchors.begin(), fit.anchors.end(),
      [&](const AnchoredKeyframe& anchor) { return anchor.weight >= options.min_weight; });
  fit.contradicting.assign(std::make_move_iterator(contradicting),
                           std::make_move_iterator(fit.anchors.end()));
  fit.anchors.erase(contradicting, fit.anchors.end());
}

}  // namespace

std::vector<DriveStep> StepsOf(const ReconstructedMap& map) {
  constexpr size_t kMaxFarSteps = 2;
  constexpr uint32_t kMinSharedLandmarks = 30, kMinKeyframesBetween = 20;
  const SegmentLinks links(map);
  std::vector<DriveStep> steps;
  for (uint32_t i = 0; i < map.snapshot.keyframes.size(); ++i) {
    if (i > 0 && links.AreInOneDrive(i - 1, i)) steps.push_back({i - 1, i, !links.IsStep(i - 1)});
    size_t far_steps = 0;
    for (const CovisibleKeyframe& other : map.covisible()[i]) {
      if (other.shared_landmarks < kMinSharedLandmarks || far_steps == kMaxFarSteps) break;
      if (other.keyframe_idx >= i || (links.AreInOneDrive(other.keyframe_idx, i) &&
                                      other.keyframe_idx + kMinKeyframesBetween > i)) {
        continue;
      }
      steps.push_back({other.keyframe_idx, i, false});
      ++far_steps;
    }
  }
  return steps;
}

SegmentFit FitLocalized(const ReconstructedMap& segment, std::vector<AnchoredKeyframe> anchors,
                        const BendOptions& options) {
  SegmentFit fit;
  auto nearest = anchors.begin();
  for (uint32_t i = 0; i < segment.snapshot.keyframes.size(); ++i) {
    while (std::next(nearest) != anchors.end() && std::next(nearest)->keyframe_idx <= i) ++nearest;
    const Rigid3& segment_from_anchor =
        segment.snapshot.keyframes[nearest->keyframe_idx].map_from_camera;
    fit.base_from_camera.push_back(nearest->base_from_camera * segment_from_anchor.Inverse() *
                                   segment.snapshot.keyframes[i].map_from_camera);
  }
  fit.anchors = std::move(anchors);
  fit.steps = StepsOf(segment);
  Bend(segment, options, fit);
  SplitAnchors(options, fit);
  return fit;
}

SegmentFit FitSegment(const ReconstructedMap& base, const ReconstructedMap& segment,
                      const LocatedKeyframe& start, const BendOptions& options,
                      KeyframeLocator& locator) {
  AnchorSearch search(base, segment, options, locator);
  SegmentFit fit = search.Run(start);
  fit.steps = StepsOf(segment);
  Bend(segment, options, fit);
  FindMoreAnchors(SegmentLinks(segment), search, options, fit);
  Bend(segment, options, fit);
  std::sort(fit.anchors.begin(), fit.anchors.end(),
            [](const AnchoredKeyframe& a, const AnchoredKeyframe& b) {
              return a.keyframe_idx < b.keyframe_idx;
            });
  SplitAnchors(options, fit);
  return fit;
}

Strain LargestStrain(const ReconstructedMap& segment, const SegmentFit& fit) {
  const SegmentLinks links(segment);
  const auto count = static_cast<uint32_t>(fit.base_from_camera.size());
  Strain largest;
  double length_m = 0;  // of the way from keyframe `from` to `to`
  for (uint32_t from = 0, to = 0; from < count; ++from) {
    if (to <= from) {
      to = from;
      length_m = 0;
    }
    while (length_m < kStrainStretchM && to + 1 < count && links.IsStep(to)) {
      length_m += links.Between(to, to + 1).translation.norm();
      ++to;
    }
    if (length_m >= kStrainStretchM) {
      const Eigen::Vector3d before = links.Between(from, to).translation;
      const Eigen::Vector3d after =
          (fit.base_from_camera[from].Inverse() * fit.base_from_camera[to]).translation;
      const double ratio = (after - before).norm() / length_m;
      if (ratio > largest.ratio) largest = {ratio, from};
    }
    if (to > from) length_m -= links.Between(from, from + 1).translation.norm();
  }
  return largest;
}

std::vector<LandmarkPair> MatchLandmarks(const ReconstructedMap& base,
                                         const ReconstructedMap& segment, const SegmentFit& fit,
                                         const BendOptions& options) {
  std::vector<LandmarkPair> matches;
  for (uint32_t i = 0; i < fit.base_from_camera.size(); ++i) {
    const auto landmark_idxs =
        LandmarksAround(base, fit.base_from_camera[i], options.neighbourhood);
    if (landmark_idxs.empty()) continue;
    const StereoRig& rig = RigOf(segment, i);
    const KeyframeView view = ViewFrom(segment, i, options.view_neighbours);
    const FeatureGrid grid(view.features, rig.camera.width, rig.camera.height);
    for (const auto& [landmark_idx, feature_idx] : MatchByProjection(
             base.snapshot, landmark_idxs, grid, rig, fit.base_from_camera[i].Inverse(),
             {.radius_px = options.tracking.final_radius_px})) {
      matches.push_back({landmark_idx, view.landmark_idxs[feature_idx]});
    }
  }
  return MostFrequent(std::move(matches), base.snapshot.landmarks.size(),
                      segment.snapshot.landmarks.size());
}

}  // namespace carmap
