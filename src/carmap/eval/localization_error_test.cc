#include "carmap/eval/localization_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace carmap {
namespace {

using ::testing::HasSubstr;

const Rigid3 kWorldFromMap{RotationExp({0.2, -1.1, 0.3}), {100, -5, 40}};

/// A bend, a frame every 0.1 s.
Rigid3 PoseOfFrame(int frame) {
  const double angle = 0.05 * frame;
  return {RotationExp({0, angle, 0}),
          {20 * (1 - std::cos(angle)), 0.01 * frame, 20 * std::sin(angle)}};
}

Trajectory TruthOf(int frames) {
  Trajectory truth;
  for (int i = 0; i < frames; ++i) {
    truth.push_back({Timestamp::FromSeconds(0.1 * i), kWorldFromMap * PoseOfFrame(i)});
  }
  return truth;
}

/// Every other frame is a keyframe, stamped a little late.
LeanMap MapOf(int frames) {
  LeanMap map;
  map.drives = {{{7}, {}}};
  for (int i = 0; i < frames; i += 2) {
    LeanKeyframe keyframe;
    keyframe.id = {{7}, static_cast<uint32_t>(i)};
    keyframe.timestamp = Timestamp::FromSeconds(0.1 * i + 0.015);
    keyframe.map_from_camera = PoseOfFrame(i);
    map.keyframes.push_back(keyframe);
  }
  return map;
}

TEST(AlignMapToTruth, FindsTheTransform) {
  const auto alignment = AlignMapToTruth(MapOf(30), TruthOf(20));
  ASSERT_TRUE(alignment.ok()) << alignment.status();
  EXPECT_EQ(alignment->keyframes, 10u) << "those of the frames that have a true pose";
  EXPECT_NEAR(alignment->rmse_m, 0, 1e-9);
  EXPECT_LE((alignment->world_from_map.translation - kWorldFromMap.translation).norm(), 1e-9);
  EXPECT_LE(RotationAngle(alignment->world_from_map.rotation.conjugate() * kWorldFromMap.rotation),
            1e-9);
}

TEST(AlignMapToTruth, IsNotTurnedAboutAStraightRoadByNoise) {
  LeanMap map;
  Trajectory truth;
  for (int i = 0; i < 30; ++i) {
    const Rigid3 pose{{1, 0, 0, 0}, {0.02 * std::cos(i), 0.02 * std::sin(0.7 * i), 2.0 * i}};
    LeanKeyframe keyframe;
    keyframe.id = {{7}, static_cast<uint32_t>(i)};
    keyframe.timestamp = Timestamp::FromSeconds(i);
    keyframe.map_from_camera = pose;
    map.keyframes.push_back(keyframe);
    truth.push_back({keyframe.timestamp, Rigid3{{1, 0, 0, 0}, {0, 0, 2.0 * i}}});
  }
  const auto alignment = AlignMapToTruth(map, truth);
  ASSERT_TRUE(alignment.ok());
  EXPECT_LE(RotationAngle(alignment->world_from_map.rotation), 0.002);
}

TEST(AlignMapToTruth, SaysHowWellTheMapFits) {
  Trajectory truth = TruthOf(20);
  for (size_t i = 0; i < truth.size(); i += 4) truth[i].world_from_camera->translation.y() += 0.2;
  const auto alignment = AlignMapToTruth(MapOf(20), truth);
  ASSERT_TRUE(alignment.ok());
  EXPECT_GT(alignment->rmse_m, 0.05);
  EXPECT_LT(alignment->rmse_m, 0.15);
}

TEST(AlignMapToTruth, RefusesTruthOfAnotherDriveOrTooLittleOfIt) {
  Trajectory truth = TruthOf(20);
  for (TimedPose& pose : truth) pose.timestamp->ns += 36'000'000;  // within 0.05 s of no keyframe
  EXPECT_THAT(std::string(AlignMapToTruth(MapOf(20), truth).status().message()),
              HasSubstr("10 keyframes 0 have"));
  EXPECT_THAT(std::string(AlignMapToTruth(MapOf(20), TruthOf(3)).status().message()),
              HasSubstr("2 have"));
  EXPECT_FALSE(AlignMapToTruth(MapOf(20), {}).ok());
  EXPECT_FALSE(AlignMapToTruth({}, TruthOf(20)).ok());
}

TEST(AlignMapToTruth, LeavesLostPosesOut) {
  Trajectory truth = TruthOf(20);
  truth[4].world_from_camera.reset();
  EXPECT_EQ(AlignMapToTruth(MapOf(20), truth)->keyframes, 9u);
}

TEST(EvaluateLocalization, MeasuresInTheTruthsFrame) {
  const Trajectory truth = TruthOf(5);
  Trajectory localized;
  for (int i = 0; i < 5; ++i) localized.push_back({std::nullopt, PoseOfFrame(i)});
  EXPECT_NEAR(EvaluateLocalization(localized, truth, kWorldFromMap).position_m.max, 0, 1e-9);

  // All poses moved by the same: an alignment by these poses would hide it.
  for (TimedPose& pose : localized) {
    pose.world_from_camera =
        *pose.world_from_camera * Rigid3{RotationExp({0, 0.01, 0}), {0.3, 0, 0.4}};
  }
  localized[2].world_from_camera.reset();
  const LocalizationError error = EvaluateLocalization(localized, truth, kWorldFromMap);
  EXPECT_EQ(error.frames, 4u);
  EXPECT_NEAR(error.position_m.median, 0.5, 1e-9);
  EXPECT_NEAR(error.position_m.max, 0.5, 1e-9);
  EXPECT_NEAR(error.rotation_deg.mean, 0.01 * 180 / M_PI, 1e-6);
}

}  // namespace
}  // namespace carmap
