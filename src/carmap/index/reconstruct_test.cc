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

TEST(Reconstruct, RestoresKeyframeFeaturesByEquationOne) {
  const LeanMap lean = StreetMap();
  ASSERT_TRUE(CheckConsistency(lean).ok());
  const ReconstructedMap map = Reconstruct(lean);
  ASSERT_EQ(map.features_of_keyframe.size(), lean.keyframes.size());
  size_t count = 0;
  for (uint32_t k = 0; k < lean.keyframes.size(); ++k) {
    const Rigid3 camera_from_map = lean.keyframes[k].map_from_camera.Inverse();
    for (const KeyframeFeature& feature : map.features_of_keyframe[k]) {
      const Eigen::Vector3d p =
          camera_from_map * lean.landmarks[feature.landmark_idx].position_in_map;
      EXPECT_LT((feature.p_in_camera.cast<double>() - p).norm(), 1e-4);
      const Eigen::Vector3d uvd = kStreetRig.Project(p);
      EXPECT_LT((feature.px.cast<double>() - uvd.head<2>()).norm(), 1e-3);
      EXPECT_NEAR(feature.disparity_px, uvd.z(), 1e-3);
      ++count;
    }
  }
  size_t observations = 0;
  for (const LeanLandmark& landmark : lean.landmarks) observations += landmark.keyframe_idxs.size();
  EXPECT_EQ(count, observations);
  EXPECT_GT(count, 2000u);
}

TEST(Reconstruct, KeyframeFeaturesAreWhatTheCameraSaw) {
  const Street street = MakeStreet(2, 60);
  const auto world_from_camera = DriveAlong(0, 0, 40);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, world_from_camera, kMapFromWorld));
  const std::vector<Feature> seen = SeeStreet(street, kStreetRig, world_from_camera[10]);
  size_t same = 0;
  for (const Feature& feature : FeaturesOf(map, 10)) {
    for (const Feature& other : seen) {
      if (feature.descriptor != other.descriptor) continue;
      EXPECT_NEAR(feature.x_px, other.x_px, 1e-2);
      EXPECT_NEAR(feature.y_px, other.y_px, 1e-2);
      EXPECT_NEAR(feature.disparity_px, other.disparity_px, 1e-2);
      EXPECT_LE(std::abs(feature.level - other.level), 1);
      ++same;
    }
  }
  EXPECT_EQ(same, map.features_of_keyframe[10].size());
}

TEST(Reconstruct, KeyframeFeaturesHaveTheBiasOfTheirRig) {
  LeanMap lean = StreetMap();
  const ReconstructedMap plain = Reconstruct(lean);
  StereoRig& rig = lean.drives[0].rig;
  rig.disparity_bias.coefficients_px = {0.3, -0.2, 0.5};
  const ReconstructedMap biased = Reconstruct(lean);
  const auto perfect = FeaturesOf(plain, 10), measured = FeaturesOf(biased, 10);
  ASSERT_EQ(perfect.size(), measured.size());
  for (size_t i = 0; i < perfect.size(); ++i) {
    EXPECT_NEAR(rig.WithoutBias(measured[i].x_px, measured[i].disparity_px),
                perfect[i].disparity_px, 1e-4);
  }
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
    EXPECT_NEAR(PredictLevel(landmark, distance_from(source.keyframe_idxs.front())),
                source.first_level, 1e-4);
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
  const auto a = FeaturesOf(same, 4), b = FeaturesOf(longer, 4);
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) EXPECT_EQ(a[i].level, b[i].level);
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
    for (const CovisibleKeyframe& neighbour : map.covisible[k]) {
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
  EXPECT_EQ(map.landmark_positions.size(), lean.landmarks.size());
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
    const auto covisible = map.covisible[k];
    EXPECT_LE(covisible.size(), kMaxCovisible);
    ASSERT_GE(covisible.size(), kMaxListNeighbours);
    for (const CovisibleKeyframe& other : covisible) {
      EXPECT_LE(std::abs(static_cast<int>(other.keyframe_idx) - static_cast<int>(k)),
                static_cast<int>(kMaxListNeighbours));
      EXPECT_EQ(other.shared_landmarks, 50u);
    }
  }
}

TEST(Reconstruct, LeavesOutFeaturesThatNoCameraCanSee) {
  LeanMap lean = StreetMap();
  LeanLandmark& landmark = lean.landmarks.front();
  const uint32_t keyframe_idx = landmark.keyframe_idxs.front();
  landmark.position_in_map =
      lean.keyframes[keyframe_idx].map_from_camera * Eigen::Vector3d(0, 0, -5);
  const ReconstructedMap map = Reconstruct(lean);
  for (const KeyframeFeature& feature : map.features_of_keyframe[keyframe_idx]) {
    EXPECT_NE(feature.landmark_idx, 0u);
  }
  EXPECT_EQ(map.snapshot.keyframes[keyframe_idx].landmark_idxs.front(), 0u);
}

TEST(Reconstruct, TakesAnEmptyMapAndKeyframesWithoutLandmarks) {
  EXPECT_EQ(Reconstruct(LeanMap()).keyframe_centers.size(), 0u);
  LeanMap lean = StreetMap();
  lean.landmarks.clear();
  const ReconstructedMap map = Reconstruct(lean);
  EXPECT_THAT(map.features_of_keyframe[3], IsEmpty());
  EXPECT_THAT(map.covisible[3], IsEmpty());
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
