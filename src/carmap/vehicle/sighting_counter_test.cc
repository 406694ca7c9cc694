#include "carmap/vehicle/sighting_counter.h"

#include <gtest/gtest.h>

#include <memory>
#include <opencv2/core.hpp>

#include "carmap/feature/test_images.h"
#include "carmap/map/lean_map.h"

namespace carmap {
namespace {

const StereoRig kRig{{700, 700, 620, 180, 1240, 360}, 0.5, {}};
constexpr double kWallM = 25;

/// What a camera sees of a wall across the road, so far away.
DenseDisparity WallAt(double depth_m) {
  const cv::Mat left = Texture(kRig.camera.width, kRig.camera.height, 1, 45, 2.5);
  cv::Mat right = left.clone();
  const auto disparity = static_cast<int>(std::lround(kRig.DisparityAt(depth_m)));
  left(cv::Rect(disparity, 0, left.cols - disparity, left.rows))
      .copyTo(right(cv::Rect(0, 0, left.cols - disparity, left.rows)));
  return {left, right, kRig};
}

/// Landmarks on a wall 25 m from the first of some keyframes, which all see them.
ReconstructedMap WallMap() {
  LeanMap map;
  map.drives = {{{1, 1}, kRig}};
  for (uint32_t i = 0; i < 12; ++i) {
    map.keyframes.push_back(
        {{{1, 1}, i}, {}, {Eigen::Quaterniond::Identity(), {0, 0, 1.0 * i}}, {}});
  }
  for (uint32_t i = 0; i < 20; ++i) {
    LeanLandmark& landmark = map.landmarks.emplace_back();
    landmark.id = {{1, 1}, i};
    landmark.position_in_map = {-4 + 0.4 * i, -1, kWallM};
    for (uint32_t k = 0; k < map.keyframes.size(); ++k) landmark.keyframe_idxs.push_back(k);
    landmark.anchor_idx = 11;
  }
  return Reconstruct(map);
}

/// Drives towards the wall; `stands_m` is where something stands, from the first keyframe.
class SightingCounterTest : public ::testing::Test {
 protected:
  std::map<LandmarkId, Sighting> Drive(double stands_m, const std::vector<uint32_t>& recognised) {
    SightingCounter counter({.min_inliers = 2});
    for (int frame = 0; frame < 10; ++frame) {
      VehiclePose pose;
      pose.known_by = KnownBy::kMap;
      const Rigid3 base_from_camera{Eigen::Quaterniond::Identity(), {0, 0, 0.6 * frame}};
      pose.pose = {base_from_camera.Inverse(), 1e-4 * Matrix6d::Identity()};
      for (const uint32_t idx : recognised) pose.inliers.push_back({idx, 0});
      std::optional<DenseDisparity> disparities;
      if (counter.IsDue(pose)) disparities = WallAt(stands_m - 0.6 * frame);
      counter.Take(map_, kRig, pose, disparities ? &*disparities : nullptr);
    }
    EXPECT_TRUE(counter.Release(1000).empty()) << "all is in sight still";
    auto released = counter.Release(0);
    EXPECT_TRUE(counter.Release(0).empty()) << "told of once";
    return released;
  }
  static size_t CountOf(const std::map<LandmarkId, Sighting>& sightings, Sighting outcome) {
    size_t count = 0;
    for (const auto& [id, sighting] : sightings) count += sighting == outcome;
    return count;
  }

  const ReconstructedMap map_ = WallMap();
};

TEST_F(SightingCounterTest, SeenAreThoseThatWereMatchedMissedTheOthers) {
  const auto sightings = Drive(kWallM, {3, 4, 5});
  EXPECT_EQ(CountOf(sightings, Sighting::kSeen), 3u);
  EXPECT_EQ(CountOf(sightings, Sighting::kMissed), 17u);
  EXPECT_EQ(sightings.at({{1, 1}, 4}), Sighting::kSeen);
}

TEST_F(SightingCounterTest, WhatHasALorryBeforeItIsNotMissed) {
  const auto sightings = Drive(kWallM - 8, {3, 4});
  EXPECT_EQ(CountOf(sightings, Sighting::kMissed), 0u);
  EXPECT_EQ(CountOf(sightings, Sighting::kSeenThrough), 0u);
}

TEST_F(SightingCounterTest, WhereTheWallIsGoneItIsSeenThrough) {
  const auto sightings = Drive(kWallM + 15, {3, 4});
  EXPECT_EQ(CountOf(sightings, Sighting::kSeenThrough), 18u);
  EXPECT_EQ(CountOf(sightings, Sighting::kSeen), 2u);
}

TEST_F(SightingCounterTest, WithoutAPoseByTheMapNothingIsExpected) {
  SightingCounter counter;
  VehiclePose pose;
  EXPECT_FALSE(counter.IsDue(pose));
  pose.known_by = KnownBy::kDeadReckoning;
  pose.pose = UncertainPose{};
  EXPECT_FALSE(counter.IsDue(pose));
  counter.Take(map_, kRig, pose, nullptr);
  EXPECT_TRUE(counter.Release(0).empty());
}

}  // namespace
}  // namespace carmap
