#include "carmap/slam/loop_correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "carmap/slam/test_round.h"

namespace carmap {
namespace {

constexpr double kRoundM = 240;

/// A round and a bit, and the loop that it closes.
class LoopCorrectionTest : public ::testing::Test {
 protected:
  LoopCorrectionTest() : drive_(street_, {.circumference_m = kRoundM}), map_(drive_.map()) {
    // Far more than it takes: the newest keyframe is to have much of the place in view.
    LoopDetector detector({.min_chain_inliers = 600}, nullptr);
    for (int i = 0; i < 175 && !loop_; ++i) {
      newest_ = drive_.Step().value();
      loop_ = detector.Detect(drive_.map(), drive_.mapper().rig(), newest_);
    }
    map_ = drive_.map();
  }
  void SetUp() override { ASSERT_TRUE(loop_); }

  Rigid3 PoseOf(KeyframeId id) const { return map_.Find(id)->map_from_camera; }
  double GapM() const {
    const LoopMatch& match = loop_->back();
    const Rigid3 keyframe_from_place = PoseOf(match.keyframe_id).Inverse() * PoseOf(match.place_id);
    return (keyframe_from_place.translation - match.keyframe_from_place.translation).norm();
  }
  size_t SharedLandmarks(KeyframeId a, KeyframeId b) const {
    size_t shared = 0;
    for (const auto& link : map_.LandmarksOf(a)) {
      if (!link) continue;
      const auto& observations = map_.Find(*link)->observations;
      shared += std::any_of(observations.begin(), observations.end(),
                            [&](const Observation& o) { return o.keyframe_id == b; });
    }
    return shared;
  }

  const Street street_ = MakeRoundStreet(3, kRoundM);
  RoundDrive drive_;
  Map map_;
  KeyframeId newest_;
  std::optional<Loop> loop_;
};

TEST_F(LoopCorrectionTest, PosesCloseTheGapAndLandmarksGoAlong) {
  EXPECT_GT(GapM(), 0.5);
  const Map before = map_;
  EXPECT_EQ(*Apply(CorrectPoses(map_, *loop_, {}, {}), map_), 0u);
  ASSERT_TRUE(CheckConsistency(map_).ok()) << CheckConsistency(map_);
  EXPECT_LT(GapM(), 0.1);
  const KeyframeId first = map_.keyframes().begin()->first;
  EXPECT_LT((PoseOf(first).translation).norm(), 1e-12) << "the map begins where it did";
  // What a keyframe sees stays where it sees it, nearly: its landmarks move with the first viewer.
  for (const auto& [id, landmark] : map_.landmarks()) {
    const KeyframeId viewer = landmark.observations.front().keyframe_id;
    const Eigen::Vector3d now = PoseOf(viewer).Inverse() * landmark.position_in_map;
    const Eigen::Vector3d then =
        before.Find(viewer)->map_from_camera.Inverse() * before.Find(id)->position_in_map;
    ASSERT_LT((now - then).norm(), 1e-9);
  }
  // Spread over the way: no step between keyframes changes by more than its share.
  for (auto k = std::next(map_.keyframes().begin()); k != map_.keyframes().end(); ++k) {
    const KeyframeId previous = std::prev(k)->first;
    const Rigid3 step = PoseOf(previous).Inverse() * k->second.map_from_camera;
    const Rigid3 old_step =
        before.Find(previous)->map_from_camera.Inverse() * before.Find(k->first)->map_from_camera;
    EXPECT_LT((step.translation - old_step.translation).norm(), 0.1);
  }
}

TEST_F(LoopCorrectionTest, WithoutLoopAndFixesNothingMoves) {
  const MapEdit edit = CorrectPoses(map_, {}, {}, {});
  for (const auto& [id, pose] : edit.moved_keyframes) {
    EXPECT_LT((pose.translation - PoseOf(id).translation).norm(), 1e-9);
  }
}

TEST_F(LoopCorrectionTest, LandmarksSeenTwiceBecomeOne) {
  const LoopMatch& match = loop_->back();
  EXPECT_EQ(SharedLandmarks(match.keyframe_id, match.place_id), 0u);
  const MapEdit fused = FuseLoop(map_, drive_.mapper().rig(), *loop_, {});
  ASSERT_TRUE(Apply(CorrectPoses(map_, *loop_, {}, {}), map_).ok());
  const size_t before = map_.landmarks().size();
  ASSERT_TRUE(Apply(fused, map_).ok());
  ASSERT_TRUE(CheckConsistency(map_).ok()) << CheckConsistency(map_);
  const size_t shared = SharedLandmarks(match.keyframe_id, match.place_id);
  EXPECT_GT(shared, 100u);
  EXPECT_GT(shared, static_cast<size_t>(match.inlier_count) * 8 / 10) << match.inlier_count;
  EXPECT_LT(map_.landmarks().size() + 100, before);
  EXPECT_LE(map_.landmarks().size() + shared, before);
}

TEST_F(LoopCorrectionTest, FuseNamesTheSameCorners) {
  ASSERT_TRUE(Apply(FuseLoop(map_, drive_.mapper().rig(), *loop_, {}), map_).ok());
  size_t wrong = 0, all = 0;
  for (const auto& [id, landmark] : map_.landmarks()) {
    const auto descriptor = [&](const Observation& o) {
      return (*map_.Find(o.keyframe_id)->features)[o.feature_idx].descriptor;
    };
    for (const Observation& observation : landmark.observations) {
      ++all;
      wrong += HammingDistance(descriptor(observation), descriptor(landmark.observations[0])) > 30;
    }
  }
  EXPECT_LT(static_cast<double>(wrong), 0.002 * static_cast<double>(all));
}

}  // namespace
}  // namespace carmap
