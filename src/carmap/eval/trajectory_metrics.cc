#include "carmap/eval/trajectory_metrics.h"

#include <absl/status/status.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/solve/alignment.h"

namespace carmap {
namespace {

constexpr int64_t kMaxTimeDifferenceNs = 20'000'000;
constexpr double kDegPerRadian = 180 / std::numbers::pi;

bool AllStamped(const Trajectory& trajectory) {
  return std::all_of(trajectory.begin(), trajectory.end(),
                     [](const TimedPose& pose) { return pose.timestamp.has_value(); });
}

/// For each line of the truth the line of the estimate that belongs to it.
using LinePairs = std::vector<std::optional<size_t>>;

absl::StatusOr<LinePairs> PairByLine(const Trajectory& estimate, const Trajectory& truth) {
  if (estimate.size() != truth.size()) {
    return absl::InvalidArgumentError(
        fmt::format("the estimate has {} poses but the truth has {}; without time stamps in both, "
                    "line n of one must be line n of the other (a lost frame is a line of 12 nan)",
                    estimate.size(), truth.size()));
  }
  LinePairs pairs(truth.size());
  for (size_t i = 0; i < pairs.size(); ++i) pairs[i] = i;
  return pairs;
}

int64_t TimeDifferenceNs(const TimedPose& a, const TimedPose& b) {
  return std::abs(a.timestamp->ns - b.timestamp->ns);
}

/// Line of the trajectory, which ascends, whose time is nearest.
size_t NearestInTime(const Trajectory& trajectory, const TimedPose& pose) {
  const auto after = std::lower_bound(
      trajectory.begin(), trajectory.end(), pose,
      [](const TimedPose& a, const TimedPose& b) { return *a.timestamp < *b.timestamp; });
  if (after == trajectory.begin()) return 0;
  const bool before_is_nearer = after == trajectory.end() || TimeDifferenceNs(*(after - 1), pose) <=
                                                                 TimeDifferenceNs(*after, pose);
  return static_cast<size_t>(after - trajectory.begin()) - (before_is_nearer ? 1 : 0);
}

/// Each pose of the estimate goes to the nearest of the truth; of two that meet there the nearer
/// stays.
LinePairs PairByTime(const Trajectory& estimate, const Trajectory& truth) {
  LinePairs pairs(truth.size());
  for (size_t i = 0; i < estimate.size(); ++i) {
    const size_t line = NearestInTime(truth, estimate[i]);
    const int64_t difference_ns = TimeDifferenceNs(truth[line], estimate[i]);
    if (difference_ns > kMaxTimeDifferenceNs) continue;
    std::optional<size_t>& pair = pairs[line];
    if (!pair || difference_ns < TimeDifferenceNs(truth[line], estimate[*pair])) pair = i;
  }
  return pairs;
}

absl::Status CheckAscending(const Trajectory& trajectory, const std::string& name) {
  const auto out_of_turn = std::adjacent_find(
      trajectory.begin(), trajectory.end(),
      [](const TimedPose& a, const TimedPose& b) { return *a.timestamp >= *b.timestamp; });
  if (out_of_turn == trajectory.end()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("the times of the {} do not ascend at {:.6f} s; sort "
                  "its lines by time",
                  name, out_of_turn->timestamp->seconds()));
}

absl::StatusOr<LinePairs> PairLines(const Trajectory& estimate, const Trajectory& truth) {
  if (!AllStamped(estimate) || !AllStamped(truth)) return PairByLine(estimate, truth);
  CARMAP_RETURN_IF_ERROR(CheckAscending(estimate, "estimate"));
  CARMAP_RETURN_IF_ERROR(CheckAscending(truth, "truth"));
  return PairByTime(estimate, truth);
}

/// Frame at which a sub-sequence ends, if the path goes on for so long.
std::optional<size_t> FindEnd(const std::vector<MatchedPose>& poses, size_t start,
                              double length_m) {
  const double start_m = poses[start].path_m;
  const auto end = std::upper_bound(
      poses.begin() + static_cast<std::ptrdiff_t>(start), poses.end(), start_m + length_m,
      [](double path_m, const MatchedPose& pose) { return path_m < pose.path_m; });
  if (end == poses.end() || end->path_m > start_m + 2 * length_m) return std::nullopt;
  return static_cast<size_t>(end - poses.begin());
}

/// What is left of the true motion from one frame to another after the estimated one.
Rigid3 MotionError(const MatchedPose& from, const MatchedPose& to) {
  const Rigid3 true_motion = from.truth_from_camera.Inverse() * to.truth_from_camera;
  const Rigid3 estimated_motion = from.estimate_from_camera.Inverse() * to.estimate_from_camera;
  return estimated_motion.Inverse() * true_motion;
}

RelativeErrorOfLength ErrorOfLength(const std::vector<MatchedPose>& poses, double length_m,
                                    size_t start_step) {
  RelativeErrorOfLength error;
  error.length_m = length_m;
  for (size_t start = 0; start < poses.size(); start += start_step) {
    const std::optional<size_t> end = FindEnd(poses, start, length_m);
    if (!end) continue;
    const Rigid3 motion = MotionError(poses[start], poses[*end]);
    error.t_rel_percent += 100 * motion.translation.norm() / length_m;
    error.r_rel_deg_per_100m += 100 * kDegPerRadian * RotationAngle(motion.rotation) / length_m;
    ++error.subsequences;
  }
  if (error.subsequences == 0) return error;
  error.t_rel_percent /= static_cast<double>(error.subsequences);
  error.r_rel_deg_per_100m /= static_cast<double>(error.subsequences);
  return error;
}

nlohmann::ordered_json ToJson(const Summary& summary) {
  return {{"median", summary.median},
          {"mean", summary.mean},
          {"p95", summary.p95},
          {"max", summary.max}};
}

void AddRelative(const std::optional<RelativeErrors>& errors, const std::string& lengths,
                 nlohmann::ordered_json& json) {
  if (!errors) return;
  json[fmt::format("t_rel{}_percent", lengths)] = errors->t_rel_percent;
  json[fmt::format("r_rel{}_deg_per_100m", lengths)] = errors->r_rel_deg_per_100m;
}

void AppendRow(const std::string& name, const RelativeError& error, std::string& text) {
  fmt::format_to(std::back_inserter(text), "  {:>10}  {:>8.3f}  {:>14.4f}  {:>13}\n", name,
                 error.t_rel_percent, error.r_rel_deg_per_100m, error.subsequences);
}

void AppendRows(const std::optional<RelativeErrors>& errors, const std::string& name,
                std::string& text) {
  if (!errors) return;
  for (const RelativeErrorOfLength& error : errors->by_length) {
    AppendRow(fmt::format("{:g} m", error.length_m), error, text);
  }
  AppendRow(name, *errors, text);
}

}  // namespace

absl::StatusOr<MatchedTrajectory> MatchTrajectories(const Trajectory& estimate,
                                                    const Trajectory& truth) {
  CARMAP_ASSIGN_OR_RETURN(const LinePairs pairs, PairLines(estimate, truth));
  MatchedTrajectory matched;
  std::optional<Eigen::Vector3d> last_position;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (!truth[i].world_from_camera) continue;
    const Rigid3& true_pose = *truth[i].world_from_camera;
    if (last_position) matched.path_length_m += (true_pose.translation - *last_position).norm();
    last_position = true_pose.translation;
    if (pairs[i] && estimate[*pairs[i]].world_from_camera) {
      matched.poses.push_back(
          {*estimate[*pairs[i]].world_from_camera, true_pose, matched.path_length_m});
    } else {
      ++matched.lost_frames;
    }
  }
  if (matched.poses.empty()) {
    return absl::InvalidArgumentError(
        "no frame has both an estimated and a true pose; compare trajectories of the same drive "
        "whose time stamps count from the same moment");
  }
  return matched;
}

std::optional<AbsoluteError> AbsoluteTrajectoryError(const MatchedTrajectory& matched) {
  std::vector<Eigen::Vector3d> estimated, true_positions;
  for (const MatchedPose& pose : matched.poses) {
    estimated.push_back(pose.estimate_from_camera.translation);
    true_positions.push_back(pose.truth_from_camera.translation);
  }
  const std::optional<Rigid3> truth_from_estimate = AlignRigidly(estimated, true_positions);
  if (!truth_from_estimate) return std::nullopt;

  std::vector<double> errors_m;
  double sum_of_squares = 0;
  for (size_t i = 0; i < estimated.size(); ++i) {
    errors_m.push_back((*truth_from_estimate * estimated[i] - true_positions[i]).norm());
    sum_of_squares += errors_m.back() * errors_m.back();
  }
  return AbsoluteError{std::sqrt(sum_of_squares / static_cast<double>(errors_m.size())),
                       Summarize(std::move(errors_m))};
}

SubsequenceChoice ShortSubsequences() {
  return {.lengths_m = {5, 10, 15, 20, 25, 30, 35, 40, 45, 50}, .start_step = 1};
}

SubsequenceChoice LongSubsequences() {
  return {.lengths_m = {100, 200, 300, 400, 500, 600, 700, 800}, .start_step = 10};
}

std::optional<RelativeErrors> RelativeTrajectoryError(const MatchedTrajectory& matched,
                                                      const SubsequenceChoice& choice) {
  RelativeErrors errors;
  for (const double length_m : choice.lengths_m) {
    const RelativeErrorOfLength error = ErrorOfLength(matched.poses, length_m, choice.start_step);
    if (error.subsequences == 0) continue;
    const auto count = static_cast<double>(error.subsequences);
    errors.t_rel_percent += count * error.t_rel_percent;
    errors.r_rel_deg_per_100m += count * error.r_rel_deg_per_100m;
    errors.subsequences += error.subsequences;
    errors.by_length.push_back(error);
  }
  if (errors.subsequences == 0) return std::nullopt;
  errors.t_rel_percent /= static_cast<double>(errors.subsequences);
  errors.r_rel_deg_per_100m /= static_cast<double>(errors.subsequences);
  return errors;
}

absl::StatusOr<TrajectoryEvaluation> EvaluateTrajectory(const Trajectory& estimate,
                                                        const Trajectory& truth) {
  CARMAP_ASSIGN_OR_RETURN(const MatchedTrajectory matched, MatchTrajectories(estimate, truth));
  return TrajectoryEvaluation{
      .matched_frames = matched.poses.size(),
      .lost_frames = matched.lost_frames,
      .path_length_m = matched.path_length_m,
      .ate = AbsoluteTrajectoryError(matched),
      .relative_short = RelativeTrajectoryError(matched, ShortSubsequences()),
      .relative_long = RelativeTrajectoryError(matched, LongSubsequences())};
}

nlohmann::ordered_json ToJson(const TrajectoryEvaluation& evaluation) {
  nlohmann::ordered_json json;
  json["matched_frames"] = evaluation.matched_frames;
  json["lost_frames"] = evaluation.lost_frames;
  json["path_length_m"] = evaluation.path_length_m;
  if (evaluation.ate) {
    json["ate_rmse_m"] = evaluation.ate->rmse_m;
    json["ate_m"] = ToJson(evaluation.ate->position_m);
  }
  AddRelative(evaluation.relative(), "", json);
  AddRelative(evaluation.relative_short, "_5_50", json);
  AddRelative(evaluation.relative_long, "_100_800", json);
  json["relative_by_length"] = nlohmann::ordered_json::array();
  for (const auto* errors : {&evaluation.relative_short, &evaluation.relative_long}) {
    if (!*errors) continue;
    for (const RelativeErrorOfLength& error : (*errors)->by_length) {
      json["relative_by_length"].push_back({{"length_m", error.length_m},
                                            {"t_rel_percent", error.t_rel_percent},
                                            {"r_rel_deg_per_100m", error.r_rel_deg_per_100m},
                                            {"subsequences", error.subsequences}});
    }
  }
  return json;
}

std::string ToText(const TrajectoryEvaluation& evaluation) {
  std::string text = fmt::format(
      "frames compared     {}\nframes lost         {}\npath length  "
      "       {:.1f} m\n",
      evaluation.matched_frames, evaluation.lost_frames, evaluation.path_length_m);
  if (evaluation.ate) {
    const Summary& position_m = evaluation.ate->position_m;
    fmt::format_to(std::back_inserter(text),
                   "absolute error      {:.3f} m RMSE (median {:.3f}, mean {:.3f}, p95 {:.3f}, max "
                   "{:.3f})\n",
                   evaluation.ate->rmse_m, position_m.median, position_m.mean, position_m.p95,
                   position_m.max);
  }
  if (!evaluation.relative()) return text + "relative error      none: the path is too short\n";
  text += "relative error (KITTI)\n";
  fmt::format_to(std::back_inserter(text), "  {:>10}  {:>8}  {:>14}  {:>13}\n", "length", "t_rel %",
                 "r_rel deg/100m", "sub-sequences");
  AppendRows(evaluation.relative_short, "5-50 m", text);
  AppendRows(evaluation.relative_long, "100-800 m", text);
  return text;
}

}  // namespace carmap
