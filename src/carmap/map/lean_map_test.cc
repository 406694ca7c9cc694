#include "carmap/map/lean_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>

namespace carmap {
namespace {

using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

LeanKeyframe KeyframeAt(DriveId drive, uint32_t index, const Eigen::Vector3d& position) {
  LeanKeyframe keyframe;
  keyframe.id = {drive, index};
  keyframe.map_from_camera.translation = position;
  return keyframe;
}

/// Two drives of two keyframes each, three landmarks.
LeanMap SmallMap() {
  LeanMap map;
  const StereoRig rig{{700, 700, 600, 180, 1200, 370}, 0.54};
  map.drives = {{{3}, rig}, {{8}, rig}};
  map.keyframes = {KeyframeAt({3}, 0, {0, 0, 0}), KeyframeAt({3}, 7, {3, 0, 4}),
                   KeyframeAt({8}, 1, {100, 0, 0}), KeyframeAt({8}, 2, {100, 2, 0})};
  map.keyframes[1].gps = GpsFix{49.01, 8.43, 112};
  const std::vector<LandmarkId> ids = {{{3}, 0}, {{3}, 5}, {{8}, 0}};
  for (const LandmarkId& id : ids) {
    LeanLandmark landmark;
    landmark.id = id;
    landmark.keyframe_idxs = {0, 1, 3};
    landmark.anchor_idx = 3;
    map.landmarks.push_back(landmark);
  }
  return map;
}

TEST(CheckConsistency, AcceptsAnEmptyAndASoundMap) {
  EXPECT_TRUE(CheckConsistency(LeanMap{}).ok());
  EXPECT_TRUE(CheckConsistency(SmallMap()).ok()) << CheckConsistency(SmallMap());
}

TEST(CheckConsistency, NamesTheFirstRecordThatBreaksAnInvariant) {
  struct Case {
    const char* expected;
    std::function<void(LeanMap&)> damage;
  };
  const std::vector<Case> cases = {
      {"drive 1 of the map does not follow", [](LeanMap& m) { m.drives[1].id = m.drives[0].id; }},
      {"drive 0 of the map has a stereo rig", [](LeanMap& m) { m.drives[0].rig.camera.fx = kNan; }},
      {"drive 1 of the map has a stereo rig", [](LeanMap& m) { m.drives[1].rig.baseline_m = 0; }},
      {"drive 0 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[0].rig.disparity_bias.coefficients_px.z() = kNan; }},
      {"drive 1 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[1].rig.disparity_bias.coefficients_px.x() = -101; }},
      {"drive 0 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[0].rig.camera.width = kMaxImageSidePx + 1; }},
      {"drive 1 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[1].rig.camera.height = 300'000; }},
      {"keyframe 2 of the map has a time",
       [](LeanMap& m) { m.keyframes[2].timestamp.ns = Timestamp::kMaxNs + 1; }},
      {"keyframe 0 of the map has a time",
       [](LeanMap& m) { m.keyframes[0].timestamp.ns = std::numeric_limits<int64_t>::min(); }},
      {"keyframe 3 of the map sees 4097 landmarks",
       [](LeanMap& m) {
         m.landmarks.resize(1);
         for (uint32_t i = 1; i <= kMaxLandmarksOfKeyframe; ++i) {
           m.landmarks.push_back(m.landmarks.front());
           m.landmarks.back().id.index = i;
           m.landmarks.back().keyframe_idxs = {3};
           m.landmarks.back().anchor_idx = 3;
         }
       }},
      {"keyframe 1 of the map does not follow", [](LeanMap& m) { m.keyframes[1].id.index = 0; }},
      {"keyframe 3 of the map belongs to a drive",
       [](LeanMap& m) { m.keyframes[3].id.drive = {9}; }},
      {"keyframe 2 of the map has a pose",
       [](LeanMap& m) { m.keyframes[2].map_from_camera.translation.y() = kNan; }},
      {"keyframe 0 of the map has a pose",
       [](LeanMap& m) { m.keyframes[0].map_from_camera.rotation.x() = 0.01; }},
      {"keyframe 1 of the map has a GPS fix",
       [](LeanMap& m) { m.keyframes[1].gps->latitude_deg = 91; }},
      {"landmark 2 of the map does not follow",
       [](LeanMap& m) {
         m.landmarks[2].id = {{3}, 5};
       }},
      {"landmark 0 of the map belongs to a drive",
       [](LeanMap& m) { m.landmarks[0].id.drive = {2}; }},
      {"landmark 1 of the map has a position",
       [](LeanMap& m) { m.landmarks[1].position_in_map.z() = kNan; }},
      {"landmark 1 of the map has pyramid level 8",
       [](LeanMap& m) { m.landmarks[1].anchor_level = kLevelCount; }},
      {"landmark 0 of the map is seen by no keyframe",
       [](LeanMap& m) { m.landmarks[0].keyframe_idxs.clear(); }},
      {"landmark 0 of the map has a keyframe list",
       [](LeanMap& m) {
         m.landmarks[0].keyframe_idxs = {1, 1};
       }},
      {"landmark 2 of the map is seen by a keyframe",
       [](LeanMap& m) { m.landmarks[2].keyframe_idxs = {4}; }},
      {"landmark 1 of the map has an anchor that does not see it",
       [](LeanMap& m) { m.landmarks[1].anchor_idx = 2; }},
      {"landmark 2 of the map was seen by no drive",
       [](LeanMap& m) { m.landmarks[2].drive_count = 0; }},
      {"drive 0 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[0].rig.baseline_m = 9.7e307; }},
      {"drive 1 of the map has a stereo rig",
       [](LeanMap& m) { m.drives[1].rig.camera.fy = 1e-300; }},
      {"drive 1 of the map has a stereo rig", [](LeanMap& m) { m.drives[1].rig.camera.cx = -2e6; }},
      {"drive 1 of the map begins",
       [](LeanMap& m) { m.drives[1].unix_start = Timestamp{Timestamp::kMaxNs + 1}; }},
  };
  for (const Case& c : cases) {
    LeanMap map = SmallMap();
    c.damage(map);
    const absl::Status status = CheckConsistency(map);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << c.expected;
    EXPECT_THAT(std::string(status.message()), HasSubstr(c.expected));
  }
}

TEST(PathLengthM, SumsOverDrivesWithoutTheGapBetweenThem) {
  EXPECT_DOUBLE_EQ(PathLengthM(LeanMap{}), 0);
  EXPECT_DOUBLE_EQ(PathLengthM(SmallMap()), 5 + 2);
}

}  // namespace
}  // namespace carmap
