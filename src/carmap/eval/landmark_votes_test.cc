#include "carmap/eval/landmark_votes.h"

#include <gtest/gtest.h>

#include <memory>

#include "carmap/map/map_edit.h"

namespace carmap {
namespace {

constexpr auto kS = Mobility::kStatic, kN = Mobility::kNonStatic, kU = Mobility::kUnknown;
constexpr DriveId kDrive{7};

/// Four keyframes of three features; each feature is one landmark in all of them.
Map MakeMap() {
  MapEdit edit;
  for (uint32_t frame = 0; frame < 4; ++frame) {
    Keyframe keyframe{.id = {kDrive, 10 * frame}};
    keyframe.features = std::make_shared<const std::vector<Feature>>(3);
    edit.added_keyframes.push_back(keyframe);
  }
  for (int32_t feature = 0; feature < 3; ++feature) {
    Landmark landmark{.id = {kDrive, static_cast<uint32_t>(feature)}};
    for (uint32_t frame = 0; frame < 4; ++frame) {
      landmark.observations.push_back({{kDrive, 10 * frame}, feature});
    }
    edit.added_landmarks.push_back(landmark);
  }
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

const FrameLabels kTruth = {
    {0, {kS, kN, kN}}, {10, {kS, kN, kN}}, {20, {kS, kN, kS}}, {30, {kS, kS, kS}}};

TEST(VoteOnLandmarks, TheMajorityDecides) {
  const FrameLabels told = {
      {0, {kN, kN, kS}}, {10, {kS, kS, kS}}, {20, {kS, kN, kU}}, {30, {kU, kN, kN}}};
  const MobilityConfusion confusion = VoteOnLandmarks(MakeMap(), kTruth, told, 1, 3);
  EXPECT_EQ(confusion.count(kS, kS), 2u) << "a tie is static";
  EXPECT_EQ(confusion.count(kN, kN), 1u);
  EXPECT_EQ(confusion.count(kN), 1u);
}

TEST(VoteOnLandmarks, OnlyEveryNthKeyframeIsAsked) {
  const FrameLabels told = {
      {0, {kN, kN, kS}}, {10, {kS, kS, kS}}, {20, {kN, kN, kS}}, {30, {kS, kS, kS}}};
  const MobilityConfusion half = VoteOnLandmarks(MakeMap(), kTruth, told, 2, 3);
  EXPECT_EQ(half.count(kS, kN), 1u) << "keyframes 0 and 20 are wrong about the first";
  const MobilityConfusion all = VoteOnLandmarks(MakeMap(), kTruth, told, 1, 3);
  EXPECT_EQ(all.count(kS, kS), 2u) << "two against two";
}

TEST(VoteOnLandmarks, CountsOnlyWhatEnoughKeyframesSaw) {
  EXPECT_EQ(VoteOnLandmarks(MakeMap(), kTruth, kTruth, 1, 5).count(kS), 0u);
}

}  // namespace
}  // namespace carmap
