#include "carmap/index/reconstruct.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};

LeanMap StreetMap() {
  return MapStreet(MakeStreet(1, 60), {5}, kStreetRig, DriveAlong(0, 0, 40), kMapFromWorld);
}

TEST(Reconstruct, DerivesVisibilityFromTheViewers) {
  const LeanMap lean = StreetMap();
  const ReconstructedMap map = Reconstruct(lean);
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {
    const SnapshotLandmark& landmark = map.snapshot.landmarks[i];
    const auto distance_from = [&](uint32_t keyframe_idx) {
      const LeanKeyframe& keyframe = lean.keyframes[keyframe_idx];
      return (keyframe.map_from_camera.translation - landmark.position_in_map).norm();
    };
    const LeanLandmark& source = lean.landmarks[i];
    EXPECT_NEAR(PredictLevel(landmark, distance_from(source.anchor_idx)), source.anchor_level,
                1e-4);
    for (const uint32_t keyframe_idx : source.keyframe_idxs) {
      EXPECT_LE(landmark.min_distance_m, distance_from(keyframe_idx) + 1e-4);
      EXPECT_GE(landmark.max_distance_m, distance_from(keyframe_idx) - 1e-4);
    }
    EXPECT_NEAR(landmark.direction_to_viewers.norm(), 1, 1e-5);
  }
}

TEST(Reconstruct, LevelsHoldForTheCameraAskedFor) {
  const LeanMap lean = StreetMap();
  const double twice_px = kStreetRig.camera.fx * kLevelScale * kLevelScale;
  const ReconstructedMap same = Reconstruct(lean), longer = Reconstruct(lean, twice_px);
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {
    EXPECT_NEAR(longer.snapshot.landmarks[i].level_at_1m,
                same.snapshot.landmarks[i].level_at_1m + 2, 1e-4);
  }
  // What a keyframe saw does not depend on who looks at the map.
  const Eigen::Vector3d p_in_camera(1, 0, 20);
  const auto level_in = [&](const ReconstructedMap& map) {
    return FeatureOf(map, map.snapshot.landmarks[3], kStreetRig, p_in_camera).level;
  };
  EXPECT_EQ(level_in(same), level_in(longer));
}

TEST(Reconstruct, BuildsTheIndexesOfLinks) {
  const LeanMap lean = StreetMap();
  const ReconstructedMap map = Reconstruct(lean);
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {
    const auto keyframes = map.keyframes_of_landmark[i];
    EXPECT_EQ(std::vector<uint32_t>(keyframes.begin(), keyframes.end()),
              lean.landmarks[i].keyframe_idxs);
  }
  for (uint32_t k = 0; k < lean.keyframes.size(); ++k) {
    uint32_t previous = UINT32_MAX;
    for (const CovisibleKeyframe& neighbour : map.covisible()[k]) {
      uint32_t shared = 0;
      for (const LeanLandmark& landmark : lean.landmarks) {
        const auto sees = [&](uint32_t keyframe) {
          return std::binary_search(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(),
                                    keyframe);
        };
        shared += sees(k) && sees(neighbour.keyframe_idx);
      }
      EXPECT_EQ(neighbour.shared_landmarks, shared);
      EXPECT_GT(shared, 0u);
      EXPECT_NE(neighbour.keyframe_idx, k);
      EXPECT_LE(shared, previous);
      previous = shared;
    }
  }
  EXPECT_EQ(map.keyframe_centers.size(), lean.keyframes.size());
  EXPECT_EQ(map.landmark_positions().size(), lean.landmarks.size());
}

/// Keyframes at one place that all see the same landmarks: what makes the most of covisibility.
LeanMap CrowdedMap(uint32_t keyframe_count, uint32_t landmark_count) {
  LeanMap lean;
  lean.drives = {{{5}, kStreetRig}};
  for (uint32_t k = 0; k < keyframe_count; ++k) {
    lean.keyframes.emplace_back().id = {{5}, k};
  }
  for (uint32_t i = 0; i < landmark_count; ++i) {
    LeanLandmark& landmark = lean.landmarks.emplace_back();
    landmark.id = {{5}, i};
    landmark.position_in_map = {0, 0, 20};
    landmark.keyframe_idxs.resize(keyframe_count);
    std::iota(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(), 0u);
  }
  return lean;
}

// Were each pair of a list counted, this would take minutes and four gigabytes.
TEST(Reconstruct, CostsNoMoreThanAMultipleOfTheLists) {
  const LeanMap lean = CrowdedMap(20'000, 50);
  ASSERT_TRUE(CheckConsistency(lean).ok());
  const ReconstructedMap map = Reconstruct(lean);
  for (const uint32_t k : {0u, 9'000u, 19'999u}) {
    const auto covisible = map.covisible()[k];
    EXPECT_LE(covisible.size(), kMaxCovisible);
    ASSERT_GE(covisible.size(), kMaxListNeighbours);
    for (const CovisibleKeyframe& other : covisible) {
      EXPECT_LE(std::abs(static_cast<int>(other.keyframe_idx) - static_cast<int>(k)),
                static_cast<int>(kMaxListNeighbours));
      EXPECT_EQ(other.shared_landmarks, 50u);
    }
  }
}

TEST(Reconstruct, TakesAnEmptyMapAndKeyframesWithoutLandmarks) {
  EXPECT_EQ(Reconstruct(LeanMap()).keyframe_centers.size(), 0u);
  LeanMap lean = StreetMap();
  lean.landmarks.clear();
  const ReconstructedMap map = Reconstruct(lean);
  EXPECT_THAT(map.covisible()[3], IsEmpty());
  EXPECT_FALSE(map.gps);
}

TEST(GpsIndex, FindsKeyframesByTheirPlaceOnTheEarth) {
  const LocalEnu enu({49, 8.4, 110});
  std::vector<LeanKeyframe> keyframes(6);
  for (uint32_t i = 0; i < keyframes.size(); ++i) {
    keyframes[i].id = {{1}, i};
    keyframes[i].map_from_camera.translation = {0, 0, 10.0 * i};
  }
  // Fixes at frames 1 and 4 only: 2 and 3 lie between, 0 and 5 have no place.
  keyframes[1].gps = enu.ToGps({10, 0, 0});
  keyframes[4].gps = enu.ToGps({40, 0, 500});
  const auto index = GpsIndex::Build(keyframes);
  ASSERT_TRUE(index);
  EXPECT_THAT(index->unplaced(), ElementsAre(0, 5));
  EXPECT_THAT(index->KeyframesNear(enu.ToGps({21, 0, -50}), 5, 9), ElementsAre(2));
  EXPECT_THAT(index->KeyframesNear(enu.ToGps({21, 0, -50}), 12, 9), ElementsAre(2, 3, 1));
  EXPECT_THAT(index->KeyframesNear(enu.ToGps({21, 0, -50}), 12, 2), ElementsAre(2, 3));
  EXPECT_THAT(index->KeyframesNear(enu.ToGps({21, 3000, 0}), 50, 9), IsEmpty());
}

}  // namespace
}  // namespace carmap
