// How far an estimated trajectory is from the truth: absolute trajectory error, and the relative
// error of the KITTI odometry benchmark.
//
// Pure functions, thread-safe. Estimate and truth may live in different world frames.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/summary.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

/// A frame that has an estimated and a true pose, each in its own world frame.
struct MatchedPose {
  Rigid3 estimate_from_camera, truth_from_camera;
  double path_m = 0;  ///< driven up to here along the truth
};

struct MatchedTrajectory {
  std::vector<MatchedPose> poses;  ///< in the order of the truth
  size_t lost_frames = 0;          ///< true poses without an estimate
  double path_length_m = 0;        ///< of the truth, lost frames included
};

/// Pairs by time stamp (the nearest within 0.02 s) when both sides have stamps, else by line
/// number. Lost frames are left out and counted; they are part of the path driven. Errors:
/// InvalidArgument for different counts by line number, or no frame in common.
absl::StatusOr<MatchedTrajectory> MatchTrajectories(const Trajectory& estimate,
                                                    const Trajectory& truth);

/// Distances between positions after the best rigid alignment of the estimate.
struct AbsoluteError {
  double rmse_m = 0;
  Summary position_m;
};

/// Nothing for fewer than three poses.
std::optional<AbsoluteError> AbsoluteTrajectoryError(const MatchedTrajectory& matched);

/// Relative error of all sub-sequences of one length, or of several.
struct RelativeError {
  double t_rel_percent = 0, r_rel_deg_per_100m = 0;
  size_t subsequences = 0;
};

struct RelativeErrorOfLength : RelativeError {
  double length_m = 0;
};

struct RelativeErrors : RelativeError {          ///< mean over all sub-sequences of all lengths
  std::vector<RelativeErrorOfLength> by_length;  ///< ascending; lengths without any are left out
};

/// Which sub-sequences are looked at.
struct SubsequenceChoice {
  std::vector<double> lengths_m;
  size_t start_step = 1;  ///< a sub-sequence starts at every start_step-th frame
};

/// 5, 10 … 50 m, from every frame: for drives too short for KITTI's own.
SubsequenceChoice ShortSubsequences();
/// 100, 200 … 800 m, from every 10th frame: as KITTI's development kit has it.
SubsequenceChoice LongSubsequences();

/// KITTI's measure (Geiger et al., CVPR 2012, and its development kit): a sub-sequence ends at the
/// first frame that is farther than its length along the true path; translation and rotation of its
/// relative motion's error are divided by the nominal length. One whose end was lost, so that the
/// next matched frame is farther than twice the length, is left out. Nothing if none fits on the
/// path.
std::optional<RelativeErrors> RelativeTrajectoryError(const MatchedTrajectory& matched,
                                                      const SubsequenceChoice& choice);

struct TrajectoryEvaluation {
  size_t matched_frames = 0, lost_frames = 0;
  double path_length_m = 0;
  std::optional<AbsoluteError> ate;
  std::optional<RelativeErrors> relative_short, relative_long;

  /// KITTI's own lengths where the path has them, else the short ones.
  const std::optional<RelativeErrors>& relative() const {
    return relative_long ? relative_long : relative_short;
  }
};

/// All of the above. Errors: as MatchTrajectories.
absl::StatusOr<TrajectoryEvaluation> EvaluateTrajectory(const Trajectory& estimate,
                                                        const Trajectory& truth);

/// Keys of a report: matched_frames lost_frames path_length_m; ate_rmse_m ate_m{median mean p95
/// max}; t_rel_percent r_rel_deg_per_100m (of relative()); the same two with `_5_50` and `_100_800`
/// before the unit; relative_by_length[{length_m t_rel_percent r_rel_deg_per_100m subsequences}].
/// What could not be measured is left out.
nlohmann::ordered_json ToJson(const TrajectoryEvaluation& evaluation);

/// A table for a person to read, ending with a new line.
std::string ToText(const TrajectoryEvaluation& evaluation);

}  // namespace carmap
