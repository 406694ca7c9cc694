#include "carmap/eval/map_truth.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "carmap/eval/localization_error.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

const Rigid3 kMapFromWorld{RotationExp({0.2, -1.1, 0.3}), {100, -5, 40}};

/// A wide bend, a frame every metre and 0.1 s.
Rigid3 TruePose(double frame, double lane_m = 0) {
  const double angle = 0.005 * frame, radius_m = 200 - lane_m;
  return {RotationExp({0, angle, 0}),
          {200 - radius_m * std::cos(angle), 0, radius_m * std::sin(angle)}};
}

Trajectory TruthOf(int frames) {
  Trajectory truth;
  for (int i = 0; i < frames; ++i) {
    truth.push_back({Timestamp::FromSeconds(0.1 * i), TruePose(i)});
  }
  return truth;
}

/// Where a mapper that finds each metre one percent too long, and drifts, has the keyframe.
Rigid3 DriftedPose(int frame) {
  Rigid3 pose = TruePose(frame);
  pose.translation *= 1.01;
  pose.translation.y() += 0.02 * frame;
  pose.rotation = pose.rotation * RotationExp({0, 0, 2e-4 * frame});
  return kMapFromWorld * pose;
}

LeanMap DriftedMap(int frames) {
  LeanMap map;
  map.drives = {{{7}, {}}};
  for (int i = 0; i < frames; i += 2) {
    LeanKeyframe keyframe;
    keyframe.id = {{7}, static_cast<uint32_t>(i)};
    keyframe.timestamp = Timestamp::FromSeconds(0.1 * i + 0.015);
    keyframe.map_from_camera = DriftedPose(i);
    map.keyframes.push_back(keyframe);
  }
  return map;
}

TEST(MapTruth, HasNoErrorOfAMapThatIsMovedRigidly) {
  LeanMap map = DriftedMap(40);
  for (LeanKeyframe& keyframe : map.keyframes) {
    keyframe.map_from_camera = kMapFromWorld * TruePose(keyframe.id.index);
  }
  const auto truth = MapTruth::Create(map, TruthOf(40));
  ASSERT_TRUE(truth.ok()) << truth.status();
  for (const double frame : {-3.0, 0.0, 11.5, 30.0, 45.0}) {
    const PoseError error =
        ErrorOf(truth->InMap(TruePose(frame, 4)), kMapFromWorld * TruePose(frame, 4));
    EXPECT_LT(error.position_m, 1e-9) << frame;
    EXPECT_LT(error.rotation_deg, 1e-5) << frame;
  }
}

TEST(MapTruth, TellsTheMapsDriftFromTheLocalizersError) {
  const LeanMap map = DriftedMap(200);
  const Trajectory truth = TruthOf(200);
  const auto map_truth = MapTruth::Create(map, truth);
  const auto alignment = AlignMapToTruth(map, truth);
  ASSERT_TRUE(map_truth.ok() && alignment.ok());
  for (const int frame : {10, 51, 150, 190}) {
    // A localizer without a fault is where the map has the keyframes.
    const Rigid3 localized = DriftedPose(frame);
    const PoseError against_map = ErrorOf(localized, map_truth->InMap(TruePose(frame)));
    EXPECT_LT(against_map.position_m, 0.03) << frame;  // drift bends within five keyframes
    EXPECT_LT(against_map.rotation_deg, 0.02) << frame;
    // One that is off by 0.3 m is off by that.
    const Rigid3 off = localized * Rigid3{Eigen::Quaterniond::Identity(), {0.3, 0, 0}};
    EXPECT_NEAR(ErrorOf(off, map_truth->InMap(TruePose(frame))).position_m, 0.3, 0.02) << frame;
  }
  const Rigid3 at_the_end = alignment->world_from_map * DriftedPose(198);
  EXPECT_GT(ErrorOf(at_the_end, TruePose(198)).position_m, 0.3) << "the map's own error";
}

TEST(MapTruth, AveragesTheKeyframesNoise) {
  LeanMap map = DriftedMap(100);
  std::mt19937 generator(3);
  std::normal_distribution<double> angle(0, 0.002);
  for (LeanKeyframe& keyframe : map.keyframes) {
    keyframe.map_from_camera = kMapFromWorld * TruePose(keyframe.id.index);
    keyframe.map_from_camera.rotation =
        keyframe.map_from_camera.rotation *
        RotationExp({angle(generator), angle(generator), angle(generator)});
  }
  const auto truth = MapTruth::Create(map, TruthOf(100));
  ASSERT_TRUE(truth.ok());
  double sum_of_squares_deg = 0;
  for (int frame = 10; frame < 90; ++frame) {
    const PoseError error = ErrorOf(truth->InMap(TruePose(frame)), kMapFromWorld * TruePose(frame));
    sum_of_squares_deg += error.rotation_deg * error.rotation_deg / 80;
  }
  const double one_keyframe_deg = 0.002 * std::sqrt(3) * 180 / M_PI;
  EXPECT_LT(std::sqrt(sum_of_squares_deg), 0.6 * one_keyframe_deg);
  EXPECT_GT(std::sqrt(sum_of_squares_deg), 0.3 * one_keyframe_deg);
}

TEST(MapTruth, KnowsWhoseKeyframesTheTruthIsOf) {
  // Another drive on the same clock, 40 m aside.
  LeanMap map = DriftedMap(40);
  map.drives.push_back({{9}, {}});
  for (LeanKeyframe keyframe : DriftedMap(40).keyframes) {
    keyframe.id.drive = {9};
    keyframe.map_from_camera.translation.y() += 40;
    map.keyframes.push_back(keyframe);
  }
  const LeanMap part = KeyframesOf(map, {{7}});
  EXPECT_EQ(part.drives.size(), 1u);
  EXPECT_EQ(part.keyframes.size(), 20u);
  EXPECT_DOUBLE_EQ(AlignMapToTruth(part, TruthOf(40))->rmse_m,
                   AlignMapToTruth(DriftedMap(40), TruthOf(40))->rmse_m);
  EXPECT_EQ(KeyframesOf(map, {{7}, {9}}).keyframes.size(), 40u);
  EXPECT_TRUE(KeyframesOf(map, {{8}}).keyframes.empty());
}

TEST(MapTruth, RefusesTruthOfAnotherDrive) {
  Trajectory truth = TruthOf(20);
  for (TimedPose& pose : truth) pose.timestamp->ns += 36'000'000;
  EXPECT_THAT(std::string(MapTruth::Create(DriftedMap(20), truth).status().message()),
              HasSubstr("10 keyframes 0 have"));
  EXPECT_FALSE(MapTruth::Create({}, TruthOf(20)).ok());
}

TEST(NormalizedError, IsChiSquareWhereTheCovarianceIsRight) {
  Vector6 sigmas;
  sigmas << 0.01, 0.02, 0.05, 1e-3, 2e-3, 5e-4;
  Matrix6 mix = Matrix6::Identity();
  mix(0, 4) = 3;  // a turn about y looks like a step to the side
  mix(2, 1) = 0.5;
  const Matrix6 root = mix * sigmas.asDiagonal().toDenseMatrix();
  const Matrix6 covariance = root * root.transpose();
  const Rigid3 truth = kMapFromWorld * TruePose(20);
  std::mt19937 generator(5);
  std::normal_distribution<double> normal;
  constexpr int kDraws = 4000;
  double mean_position = 0, mean_pose = 0;
  int within = 0;
  for (int i = 0; i < kDraws; ++i) {
    Vector6 draw;
    for (double& value : draw) value = normal(generator);
    const Rigid3 estimated = Perturb(truth, -root * draw);
    const NormalizedError error = NormalizedErrorOf(estimated, covariance, truth);
    mean_position += error.position / kDraws;
    mean_pose += error.pose / kDraws;
    within += error.position <= kChiSquare95Of3;
  }
  EXPECT_NEAR(mean_position, 3, 0.15);
  EXPECT_NEAR(mean_pose, 6, 0.25);
  EXPECT_NEAR(within / static_cast<double>(kDraws), 0.95, 0.015);
}

TEST(NormalizedError, IsInfiniteWithoutACovariance) {
  const NormalizedError error = NormalizedErrorOf({}, Matrix6::Zero(), TruePose(1));
  EXPECT_TRUE(std::isinf(error.position));
  EXPECT_TRUE(std::isinf(error.pose));
}

}  // namespace
}  // namespace carmap
