#include "carmap/map/strip.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

#include "carmap/map/map_edit.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr DriveId kDrive{7};
const LeanDrive kLeanDrive{kDrive, {{700, 700, 600, 180, 1200, 370}, 0.54}};

/// Keyframe of frame `index`, whose features are on levels 0, 1, 2 … and so on.
Keyframe MakeKeyframe(uint32_t index) {
  std::vector<Feature> features(8);
  for (size_t i = 0; i < features.size(); ++i) features[i].level = static_cast<uint8_t>(i);
  Keyframe keyframe;
  keyframe.id = {kDrive, index};
  keyframe.timestamp.ns = 100 * index;
  keyframe.map_from_camera.translation.z() = index;
  keyframe.gps = GpsFix{49, 8, 100.0 + index};
  keyframe.features = std::make_shared<const std::vector<Feature>>(features);
  return keyframe;
}

/// Seen by these frames, each time as feature `feature_idx`.
Landmark MakeLandmark(uint32_t index, const std::vector<uint32_t>& frames, int feature_idx) {
  Landmark landmark;
  landmark.id = {kDrive, index};
  landmark.position_in_map = {1.0 * index, 2, 3};
  landmark.descriptor.words[0] = index;
  for (const uint32_t frame : frames) {
    landmark.observations.push_back({{kDrive, frame}, feature_idx});
  }
  return landmark;
}

Map MakeMap(const std::vector<Landmark>& landmarks) {
  MapEdit edit;
  for (const uint32_t frame : {2u, 4u, 5u, 9u}) edit.added_keyframes.push_back(MakeKeyframe(frame));
  edit.added_landmarks = landmarks;
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

TEST(Strip, KeepsWhatEnoughKeyframesSaw) {
  const Map map = MakeMap({MakeLandmark(10, {4, 5, 9}, 3), MakeLandmark(11, {2, 4}, 0),
                           MakeLandmark(12, {2, 5, 9}, 6)});
  const StrippedMap stripped = Strip(map, kLeanDrive);
  ASSERT_TRUE(CheckConsistency(stripped.lean).ok()) << CheckConsistency(stripped.lean);
  EXPECT_THAT(stripped.sources, ElementsAre(LandmarkId{kDrive, 12}, LandmarkId{kDrive, 10}));

  const LeanMap& lean = stripped.lean;
  ASSERT_EQ(lean.landmarks.size(), 2u);
  EXPECT_EQ(lean.landmarks[0].id, (LandmarkId{kDrive, 0}));
  EXPECT_THAT(lean.landmarks[0].keyframe_idxs, ElementsAre(0, 2, 3));
  EXPECT_EQ(lean.landmarks[0].anchor_level, 6);
  EXPECT_EQ(lean.landmarks[0].position_in_map, Eigen::Vector3d(12, 2, 3));
  EXPECT_EQ(lean.landmarks[0].descriptor.words[0], 12u);
  EXPECT_THAT(lean.landmarks[1].keyframe_idxs, ElementsAre(1, 2, 3));
  EXPECT_EQ(lean.landmarks[1].anchor_level, 3);
}

TEST(Strip, KeepsAllKeyframesWithTheirPosesTimesAndFixes) {
  const LeanMap lean = Strip(MakeMap({}), kLeanDrive).lean;
  EXPECT_THAT(lean.landmarks, IsEmpty());
  ASSERT_EQ(lean.keyframes.size(), 4u);
  EXPECT_EQ(lean.keyframes[3].id, (KeyframeId{kDrive, 9}));
  EXPECT_EQ(lean.keyframes[3].timestamp.ns, 900);
  EXPECT_EQ(lean.keyframes[3].map_from_camera.translation.z(), 9);
  EXPECT_EQ(lean.keyframes[3].gps->altitude_m, 109);
  EXPECT_EQ(lean.drives.front().rig, kLeanDrive.rig);
}

TEST(Strip, OrdersLandmarksByListThenLevel) {
  const StrippedMap stripped =
      Strip(MakeMap({MakeLandmark(1, {4, 5}, 2), MakeLandmark(2, {2, 4, 5}, 1),
                     MakeLandmark(3, {4, 5}, 0), MakeLandmark(4, {2, 4}, 5)}),
            kLeanDrive, {.min_observations = 1});
  EXPECT_THAT(stripped.sources, ElementsAre(LandmarkId{kDrive, 4}, LandmarkId{kDrive, 2},
                                            LandmarkId{kDrive, 3}, LandmarkId{kDrive, 1}));
}

TEST(Strip, TakesAnEmptyMap) {
  const StrippedMap stripped = Strip(Map(), kLeanDrive);
  EXPECT_TRUE(CheckConsistency(stripped.lean).ok());
  EXPECT_THAT(stripped.lean.keyframes, IsEmpty());
}

TEST(Strip, LeavesOutWhatIsNonStatic) {
  Map map = MakeMap({MakeLandmark(10, {4, 5, 9}, 3), MakeLandmark(12, {2, 5, 9}, 6)});
  std::vector<Mobility> of_feature(8, Mobility::kStatic);
  of_feature[3] = Mobility::kNonStatic;
  const auto labels = std::make_shared<const std::vector<Mobility>>(of_feature);
  EXPECT_EQ(*Apply({.base_version = map.version(),
                    .labelled_keyframes = {{{kDrive, 5}, labels}, {{kDrive, 9}, labels}}},
                   map),
            0u);
  const StrippedMap stripped = Strip(map, kLeanDrive);
  EXPECT_THAT(stripped.sources, ElementsAre(LandmarkId{kDrive, 12}));
  ASSERT_TRUE(CheckConsistency(stripped.lean).ok()) << CheckConsistency(stripped.lean);
}

TEST(StripStretch, HasWhatItsKeyframesSaw) {
  const Map map = MakeMap({MakeLandmark(10, {4, 5, 9}, 3), MakeLandmark(11, {2, 4, 5}, 0),
                           MakeLandmark(12, {2, 9}, 6)});
  const StrippedMap stripped =
      StripStretch(map, kLeanDrive, {kDrive, 4}, {kDrive, 5}, {.min_observations = 3});
  const LeanMap& lean = stripped.lean;
  ASSERT_TRUE(CheckConsistency(lean).ok()) << CheckConsistency(lean);
  ASSERT_EQ(lean.keyframes.size(), 2u);
  EXPECT_EQ(lean.keyframes[0].id.index, 4u);
  EXPECT_THAT(stripped.sources, ElementsAre(LandmarkId{kDrive, 11}, LandmarkId{kDrive, 10}));
  for (const LeanLandmark& landmark : lean.landmarks) {
    EXPECT_THAT(landmark.keyframe_idxs, ElementsAre(0, 1)) << "those outside do not count";
    EXPECT_EQ(landmark.anchor_idx, 1u);
  }
  EXPECT_EQ(lean.landmarks[0].anchor_level, 0);
  EXPECT_EQ(lean.landmarks[1].anchor_level, 3);
}

TEST(StripStretch, OfAllKeyframesIsTheWholeMap) {
  const Map map = MakeMap({MakeLandmark(10, {4, 5, 9}, 3), MakeLandmark(11, {2, 4, 5}, 0)});
  const StrippedMap whole = Strip(map, kLeanDrive);
  const StrippedMap stretch = StripStretch(map, kLeanDrive, {kDrive, 2}, {kDrive, 9});
  EXPECT_EQ(stretch.sources, whole.sources);
  EXPECT_EQ(stretch.lean.keyframes.size(), whole.lean.keyframes.size());
}

}  // namespace
}  // namespace carmap
