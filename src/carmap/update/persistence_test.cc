#include "carmap/update/persistence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int64_t kDayS = 86400, kNowS = 20 * kDayS;
constexpr auto kSeen = Sighting::kSeen;
constexpr auto kMissed = Sighting::kMissed;
constexpr auto kThrough = Sighting::kSeenThrough;

/// One a day.
std::vector<PassSighting> Passes(const std::vector<Sighting>& outcomes, double log_odds = 0) {
  std::vector<PassSighting> passes;
  for (const Sighting outcome : outcomes) {
    passes.push_back({static_cast<int64_t>(passes.size()) * kDayS, outcome, log_odds});
  }
  return passes;
}

double Gone(const std::vector<Sighting>& outcomes, double log_odds = 0) {
  const auto passes = Passes(outcomes, log_odds);
  return LogOddsGone(passes, passes.empty() ? 0 : passes.back().time_s, {});
}

TEST(Persistence, StaysWhileItIsSeen) {
  EXPECT_LT(Gone({}), -5);
  EXPECT_LT(Gone({kMissed, kSeen}), -3);
  EXPECT_LT(Gone({kSeen, kMissed}), -3);
  EXPECT_LT(Gone({kThrough, kThrough, kThrough, kSeen}), -1) << "it has gaps";
}

TEST(Persistence, GoesWhenItIsSeenThroughTimeAndAgain) {
  EXPECT_LT(Gone({kSeen, kThrough}), 0);
  EXPECT_GT(Gone({kSeen, kSeen, kThrough, kThrough}), Gone({kSeen, kSeen, kThrough}) + 1);
  EXPECT_GT(Gone({kSeen, kSeen, kSeen, kThrough, kThrough, kThrough, kThrough}), 1.5);
}

TEST(Persistence, OneThatWasNeverRecognisedIsNotGoneForThat) {
  const std::vector<Sighting> missed(20, kMissed);
  EXPECT_LT(Gone(missed), 2);
  std::vector<Sighting> often_seen(6, kSeen);
  often_seen.insert(often_seen.end(), 8, kMissed);
  EXPECT_GT(Gone(often_seen, 1), 2) << "one that was always recognised is";
}

TEST(Persistence, WhereLittleIsRecognisedAMissSaysLittle) {
  const auto gone = [](double log_odds) {
    auto passes = Passes({kSeen, kSeen, kSeen, kMissed, kMissed, kMissed, kMissed});
    for (size_t i = 3; i < passes.size(); ++i) passes[i].log_odds = log_odds;
    return LogOddsGone(passes, kNowS, {});
  };
  EXPECT_LT(gone(-3), gone(1) - 2);
}

TEST(Persistence, ThatNobodyCouldSeeItForAYearDoesNotMakeItGone) {
  auto passes = Passes({kSeen, kSeen, kMissed});
  passes.back().time_s = 400 * kDayS;
  EXPECT_LT(LogOddsGone(passes, passes.back().time_s, {}), 0);
}

WatchedLandmark At(double x, const std::vector<Sighting>& outcomes) {
  return {{x, 0, 0}, Passes(outcomes)};
}

std::vector<uint32_t> IndicesOfVanished(const std::vector<WatchedLandmark>& landmarks) {
  std::vector<uint32_t> idxs;
  for (const Vanishing& gone : FindVanished(landmarks, kNowS)) idxs.push_back(gone.idx);
  return idxs;
}

TEST(Persistence, ABillboardGoesAsAWhole) {
  std::vector<WatchedLandmark> landmarks;
  for (int i = 0; i < 8; ++i)
    landmarks.push_back(At(0.3 * i, {kSeen, kThrough, kThrough, kThrough}));
  landmarks[3] = At(0.9, {kSeen});  // hidden since
  landmarks.push_back(At(10, {kSeen}));
  landmarks.push_back(At(20, {kSeen, kMissed, kMissed, kMissed}));
  EXPECT_THAT(IndicesOfVanished(landmarks), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
}

TEST(Persistence, WhatWentBeforeTakesTheRestAlong) {
  std::vector<WatchedLandmark> landmarks;
  for (int i = 0; i < 8; ++i) {
    landmarks.push_back(At(0.3 * i, {kSeen, kSeen}));
    landmarks.back().vanished_s = 3 * kDayS;
  }
  landmarks[3] = At(0.9, {kSeen, kSeen, kThrough, kThrough});
  landmarks[4] = At(1.2, {kSeen, kSeen, kSeen, kSeen, kSeen});
  EXPECT_THAT(IndicesOfVanished(landmarks), ElementsAre(3));
}

TEST(Persistence, OneDriveAloneTakesNothingAway) {
  std::vector<WatchedLandmark> landmarks;
  for (int i = 0; i < 8; ++i) landmarks.push_back(At(0.3 * i, {kSeen, kSeen, kThrough}));
  EXPECT_THAT(FindVanished(landmarks, kNowS), IsEmpty());
}

TEST(Persistence, AmongSeenNeighboursNothingGoes) {
  std::vector<WatchedLandmark> landmarks;
  for (int i = 0; i < 8; ++i) landmarks.push_back(At(0.3 * i, {kSeen, kSeen, kSeen, kSeen}));
  landmarks[3] = At(0.9, {kSeen, kThrough, kThrough, kThrough});  // a twig
  EXPECT_THAT(FindVanished(landmarks, kNowS), IsEmpty());
}

/// Standing landmarks that are recognised as they will, some of them with gaps.
TEST(Persistence, KeepsAStreetThroughManyPasses) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal(0, 1.5);
  std::vector<WatchedLandmark> landmarks;
  for (int i = 0; i < 4000; ++i) {
    WatchedLandmark landmark{{uniform(random) * 200, uniform(random) * 5, 0}, {}};
    const double recognised = normal(random), gaps = uniform(random) < 0.05 ? 0.4 : 0.02;
    for (int day = 0; day < 20; ++day) {
      if (uniform(random) < 0.3) continue;  // hidden, or out of sight
      const double light = day % 3 - 1.0;
      const bool is_seen = uniform(random) < 1 / (1 + std::exp(-recognised - light));
      const bool is_through = uniform(random) < gaps;
      landmark.passes.push_back({day * kDayS,
                                 is_seen      ? kSeen
                                 : is_through ? kThrough
                                              : kMissed,
                                 light});
    }
    landmarks.push_back(std::move(landmark));
  }
  EXPECT_LT(FindVanished(landmarks, kNowS).size(), 20u) << "half a percent";
}

}  // namespace
}  // namespace carmap
