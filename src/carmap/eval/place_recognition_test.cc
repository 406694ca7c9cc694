#include "carmap/eval/place_recognition.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace carmap {
namespace {

using ::testing::ElementsAre;

constexpr size_t kWords = 1000;

/// Every 2 m along a street of 400 m, `times` times in the same direction; again with `lane_m` to
/// the side. Where it was driven before, the same words are seen; each place shares half of its
/// words with the one before.
std::vector<ViewedPlace> DriveStreet(double times, double lane_m = 0) {
  constexpr int kPlaces = 200;
  std::vector<ViewedPlace> places;
  for (int i = 0; i < static_cast<int>(times * kPlaces); ++i) {
    const int place = i % kPlaces;
    const auto word = static_cast<uint32_t>(place);
    places.push_back({{{word, 0.5f}, {word + 1, 0.5f}},
                      {{1, 0, 0, 0}, {i < kPlaces ? 0 : lane_m, 0, 2.0 * place}}});
  }
  return places;
}

TEST(EvaluatePlaceRecognition, FindsAllWhereWordsTell) {
  const auto result = EvaluatePlaceRecognition(DriveStreet(1.5), kWords);
  EXPECT_EQ(result.keyframes, 300u);
  EXPECT_EQ(result.revisits, 100u);
  EXPECT_THAT(result.found_among, testing::Each(result.revisits));
  EXPECT_EQ(result.found_without_error, result.revisits);
}

TEST(EvaluatePlaceRecognition, ThereIsNothingToFindOnNewRoad) {
  const auto result = EvaluatePlaceRecognition(DriveStreet(0.9), kWords);
  EXPECT_EQ(result.revisits, 0u);
  EXPECT_THAT(result.found_among, testing::Each(0u));
  EXPECT_EQ(EvaluatePlaceRecognition(DriveStreet(1.5, 6), kWords).revisits, 0u) << "too far aside";
  EXPECT_EQ(EvaluatePlaceRecognition({}, kWords).keyframes, 0u);
}

TEST(EvaluatePlaceRecognition, CountsTheRankOfTheRightPlace) {
  // A place of the second round resembles six other places of the first more than its own.
  auto places = DriveStreet(1.2);
  places.back().histogram = {{100, 0.3f}, {104, 0.3f}, {108, 0.3f}, {38, 0.05f}, {39, 0.05f}};
  places.back().world_from_camera = places[38].world_from_camera;
  const auto result = EvaluatePlaceRecognition(places, kWords);
  ASSERT_EQ(result.revisits, 40u);
  EXPECT_THAT(result.found_among, ElementsAre(39, 39, 40, 40));
}

TEST(EvaluatePlaceRecognition, OneWrongPlaceThatLooksRightLimitsWhatIsFoundWithoutError) {
  auto places = DriveStreet(1.5);
  places[150].histogram = places[20].histogram;  // and differs from its predecessor
  EXPECT_EQ(EvaluatePlaceRecognition(places, kWords).found_without_error, 0u);
}

}  // namespace
}  // namespace carmap
