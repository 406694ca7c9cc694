#include "carmap/eval/trajectory_metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <string>

namespace carmap {
namespace {

using testing::HasSubstr;

constexpr double kRadianPerDeg = std::numbers::pi / 180;

/// Forward along z in steps, turning by some angle a metre; camera times at 10 Hz.
Trajectory MakePath(size_t frames, double step_m, double yaw_rad_per_m = 0) {
  Trajectory path;
  Rigid3 pose;
  const Rigid3 step{RotationExp({0, yaw_rad_per_m * step_m, 0}), {0, 0, step_m}};
  for (size_t i = 0; i < frames; ++i) {
    path.push_back({Timestamp{static_cast<int64_t>(i) * 100'000'000}, pose});
    pose = pose * step;
  }
  return path;
}

Trajectory Moved(const Rigid3& b_from_a, Trajectory path) {
  for (TimedPose& pose : path) pose.world_from_camera = b_from_a * *pose.world_from_camera;
  return path;
}

Trajectory Scaled(double scale, Trajectory path) {
  for (TimedPose& pose : path) pose.world_from_camera->translation *= scale;
  return path;
}

Trajectory WithoutStamps(Trajectory path) {
  for (TimedPose& pose : path) pose.timestamp.reset();
  return path;
}

const Rigid3 kSomeMotion{RotationExp({0.4, -1.1, 0.7}), {100, -20, 3}};

TrajectoryEvaluation Evaluate(const Trajectory& estimate, const Trajectory& truth) {
  const auto evaluation = EvaluateTrajectory(estimate, truth);
  EXPECT_TRUE(evaluation.ok()) << evaluation.status();
  return evaluation.value_or(TrajectoryEvaluation{});
}

std::string ErrorOf(const Trajectory& estimate, const Trajectory& truth) {
  return std::string(EvaluateTrajectory(estimate, truth).status().message());
}

TEST(TrajectoryMetricsTest, NoErrorForARigidlyMovedCopy) {
  const Trajectory truth = MakePath(400, 0.7, 0.01);
  const TrajectoryEvaluation evaluation = Evaluate(Moved(kSomeMotion, truth), truth);
  EXPECT_EQ(evaluation.matched_frames, 400u);
  EXPECT_EQ(evaluation.lost_frames, 0u);
  EXPECT_NEAR(evaluation.path_length_m, 399 * 0.7, 1e-9);
  EXPECT_LT(evaluation.ate->rmse_m, 1e-6);
  EXPECT_LT(evaluation.relative_short->t_rel_percent, 1e-6);
  EXPECT_LT(evaluation.relative_long->t_rel_percent, 1e-6);
  EXPECT_LT(evaluation.relative_long->r_rel_deg_per_100m, 1e-5);
}

TEST(TrajectoryMetricsTest, ScaleErrorOfOnePercent) {
  const double step_m = 0.01;  // so that sub-sequences are hardly longer than their length
  const Trajectory truth = MakePath(12001, step_m);
  const TrajectoryEvaluation evaluation = Evaluate(Scaled(1.01, truth), truth);
  EXPECT_NEAR(evaluation.relative_short->t_rel_percent, 1, 0.002);
  EXPECT_NEAR(evaluation.relative_long->t_rel_percent, 1, 0.0002);
  EXPECT_LT(evaluation.relative_long->r_rel_deg_per_100m, 1e-9);
  // Aligned in the middle, the ends are 0.6 m off: errors spread evenly over ±0.6 m.
  EXPECT_NEAR(evaluation.ate->rmse_m, 0.6 / std::sqrt(3), 1e-3);
  EXPECT_NEAR(evaluation.ate->position_m.max, 0.6, 1e-3);
}

TEST(TrajectoryMetricsTest, EndsAtTheFirstFrameBeyondAndDividesByTheNominalLength) {
  const Trajectory truth = MakePath(61, 1);
  const TrajectoryEvaluation evaluation = Evaluate(Scaled(1.01, truth), truth);
  const RelativeErrorOfLength& error = evaluation.relative_short->by_length[0];
  EXPECT_EQ(error.length_m, 5);
  EXPECT_EQ(error.subsequences, 55u);  // starts 0..54, ends 6..60
  EXPECT_NEAR(error.t_rel_percent, 1.0 * 6 / 5, 1e-9);
}

TEST(TrajectoryMetricsTest, YawDrift) {
  const double drift_deg_per_100m = 2;
  const Trajectory truth = MakePath(1001, 0.2),
                   estimate = MakePath(1001, 0.2, drift_deg_per_100m / 100 * kRadianPerDeg);
  const TrajectoryEvaluation evaluation = Evaluate(estimate, truth);
  EXPECT_NEAR(evaluation.relative_long->r_rel_deg_per_100m, drift_deg_per_100m, 0.005);
  EXPECT_NEAR(evaluation.relative_short->r_rel_deg_per_100m, drift_deg_per_100m, 0.03);
  // Off by half the final angle, sideways, seen from the end.
  EXPECT_NEAR(evaluation.relative_long->t_rel_percent, 100 * kRadianPerDeg, 0.01);
}

TEST(TrajectoryMetricsTest, AbsoluteErrorIgnoresARigidMotion) {
  const Trajectory truth = MakePath(100, 1, 0.02);
  Trajectory estimate = truth;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.1);
  for (TimedPose& pose : estimate) {
    pose.world_from_camera->translation +=
        Eigen::Vector3d(noise(random), noise(random), noise(random));
  }
  const double rmse_m = Evaluate(estimate, truth).ate->rmse_m;
  EXPECT_NEAR(rmse_m, 0.1 * std::sqrt(3), 0.02);
  EXPECT_NEAR(Evaluate(Moved(kSomeMotion, estimate), truth).ate->rmse_m, rmse_m, 1e-9);
  EXPECT_NEAR(Evaluate(estimate, Moved(kSomeMotion, truth)).ate->rmse_m, rmse_m, 1e-9);
}

TEST(TrajectoryMetricsTest, ChoosesLengthsByThePath) {
  const auto evaluate = [](size_t frames) {
    const Trajectory truth = MakePath(frames, 1);
    return Evaluate(Scaled(1.02, truth), truth);
  };
  const TrajectoryEvaluation tiny = evaluate(5), short_path = evaluate(61), medium = evaluate(151),
                             long_path = evaluate(901);
  EXPECT_FALSE(tiny.relative());
  EXPECT_FALSE(short_path.relative_long);
  EXPECT_EQ(short_path.relative()->by_length.size(), 10u);
  EXPECT_TRUE(medium.relative_short && medium.relative_long);
  EXPECT_EQ(medium.relative()->by_length.front().length_m, 100);
  EXPECT_EQ(medium.relative()->subsequences, 5u);  // starts 0, 10 … 40 end by 141
  EXPECT_EQ(long_path.relative()->by_length.size(), 8u);
}

TEST(TrajectoryMetricsTest, LostFramesAreLeftOutAndCounted) {
  const Trajectory truth = MakePath(300, 1, 0.01);
  Trajectory estimate = Moved(kSomeMotion, truth);
  for (size_t i = 100; i < 130; ++i) estimate[i].world_from_camera.reset();
  const TrajectoryEvaluation by_time = Evaluate(estimate, truth);
  EXPECT_EQ(by_time.matched_frames, 270u);
  EXPECT_EQ(by_time.lost_frames, 30u);
  EXPECT_NEAR(by_time.path_length_m, 299, 1e-9);
  EXPECT_LT(by_time.ate->rmse_m, 1e-6);
  const TrajectoryEvaluation by_line = Evaluate(WithoutStamps(estimate), WithoutStamps(truth));
  EXPECT_EQ(by_line.lost_frames, 30u);
  EXPECT_EQ(by_line.relative_short->subsequences, by_time.relative_short->subsequences);
  // As TUM files have it: lost frames are not there at all.
  estimate.erase(estimate.begin() + 100, estimate.begin() + 130);
  EXPECT_EQ(Evaluate(estimate, truth).lost_frames, 30u);
  // 5 m from frame 99 end beyond the gap, at 130: not a sub-sequence of 5 m.
  Trajectory jumped = estimate;
  for (size_t i = 100; i < jumped.size(); ++i) {
    jumped[i].world_from_camera->translation += Eigen::Vector3d(50, 0, 0);
  }
  EXPECT_LT(Evaluate(jumped, truth).relative_short->by_length[0].t_rel_percent, 1e-6);
}

TEST(TrajectoryMetricsTest, MatchesByNearestTime) {
  const Trajectory truth = MakePath(100, 1);
  Trajectory estimate = truth;
  for (TimedPose& pose : estimate) pose.timestamp->ns += 15'000'000;
  EXPECT_EQ(Evaluate(estimate, truth).matched_frames, 100u);
  for (TimedPose& pose : estimate) pose.timestamp->ns += 15'000'000;
  EXPECT_THAT(ErrorOf(estimate, truth), HasSubstr("time stamps"));
  // Truth at ten times the rate: every pose of the estimate finds its own.
  const Trajectory dense = [] {
    Trajectory path = MakePath(1000, 0.1);
    for (TimedPose& pose : path) pose.timestamp->ns /= 10;
    return path;
  }();
  const TrajectoryEvaluation evaluation = Evaluate(Moved(kSomeMotion, truth), dense);
  EXPECT_EQ(evaluation.matched_frames, 100u);
  EXPECT_LT(evaluation.ate->rmse_m, 1e-6);
}

TEST(TrajectoryMetricsTest, MatchesByLineOnlyEqualCounts) {
  const Trajectory truth = MakePath(100, 1);
  Trajectory estimate = MakePath(99, 1);
  EXPECT_EQ(Evaluate(estimate, truth).lost_frames, 1u);
  EXPECT_THAT(ErrorOf(WithoutStamps(estimate), WithoutStamps(truth)),
              HasSubstr("estimate has 99 poses but the truth has 100; "));
  EXPECT_THAT(ErrorOf(estimate, WithoutStamps(truth)), HasSubstr("99"));
  EXPECT_EQ(Evaluate(truth, WithoutStamps(truth)).matched_frames, 100u);
  std::swap(estimate[3], estimate[4]);
  EXPECT_THAT(ErrorOf(estimate, truth), HasSubstr("times of the estimate do not ascend"));
  EXPECT_THAT(ErrorOf({}, {}), HasSubstr("no frame"));
}

TEST(TrajectoryMetricsTest, FewPosesHaveNoErrors) {
  const Trajectory truth = MakePath(2, 1);
  const TrajectoryEvaluation evaluation = Evaluate(truth, truth);
  EXPECT_FALSE(evaluation.ate);
  EXPECT_FALSE(evaluation.relative());
  EXPECT_FALSE(ToJson(evaluation).contains("ate_rmse_m"));
  EXPECT_THAT(ToText(evaluation), HasSubstr("too short"));
}

TEST(TrajectoryMetricsTest, ReportsJsonAndText) {
  const Trajectory truth = MakePath(151, 1);
  const TrajectoryEvaluation evaluation = Evaluate(Scaled(1.02, truth), truth);
  const nlohmann::ordered_json json = ToJson(evaluation);
  EXPECT_EQ(json["matched_frames"], 151);
  EXPECT_EQ(json["lost_frames"], 0);
  EXPECT_EQ(json["ate_rmse_m"], evaluation.ate->rmse_m);
  EXPECT_EQ(json["ate_m"]["p95"], evaluation.ate->position_m.p95);
  EXPECT_EQ(json["t_rel_percent"], evaluation.relative_long->t_rel_percent);
  EXPECT_EQ(json["t_rel_100_800_percent"], evaluation.relative_long->t_rel_percent);
  EXPECT_EQ(json["t_rel_5_50_percent"], evaluation.relative_short->t_rel_percent);
  EXPECT_TRUE(json.contains("r_rel_deg_per_100m") && json.contains("r_rel_5_50_deg_per_100m"));
  ASSERT_EQ(json["relative_by_length"].size(), 11u);
  EXPECT_EQ(json["relative_by_length"][10]["length_m"], 100);
  EXPECT_THAT(ToText(evaluation), HasSubstr("100-800 m"));
}

}  // namespace
}  // namespace carmap
