#include "carmap/eval/feature_tracks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

namespace carmap {
namespace {

/// Feature i of a frame is feature i of the next for each i of `survivors`, of ten.
void Step(const std::vector<uint32_t>& survivors, FeatureTracks& tracks) {
  std::vector<PredictedFeature> predictions;
  std::vector<TrueMatch> matches;
  for (const uint32_t i : survivors) {
    matches.push_back(
        {.prediction_idx = static_cast<uint32_t>(predictions.size()), .feature_idx = i});
    predictions.push_back({.feature_idx = i});
  }
  tracks.Continue(predictions, matches, 10, 0.5);
}

std::vector<std::pair<size_t, double>> Lengths(FeatureTracks& tracks) {
  std::vector<std::pair<size_t, double>> lengths;
  for (const TrackLength& track : tracks.End()) lengths.emplace_back(track.frames, track.driven_m);
  return lengths;
}

TEST(FeatureTracks, CountsFramesAndMetres) {
  FeatureTracks tracks;
  tracks.Begin(10);
  Step({}, tracks);         // all ten begin in frame 1
  Step({3, 4, 5}, tracks);  // the seven others were seen once
  Step({4, 5}, tracks);     // 3 ends after two frames
  Step({5}, tracks);        // 4 after three
  for (int i = 0; i < 6; ++i) Step({}, tracks);
  EXPECT_THAT(Lengths(tracks), testing::UnorderedElementsAre(std::pair(2, 0.5), std::pair(3, 1.0),
                                                             std::pair(4, 1.5)));
  EXPECT_THAT(Lengths(tracks), testing::IsEmpty());
}

TEST(FeatureTracks, ComeByTheirFirstFrame) {
  FeatureTracks tracks;
  tracks.Begin(10);
  Step({}, tracks);
  Step({1, 2}, tracks);  // 1 and 2 begin in frame 1
  Step({2, 3}, tracks);  // 3 in frame 2, and ends before 2 does
  Step({2}, tracks);
  for (int i = 0; i < 10; ++i) Step({}, tracks);
  std::vector<size_t> first_frames;
  for (const TrackLength& track : tracks.End()) first_frames.push_back(track.first_frame);
  EXPECT_THAT(first_frames, testing::ElementsAre(1, 1, 2));
}

TEST(FeatureTracks, LeavesOutWhatBeganBeforeTheChain) {
  FeatureTracks tracks;
  tracks.Begin(10);
  Step({1}, tracks);
  Step({1}, tracks);
  for (int i = 0; i < 20; ++i) Step({}, tracks);
  EXPECT_THAT(Lengths(tracks), testing::IsEmpty());
}

TEST(FeatureTracks, FollowsEachForTheSameTime) {
  FeatureTracks tracks;
  tracks.Begin(10);
  Step({}, tracks);
  for (int i = 0; i < 11; ++i) Step({1}, tracks);  // 13 frames: starts in 1, 2 and 3 count
  EXPECT_THAT(Lengths(tracks), testing::ElementsAre(std::pair(FeatureTracks::kMaxFrames, 4.5)));

  tracks.Begin(10);
  for (size_t i = 1; i + 1 < FeatureTracks::kMinChainFrames; ++i) Step({}, tracks);
  Step({1}, tracks);  // begins one frame before the end, and would look short
  EXPECT_THAT(Lengths(tracks), testing::IsEmpty());
}

TEST(FeatureTracks, ShortestChainCountsWhatBeginsInItsSecondFrame) {
  FeatureTracks tracks;
  tracks.Begin(10);
  Step({}, tracks);
  for (size_t i = 2; i < FeatureTracks::kMinChainFrames; ++i) Step({7}, tracks);
  EXPECT_THAT(Lengths(tracks), testing::ElementsAre(std::pair(FeatureTracks::kMaxFrames, 4.5)));
}

// With a share p found again from each frame to the next, tracks of n frames are as frequent as
// p^(n-1), however long the chain.
TEST(FeatureTracks, MeanFollowsFromTheShareFoundAgain) {
  FeatureTracks tracks;
  tracks.Begin(10);
  uint64_t state = 1;
  std::map<size_t, size_t> count_of;
  size_t total = 0;
  for (int chain = 0; chain < 500; ++chain) {
    tracks.Begin(10);
    for (int frame = 0; frame < 25; ++frame) {
      std::vector<uint32_t> survivors;
      for (uint32_t i = 0; i < 10; ++i) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        if (state >> 63) survivors.push_back(i);
      }
      Step(survivors, tracks);
    }
    for (const auto& [frames, metres] : Lengths(tracks)) {
      ++count_of[frames];
      ++total;
      EXPECT_DOUBLE_EQ(metres, 0.5 * static_cast<double>(frames - 1));
    }
  }
  for (size_t n = 2; n <= 5; ++n) {
    EXPECT_NEAR(static_cast<double>(count_of[n]) / static_cast<double>(total), std::pow(0.5, n - 1),
                0.01)
        << n;
  }
}

}  // namespace
}  // namespace carmap
