// Fits a map segment to a base map along all of their overlap (paper §3.4, Algorithm A.1,
// FindTransform).
//
// The paper moves a segment rigidly by the pose of one keyframe. Two maps of one road differ in
// scale and shape by some tenths of a percent, so a rigid segment leaves the base's road after some
// hundred metres. Here the base stays and the segment bends: every keyframe that sees the base's
// landmarks is anchored where they put it, and the drive's own steps are springs between the
// keyframes. Pure, deterministic, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/map_neighbourhood.h"
#include "carmap/solve/pose_graph.h"
#include "carmap/update/keyframe_locator.h"
#include "carmap/update/landmark_pairs.h"

namespace carmap {

struct BendOptions {
  TrackingOptions tracking{.min_inliers = 12};  ///< of an anchor
  NeighbourhoodOptions neighbourhood;
  size_t view_neighbours = 16;  ///< keyframes that show what a keyframe is anchored by (ViewFrom)
  /// Nearer to an anchor, on the way that its drive took, a keyframe is none: it would see the
  /// same.
  double anchor_spacing_m = 1.8;
  double min_sigma_m = 0.05, min_sigma_rad = 0.002;  ///< of an anchor, whatever its landmarks say
  StepNoise step;                                    ///< of the segment's own steps
  /// How far a keyframe may be from where its neighbour's pose in the base puts it: so much of the
  /// way between them.
  double max_drift_ratio = 0.02;
  /// Beyond that error a keyframe is looked for like one of which nothing is known, each time that
  /// the error has grown by so much.
  double max_predicted_error_m = 1, search_again_m = 0.2;
  double min_weight = 0.5;  ///< in the solution, of an anchor that holds
};

/// A keyframe of the segment that sees landmarks of the base.
struct AnchoredKeyframe {
  uint32_t keyframe_idx = 0;
  Rigid3 base_from_camera;            ///< by the base's landmarks ...
  double sigma_m = 0, sigma_rad = 0;  ///< ... and how sure
  double weight = 0;                  ///< in the solution; 0: contradicts the others
};

/// By how much the fit changes a stretch of the segment, of so many metres.
inline constexpr double kStrainStretchM = 30;
struct Strain {
  double ratio = 0;  ///< of where the stretch's end lies, seen from its beginning, to its length
  uint32_t keyframe_idx = 0;  ///< where it begins
};

/// Two keyframes that a drive's map places relative to each other, ascending.
struct DriveStep {
  uint32_t from_idx = 0, to_idx = 0;
  bool is_lost = false;  ///< they see nothing in common
};

struct SegmentFit {
  std::vector<Rigid3> base_from_camera;         ///< of each keyframe of the segment
  std::vector<AnchoredKeyframe> anchors;        ///< ascending by keyframe; those that hold
  std::vector<AnchoredKeyframe> contradicting;  ///< and those that the others contradict
  std::vector<DriveStep> steps;                 ///< of the segment (StepsOf)
};

/// Of each keyframe the step from the one before it in its drive, and from two long before that
/// see much of the same: what holds the map of a drive together.
std::vector<DriveStep> StepsOf(const ReconstructedMap& map);

/// `start` is a keyframe whose place is known. From there the search for anchors goes along the
/// segment, each predicted from its neighbour; what left the base and comes back is found again.
SegmentFit FitSegment(const ReconstructedMap& base, const ReconstructedMap& segment,
                      const LocatedKeyframe& start, const BendOptions& options,
                      KeyframeLocator& locator);

/// The same of a segment whose drive was localized in the base, so that nothing is searched for:
/// `anchors` ascending by keyframe, at least one.
SegmentFit FitLocalized(const ReconstructedMap& segment, std::vector<AnchoredKeyframe> anchors,
                        const BendOptions& options);

/// Of all stretches the one that the fit changes most. A drive's own map is right to a few percent
/// there: more means that the fit is wrong, or one of the maps.
Strain LargestStrain(const ReconstructedMap& segment, const SegmentFit& fit);

/// What the segment's keyframes and the base's landmarks have in common where the fit puts them:
/// the landmarks of both, by place in the image and signature.
std::vector<LandmarkPair> MatchLandmarks(const ReconstructedMap& base,
                                         const ReconstructedMap& segment, const SegmentFit& fit,
                                         const BendOptions& options);

}  // namespace carmap
