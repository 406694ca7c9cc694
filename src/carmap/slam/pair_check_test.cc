#include "carmap/slam/pair_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kDegree = std::numbers::pi / 180;
const StereoRig kRig{{700, 700, 620, 180, 1240, 376}, 0.5};

PairGeometry Sound() {
  return {.matches = 500, .agreeing = 480, .before_sigma = 0.02, .near_below = 0.4};
}
PairGeometry Unsynchronised() {
  PairGeometry geometry = Sound();
  geometry.before = 1.7;
  geometry.place_px = geometry.rows_px = 6;
  geometry.turn_px = 2.5;
  return geometry;
}
PairGeometry Turned(double degrees_up, double degrees_about_axis) {
  PairGeometry geometry = Sound();
  geometry.turn_rad = {degrees_up * kDegree, 0, degrees_about_axis * kDegree};
  geometry.turn_px = geometry.rows_px = 700 * geometry.turn_rad.norm();
  return geometry;
}

std::vector<CheckedPair> Pairs(const std::vector<PairGeometry>& geometries) {
  std::vector<CheckedPair> pairs;
  for (const PairGeometry& geometry : geometries) {
    pairs.push_back({static_cast<uint32_t>(10 * pairs.size()), geometry, 1});
  }
  return pairs;
}

TEST(PairCheck, SoundPairs) {
  EXPECT_EQ(FaultOf(Sound()), std::nullopt);
  EXPECT_THAT(JudgePairs(kRig, Pairs({Sound(), Sound()})), IsEmpty());
  EXPECT_THAT(JudgePairs(kRig, {}), IsEmpty());
}

TEST(PairCheck, NamesWhatOnePairShows) {
  PairGeometry geometry = Sound();
  geometry.same_place_share = 0.99;
  EXPECT_EQ(FaultOf(geometry), DriveFault::kOneCamera);
  geometry = Sound();
  geometry.backward_share = 0.97;
  EXPECT_EQ(FaultOf(geometry), DriveFault::kSidesSwapped);
  geometry.near_below = -0.3;
  EXPECT_EQ(FaultOf(geometry), DriveFault::kUpsideDown);
  geometry = Sound();
  geometry.distortion = -0.4;
  geometry.distortion_sigma = 0.03;
  geometry.distortion_px = geometry.rows_px = 1.5;
  geometry.turn_px = 0.3;
  EXPECT_EQ(FaultOf(geometry), DriveFault::kDistorted);
  EXPECT_EQ(FaultOf(Unsynchronised()), DriveFault::kUnsynchronised);
  EXPECT_EQ(FaultOf(Turned(0, 0.5)), DriveFault::kMisaligned);
}

/// A freeway shows little that is near: what one part explains another takes back.
TEST(PairCheck, PartsThatCancelAreNoFault) {
  PairGeometry geometry = Sound();
  geometry.distortion = 0.6;
  geometry.distortion_sigma = 0.05;
  geometry.distortion_px = 1.5;
  geometry.turn_px = 1.4;
  geometry.rows_px = 0.3;
  EXPECT_EQ(FaultOf(geometry), std::nullopt);
}

TEST(PairCheck, OfFewCornersNothingIsSaid) {
  PairGeometry geometry = Unsynchronised();
  geometry.agreeing = kMinAgreeing - 1;
  EXPECT_EQ(FaultOf(geometry), std::nullopt);
  EXPECT_EQ(Summarize(kRig.camera, Pairs({geometry})).telling_pairs, 0u);
}

/// In a slow vehicle the images' places are not told apart from noise.
TEST(PairCheck, AnUncertainPlaceIsNoFault) {
  PairGeometry geometry = Unsynchronised();
  geometry.turn_px = 0.3;
  geometry.before_sigma = 0.5;
  EXPECT_EQ(FaultOf(geometry), std::nullopt);
}

TEST(PairCheck, NamesFromWhichFrameOnPairsAreApart) {
  const auto suspicions =
      JudgePairs(kRig, Pairs({Sound(), Sound(), Sound(), Sound(), Sound(), Sound(),
                              Unsynchronised(), Unsynchronised(), Unsynchronised()}));
  ASSERT_EQ(suspicions.size(), 1u);
  EXPECT_EQ(suspicions[0].fault, DriveFault::kUnsynchronised);
  EXPECT_EQ(suspicions[0].first_index, 60u);
  EXPECT_EQ(suspicions[0].last_index, 80u);
  EXPECT_THAT(suspicions[0].finding, HasSubstr("not of the same moment: the right camera seems "
                                               "0.8 m before the left one"));
  EXPECT_THAT(suspicions[0].remedy, HasSubstr("pair the images by their times"));
}

/// A lorry's ribs, which are taken for each other.
TEST(PairCheck, CamerasThatWereSoundBeforeAreNotTurned) {
  EXPECT_THAT(JudgePairs(kRig, Pairs({Sound(), Sound(), Sound(), Sound(), Turned(0, 0.5),
                                      Turned(0, 0.5), Turned(0, 0.5)})),
              IsEmpty());
}

TEST(PairCheck, OnePairOfManyIsNoFault) {
  EXPECT_THAT(JudgePairs(kRig, Pairs({Sound(), Turned(0, 0.5), Sound(), Turned(0, 0.5), Sound()})),
              IsEmpty());
}

TEST(PairCheck, SumsUpInTheCamerasPixels) {
  const PairHealth health =
      Summarize(kRig.camera, Pairs({Turned(0.1, -0.5), Turned(0.1, -0.5), Turned(0.3, -0.5)}));
  EXPECT_EQ(health.pairs, 3u);
  EXPECT_NEAR(health.row_offset_px, 700 * 0.1 * kDegree, 1e-9);
  EXPECT_NEAR(health.row_slope_px, 1240 * 0.5 * kDegree, 1e-9);
}

TEST(PairCheck, ASmallTurnCanBeUndone) {
  const auto misalignment =
      CorrectableMisalignment(Pairs({Turned(0.3, 0.5), Turned(0.3, 0.5), Sound()}));
  ASSERT_TRUE(misalignment);
  EXPECT_DOUBLE_EQ(misalignment->down, 0.3 * kDegree);
  EXPECT_DOUBLE_EQ(misalignment->turn, 0.5 * kDegree);
  EXPECT_FALSE(CorrectableMisalignment(Pairs({Sound(), Sound(), Turned(0, 0.5)})));
  EXPECT_FALSE(CorrectableMisalignment(Pairs({Turned(0, 1.5)})));
  EXPECT_FALSE(CorrectableMisalignment(Pairs({Unsynchronised()})));
  EXPECT_FALSE(CorrectableMisalignment({}));
}

TEST(PairCheck, CamerasThatLookApartAreNotUndone) {
  PairGeometry apart = Sound();
  apart.backward_share = 0.11;
  EXPECT_EQ(FaultOf(apart), DriveFault::kMisaligned);
  EXPECT_FALSE(CorrectableMisalignment(Pairs({apart})));
  EXPECT_THAT(JudgePairs(kRig, Pairs({apart}))[0].finding, HasSubstr("look apart"));
}

TEST(PairCheck, ABaselineThatNoVehicleHas) {
  for (const double baseline_m : {0.00076, 53.7}) {
    StereoRig rig = kRig;
    rig.baseline_m = baseline_m;
    const auto suspicions = JudgePairs(rig, {});
    ASSERT_EQ(suspicions.size(), 1u);
    EXPECT_EQ(suspicions[0].fault, DriveFault::kImplausibleRig);
    EXPECT_THAT(suspicions[0].remedy, HasSubstr("P1"));
  }
}

}  // namespace
}  // namespace carmap
