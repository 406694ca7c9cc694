#include "carmap/eval/stitching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "carmap/eval/localization_error.h"
#include "carmap/eval/stitching_picture.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::Gt;
using ::testing::Lt;

constexpr StreetNoise kNoise{0.3, 4};

/// Drives along one street, with their truth.
class StitchingTest : public ::testing::Test {
 protected:
  struct Drive {
    LeanMap map;
    Trajectory truth;
  };

  Drive Map(uint64_t id, double from_m, double to_m, double lane_m = 0) const {
    const std::vector<Rigid3> poses = DriveAlong(lane_m, from_m, to_m);
    const Rigid3 map_from_world{RotationExp({0, 0.2 * static_cast<double>(id), 0}), {5, 1, -3}};
    Drive drive{MapStreet(street_, {id, 1}, kStreetRig, poses, map_from_world, kNoise), {}};
    for (size_t i = 0; i < poses.size(); ++i) {
      drive.truth.push_back({drive.map.keyframes[i].timestamp, poses[i]});
    }
    return drive;
  }

  /// With all features of each keyframe.
  FullMap Full(const Drive& drive) const {
    FullMap full{drive.map.drives.front(), {}, {}};
    for (size_t i = 0; i < drive.map.keyframes.size(); ++i) {
      const LeanKeyframe& keyframe = drive.map.keyframes[i];
      FullKeyframe& added = full.keyframes.emplace_back(
          FullKeyframe{keyframe.id.index, keyframe.timestamp, keyframe.map_from_camera, {}});
      for (const Feature& feature :
           SeeStreet(street_, kStreetRig, *drive.truth[i].world_from_camera)) {
        added.features.push_back({feature, FullFeature::kNoLandmark});
      }
    }
    return full;
  }

  StitchingScore Score(const PlacedSegment& placed, const Drive& segment, const Drive& base) const {
    return ScoreStitching(placed.keyframes, segment.truth, base.map,
                          MapTruth::Create(base.map, base.truth).value(),
                          AlignMapToTruth(base.map, base.truth)->world_from_map)
        .value();
  }

  const Street street_ = MakeStreet(4, 220);
};

TEST_F(StitchingTest, AllWaysPutASegmentWhereItIs) {
  const Drive base = Map(1, 0, 80), segment = Map(2, 60, 150, 0.4);
  const auto by_position = StitchSegment(base.map, segment.map, {});
  StitchOptions appearance;
  appearance.fit.locator.by_appearance = true;
  const auto by_appearance = StitchSegment(base.map, segment.map, appearance);
  const auto progressive = RelocalizeProgressively(base.map, segment.map, {});
  const auto quicksketch = StitchTrace(Full(base), Full(segment));
  for (const auto* placed : {&by_position, &by_appearance, &progressive, &quicksketch}) {
    ASSERT_TRUE(placed->ok()) << placed->status();
    const StitchingScore score = Score(**placed, segment, base);
    EXPECT_EQ(score.keyframes, segment.map.keyframes.size());
    EXPECT_THAT(score.error_m.mean, Lt(0.15));
    EXPECT_THAT(score.farthest_m, Gt(60));
    EXPECT_THAT((*placed)->ms, Gt(0));
  }
}

TEST_F(StitchingTest, NoWayStitchesAnotherStreet) {
  const Drive base = Map(1, 0, 80);
  const Street other = MakeStreet(9, 220);
  Drive segment = base;
  segment.map = MapStreet(other, {2, 1}, kStreetRig, DriveAlong(0, 0, 80), Rigid3(), kNoise);
  FullMap trace = Full(base);
  for (FullKeyframe& keyframe : trace.keyframes) {
    StreetRandom random(keyframe.index);
    for (FullFeature& full : keyframe.features) full.feature.descriptor = random.RandomDescriptor();
  }
  EXPECT_FALSE(StitchSegment(base.map, segment.map, {}).ok());
  EXPECT_FALSE(RelocalizeProgressively(base.map, segment.map, {}).ok());
  EXPECT_FALSE(StitchTrace(Full(base), trace).ok());
}

TEST_F(StitchingTest, CountsWhatIsOffByMoreThanItMayBe) {
  const Drive base = Map(1, 0, 80), segment = Map(2, 60, 200);
  const Rigid3 base_from_segment = Rigid3{RotationExp({0, 0.2, 0}), {5, 1, -3}} *
                                   Rigid3{RotationExp({0, 0.4, 0}), {5, 1, -3}}.Inverse();
  const auto score_of = [&](double off_m) {
    LeanMap placed = Moved(segment.map, base_from_segment);
    for (LeanKeyframe& keyframe : placed.keyframes)
      keyframe.map_from_camera.translation.y() += off_m;
    return Score({placed, 1}, segment, base);
  };
  EXPECT_THAT(score_of(0).error_m.max, Lt(1e-6));
  EXPECT_EQ(score_of(0.09).within_bounds, segment.map.keyframes.size());
  EXPECT_EQ(score_of(0.25).within_bounds, 0u);
  // 120 m from the base are 70 m beyond what is near: 0.17 m are allowed there.
  const StitchingScore between = score_of(0.13);
  EXPECT_THAT(between.within_bounds, Gt(0u));
  EXPECT_THAT(between.within_bounds, Lt(segment.map.keyframes.size() / 2));
  EXPECT_NEAR(between.error_m.mean, 0.13, 1e-6);
}

TEST(StitchingPicture, DrawsCurvesOfAllWaysAndSegments) {
  const std::vector<StitchingCurve> curves = {
      {"carmap", {StitchingCurve::Point{0.05, 20}, StitchingCurve::Point{0.06, 30}}},
      {"quicksketch", {std::nullopt, StitchingCurve::Point{0.7, 900}}}};
  const cv::Mat picture = RenderStitching("stitching", {"one", "two"}, curves);
  EXPECT_EQ(picture.type(), CV_8UC3);
  const cv::Mat without = RenderStitching("stitching", {"one", "two"}, {curves[0]});
  EXPECT_GT(cv::norm(picture, without), 0);
  EXPECT_FALSE(RenderStitching("nothing stitched", {"one"}, {{"carmap", {std::nullopt}}}).empty());
}

}  // namespace
}  // namespace carmap
