#include "carmap/slam/loop_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/slam/test_round.h"

namespace carmap {
namespace {

using ::testing::Ge;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kRoundM = 240;

struct Detections {
  std::vector<Loop> loops;
  std::vector<uint32_t> keyframes;  ///< at which they were found
};

Detections DriveAndDetect(RoundDrive& drive, int steps, LoopDetector& detector) {
  Detections result;
  for (int i = 0; i < steps; ++i) {
    const auto id = drive.Step();
    EXPECT_TRUE(id) << "frame " << i;
    if (!id) break;
    const auto loop = detector.Detect(drive.map(), drive.mapper().rig(), *id);
    if (!loop) continue;
    result.loops.push_back(*loop);
    result.keyframes.push_back(id->index);
  }
  return result;
}

TEST(LoopDetector, FindsTheLoopAndWhereTheVehicleIs) {
  const Street street = MakeRoundStreet(3, kRoundM);
  RoundDrive drive(street, {.circumference_m = kRoundM});
  LoopDetector detector({}, nullptr);
  const Detections found = DriveAndDetect(drive, 175, detector);
  ASSERT_FALSE(found.loops.empty());
  // Keyframe 160 is where keyframe 0 was, which saw what is ahead.
  EXPECT_GT(found.keyframes.front(), 140u);
  EXPECT_LT(found.keyframes.front(), 168u);
  const Loop& loop = found.loops.front();
  EXPECT_THAT(loop, SizeIs(Ge(3)));
  EXPECT_GT(drive.ErrorBetween(loop.back().place_id, loop.back().keyframe_id), 0.5)
      << "without drift nothing would be proved";
  for (const LoopMatch& match : loop) {
    const Rigid3 truth =
        drive.Truth(match.keyframe_id.index).Inverse() * drive.Truth(match.place_id.index);
    EXPECT_LT((match.keyframe_from_place.translation - truth.translation).norm(), 0.15);
    EXPECT_LT(RotationAngle(match.keyframe_from_place.rotation * truth.rotation.conjugate()), 0.01);
    EXPECT_GT(match.seen_share, 0.15);
  }
}

TEST(LoopDetector, LooksWhereTheMapSaysItIsTooWhenNoWordsTell) {
  const Street street = MakeRoundStreet(3, kRoundM);
  RoundDrive drive(street, {.circumference_m = kRoundM});
  LoopDetector detector({.max_places_by_words = 0},
                        std::make_shared<const Vocabulary>(DefaultVocabulary()));
  EXPECT_FALSE(DriveAndDetect(drive, 175, detector).loops.empty());
}

/// Makes the newest keyframe see a landmark of each of the first ones, as a wrong match would.
void ShareALandmarkWithEach(KeyframeId newest, RoundDrive& drive) {
  const Map& map = drive.map();
  MapEdit edit{.base_version = map.version()};
  auto first = map.keyframes().begin();
  int32_t feature_idx = 0;
  for (const auto& link : map.LandmarksOf(newest)) {
    if (!link) {
      const auto& of_first = map.LandmarksOf(first->first);
      const auto landmark = std::find_if(of_first.begin(), of_first.end(), [&](const auto& other) {
        return other && map.Find(*other)->observations.back().keyframe_id < newest &&
               std::none_of(edit.added_observations.begin(), edit.added_observations.end(),
                            [&](const auto& added) { return added.landmark_id == *other; });
      });
      if (landmark != of_first.end()) {
        edit.added_observations.push_back({**landmark, {newest, feature_idx}});
      }
      if ((++first)->first.index > 20) break;
    }
    ++feature_idx;
  }
  drive.mapper().Apply("test", edit);
}

TEST(LoopDetector, ALandmarkInCommonBarsNoPlace) {
  const Street street = MakeRoundStreet(3, kRoundM);
  RoundDrive drive(street, {.circumference_m = kRoundM});
  LoopDetector detector({}, nullptr);
  std::optional<Loop> loop;
  for (int i = 0; i < 175 && !loop; ++i) {
    const auto id = drive.Step();
    ASSERT_TRUE(id);
    if (i > 140) ShareALandmarkWithEach(*id, drive);
    loop = detector.Detect(drive.map(), drive.mapper().rig(), *id);
  }
  EXPECT_TRUE(loop);
}

// Far corners tell how the camera is turned, not where it stands.
TEST(LoopDetector, FarLandmarksAloneShowNoPlace) {
  const Street street = MakeRoundStreet(3, 2000);
  RoundDrive drive(street, {.circumference_m = 2000, .focal_error = 0});
  KeyframeId newest;
  for (int i = 0; i < 30; ++i) newest = drive.Step().value();
  const auto match = [&](double min_depth_m) {
    auto features = SeeStreet(street, kStreetRig, drive.Truth(12), {}, /*seed=*/99);
    std::erase_if(features, [&](const Feature& feature) {
      return !(feature.disparity_px > 0) || kStreetRig.DepthAt(feature.disparity_px) < min_depth_m;
    });
    Keyframe keyframe;
    keyframe.id = {RoundDrive::kDrive, 1000};
    keyframe.features = std::make_shared<const std::vector<Feature>>(std::move(features));
    return MatchPlace(drive.map(), kStreetRig, keyframe, {RoundDrive::kDrive, 12}, newest, {});
  };
  EXPECT_TRUE(match(0));
  EXPECT_FALSE(match(40));
}

TEST(LoopDetector, FindsNoneOnAnOpenRoad) {
  const Street street = MakeRoundStreet(3, 600);
  RoundDrive drive(street, {.circumference_m = 600});
  LoopDetector detector({}, nullptr);
  EXPECT_THAT(DriveAndDetect(drive, 200, detector).loops, IsEmpty());
}

// Every 60 m the street looks the same, to the last corner: each place where the vehicle might be
// has a rival, but for drift that is not possible.
TEST(LoopDetector, FindsNoneAmongRepeatedFacades) {
  const Street street = MakeRoundStreet(3, 480, /*period_m=*/60);
  RoundDrive drive(street, {.circumference_m = 480, .focal_error = 0});
  LoopDetector detector({}, nullptr);
  EXPECT_THAT(DriveAndDetect(drive, 300, detector).loops, IsEmpty());
}

TEST(LoopDetector, FindsNoneAmongRepeatedFacadesWhateverDriftIsPossible) {
  const Street street = MakeRoundStreet(3, 480, /*period_m=*/60);
  RoundDrive drive(street, {.circumference_m = 480, .focal_error = 0});
  LoopDetector detector({.max_places_by_position = 20,
                         .max_turn_rad = 10,
                         .drift_allowance_m = 1000,
                         .drift_allowance_rad = 10},
                        nullptr);
  const Detections found = DriveAndDetect(drive, 140, detector);
  // The first repetition has no rival yet; nothing but drift tells that it is not the same place.
  for (const Loop& loop : found.loops) {
    EXPECT_LT(loop.back().keyframe_id.index, 2 * 60 / 1.5 + 5);
  }
}

}  // namespace
}  // namespace carmap
