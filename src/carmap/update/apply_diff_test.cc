#include "carmap/update/apply_diff.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "carmap/map/test_street.h"
#include "carmap/update/fit.h"

namespace carmap {
namespace {

constexpr StreetNoise kNoise{0.3, 4};

/// Corners that all drives see, and as many more that each drive alone does: what stands there for
/// a day.
Street StreetOfDay(uint64_t day) {
  Street street = MakeStreet(3, 110);
  const Street of_day = MakeStreet(100 + day, 110);
  street.corners.insert(street.corners.end(), of_day.corners.begin(), of_day.corners.end());
  return street;
}

LeanMap DriveOfDay(uint64_t day, double lane_m = 0) {
  return MapStreet(StreetOfDay(day), {day + 1}, kStreetRig, DriveAlong(lane_m, 0, 80), Rigid3(),
                   kNoise);
}

LeanMap AfterDays(uint64_t days) {
  LeanMap base = DriveOfDay(0);
  for (uint64_t day = 1; day < days; ++day) {
    const auto fitted = Fit(base, DriveOfDay(day));
    EXPECT_TRUE(fitted.ok()) << fitted.status();
    base = Apply(fitted->diff, base).value();
  }
  return base;
}

TEST(Apply, GrowsWithTheRoadNotWithTheDriving) {
  const LeanMap first = DriveOfDay(0), base = AfterDays(8);
  EXPECT_EQ(base.keyframes.size(), first.keyframes.size());
  EXPECT_LE(static_cast<double>(base.landmarks.size()),
            1.5 * static_cast<double>(first.landmarks.size()));
  // What stays put is known by all drives; of what stood there for a day little is left.
  const auto seen_by_all = std::count_if(base.landmarks.begin(), base.landmarks.end(),
                                         [](const LeanLandmark& l) { return l.drive_count >= 6; });
  EXPECT_GT(static_cast<double>(seen_by_all), 0.4 * static_cast<double>(first.landmarks.size()));
}

TEST(Apply, LearnsAStreetThatChanged) {
  LeanMap base = AfterDays(4);
  const Street rebuilt = [] {
    Street street = MakeStreet(3, 110);
    for (Street::Corner& corner : street.corners) {  // one side is another now
      if (corner.p_in_world.x() > 0) corner.descriptor.words[0] ^= 0xaaaaaaaaaaaaaaaa;
    }
    return street;
  }();
  std::vector<size_t> known;  // of the new side
  for (uint64_t day = 20; day < 24; ++day) {
    const LeanMap drive =
        MapStreet(rebuilt, {day}, kStreetRig, DriveAlong(0, 0, 80), Rigid3(), kNoise);
    const auto fitted = Fit(base, drive);
    ASSERT_TRUE(fitted.ok()) << fitted.status();
    base = Apply(fitted->diff, base).value();
    known.push_back(static_cast<size_t>(std::count_if(
        base.landmarks.begin(), base.landmarks.end(),
        [](const LeanLandmark& l) { return l.id.drive.input >= 20 && l.drive_count >= 2; })));
  }
  EXPECT_GT(known.back(), 100u);
  EXPECT_GT(known.back(), known[1]);
}

TEST(Apply, ChangesNothingWhereNothingIsNew) {
  const LeanMap base = DriveOfDay(0);
  const auto same = Apply({.part = 0, .frame = {}, .drive = base, .seen_again = {}}, base);
  ASSERT_TRUE(same.ok()) << same.status();
  EXPECT_EQ(same->keyframes.size(), base.keyframes.size());
  ASSERT_EQ(same->landmarks.size(), base.landmarks.size());
  for (size_t i = 0; i < base.landmarks.size(); ++i) {
    EXPECT_EQ(same->landmarks[i].position_in_map, base.landmarks[i].position_in_map);
    EXPECT_EQ(same->landmarks[i].keyframe_idxs, base.landmarks[i].keyframe_idxs);
  }
}

// Proposals made against one base come in any order: what several drives saw is the same and ends
// in one place. Of what one saw alone, those that came last have found a place.
TEST(Apply, GivesTheSameLandmarksInAnyOrder) {
  const LeanMap base = DriveOfDay(0);
  std::vector<MapDiff> diffs;
  for (uint64_t day = 1; day < 4; ++day) diffs.push_back(Fit(base, DriveOfDay(day, 0.3))->diff);
  LeanMap forth = base, back = base;
  for (size_t i = 0; i < diffs.size(); ++i) {
    forth = Apply(diffs[i], forth).value();
    back = Apply(diffs[diffs.size() - 1 - i], back).value();
  }
  EXPECT_EQ(forth.keyframes.size(), back.keyframes.size());
  size_t known = 0, same = 0, near = 0;
  for (const LeanLandmark& landmark : forth.landmarks) {
    if (landmark.drive_count < 2) continue;
    ++known;
    const auto other =
        std::lower_bound(back.landmarks.begin(), back.landmarks.end(), landmark.id,
                         [](const LeanLandmark& l, const LandmarkId& id) { return l.id < id; });
    if (other == back.landmarks.end() || other->id != landmark.id) continue;
    ++same;
    const double distance_m = (other->position_in_map - landmark.position_in_map).norm();
    const double depth_m = PositionInAnchor(forth, landmark).norm();
    near += distance_m < 0.02 + 0.3 * depth_m * depth_m / (718 * 0.54);  // 0.3 px of disparity
  }
  EXPECT_GT(known, base.landmarks.size() / 3);
  EXPECT_GT(same, known * 97 / 100);
  EXPECT_GT(near, same * 97 / 100);
}

TEST(Apply, MakesANewLandmarkOfWhatTheBaseLost) {
  LeanMap base = DriveOfDay(0);
  const MapDiff diff = Fit(base, DriveOfDay(1))->diff;
  const LandmarkId lost = diff.seen_again.front().in_base;
  std::erase_if(base.landmarks, [&](const LeanLandmark& l) { return l.id == lost; });
  const LeanMap merged = Apply(diff, base, {.max_growth = 100}).value();
  const LandmarkId again = diff.seen_again.front().in_drive;
  EXPECT_TRUE(std::any_of(merged.landmarks.begin(), merged.landmarks.end(),
                          [&](const LeanLandmark& l) { return l.id == again; }));
}

}  // namespace
}  // namespace carmap
