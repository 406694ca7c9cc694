#include "carmap/slam/keyframe_culling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <utility>

#include "carmap/map/map_edit.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr DriveId kDrive{7};
constexpr uint32_t kLandmarks = 20;

KeyframeId Frame(uint32_t index) { return {kDrive, index}; }

struct View {
  double z_m = 0, x_m = 0;
  uint8_t level = 2;
  uint32_t landmarks = kLandmarks;  ///< of which it sees the first so many
};

/// Keyframe i is view i of the same landmarks.
Map MakeMap(const std::vector<View>& views) {
  MapEdit edit;
  std::vector<Landmark> landmarks(kLandmarks);
  for (uint32_t i = 0; i < views.size(); ++i) {
    Keyframe keyframe{.id = Frame(i)};
    keyframe.map_from_camera.translation = {views[i].x_m, 0, views[i].z_m};
    keyframe.features =
        std::make_shared<const std::vector<Feature>>(kLandmarks, Feature{.level = views[i].level});
    edit.added_keyframes.push_back(keyframe);
    for (uint32_t j = 0; j < views[i].landmarks; ++j) {
      landmarks[j].id = {kDrive, j};
      landmarks[j].observations.push_back({Frame(i), static_cast<int32_t>(j)});
    }
  }
  edit.added_landmarks = std::move(landmarks);
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

std::vector<KeyframeId> Redundant(const std::vector<View>& views,
                                  const std::vector<KeyframeId>& candidates) {
  return RedundantKeyframes(MakeMap(views), candidates, {});
}

TEST(RedundantKeyframes, AreThoseWhoseLandmarksOthersSee) {
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {6}}, {Frame(1)}), ElementsAre(Frame(1)));
  EXPECT_THAT(Redundant({{0}, {2}, {4}}, {Frame(1)}), IsEmpty()) << "two others are too few";
}

TEST(RedundantKeyframes, OthersMustSeeNineOfTenLandmarks) {
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {.z_m = 6, .landmarks = 18}}, {Frame(1)}),
              ElementsAre(Frame(1)));
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {.z_m = 6, .landmarks = 17}}, {Frame(1)}), IsEmpty());
}

TEST(RedundantKeyframes, OthersMustSeeThemAsFine) {
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {.z_m = 6, .level = 3}}, {Frame(1)}), IsEmpty());
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {.z_m = 6, .level = 1}}, {Frame(1)}),
              ElementsAre(Frame(1)));
}

TEST(RedundantKeyframes, LeaveNoGap) {
  EXPECT_THAT(Redundant({{0}, {2.6}, {5.2}, {7.8}}, {Frame(1)}), IsEmpty());
  EXPECT_THAT(Redundant({{0}, {2}, {4}, {6}}, {Frame(0), Frame(3)}), IsEmpty()) << "the ends stay";
  EXPECT_THAT(Redundant({{0}, {.z_m = 2, .x_m = 3.5}, {4}, {6}}, {Frame(1)}), IsEmpty())
      << "the only one in its lane";
}

TEST(RedundantKeyframes, CountOnNoneThatGoesToo) {
  EXPECT_THAT(Redundant({{0}, {1}, {2}, {3}}, {Frame(1), Frame(2)}), ElementsAre(Frame(1)));
  EXPECT_THAT(Redundant({{0}, {1}, {2}, {3}, {4}}, {Frame(1), Frame(2), Frame(3)}),
              ElementsAre(Frame(1), Frame(2)));
}

}  // namespace
}  // namespace carmap
