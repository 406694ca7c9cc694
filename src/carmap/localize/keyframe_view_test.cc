#include "carmap/localize/keyframe_view.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};

LeanMap StreetMap() {
  return MapStreet(MakeStreet(1, 60), {5}, kStreetRig, DriveAlong(0, 0, 40), kMapFromWorld);
}

TEST(KeyframeView, FollowsEquationOne) {
  const LeanMap lean = StreetMap();
  const ReconstructedMap map = Reconstruct(lean);
  size_t count = 0;
  for (uint32_t k = 0; k < lean.keyframes.size(); ++k) {
    const Rigid3 camera_from_map = lean.keyframes[k].map_from_camera.Inverse();
    const KeyframeView view = ViewFrom(map, k, 0);
    ASSERT_EQ(view.features.size(), view.landmark_idxs.size());
    for (size_t i = 0; i < view.features.size(); ++i) {
      const LeanLandmark& landmark = lean.landmarks[view.landmark_idxs[i]];
      EXPECT_TRUE(
          std::binary_search(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(), k));
      const Eigen::Vector3d uvd = kStreetRig.Project(camera_from_map * landmark.position_in_map);
      EXPECT_NEAR(view.features[i].x_px, uvd.x(), 1e-3);
      EXPECT_NEAR(view.features[i].y_px, uvd.y(), 1e-3);
      EXPECT_NEAR(view.features[i].disparity_px, uvd.z(), 1e-3);
    }
    count += view.features.size();
  }
  size_t observations = 0;
  for (const LeanLandmark& landmark : lean.landmarks) observations += landmark.keyframe_idxs.size();
  EXPECT_EQ(count, observations);
  EXPECT_GT(count, 2000u);
}

TEST(KeyframeView, IsWhatTheCameraSaw) {
  const Street street = MakeStreet(2, 60);
  const auto world_from_camera = DriveAlong(0, 0, 40);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, world_from_camera, kMapFromWorld));
  const std::vector<Feature> seen = SeeStreet(street, kStreetRig, world_from_camera[10]);
  const KeyframeView view = ViewFrom(map, 10, 0);
  EXPECT_GT(view.features.size(), 100u);
  for (const Feature& feature : view.features) {
    const auto other = std::find_if(seen.begin(), seen.end(), [&](const Feature& candidate) {
      return candidate.descriptor == feature.descriptor;
    });
    ASSERT_NE(other, seen.end());
    EXPECT_NEAR(feature.x_px, other->x_px, 1e-2);
    EXPECT_NEAR(feature.y_px, other->y_px, 1e-2);
    EXPECT_NEAR(feature.disparity_px, other->disparity_px, 1e-2);
    EXPECT_LE(std::abs(feature.level - other->level), 1);
  }
}

TEST(KeyframeView, HasTheBiasOfTheRig) {
  LeanMap lean = StreetMap();
  const ReconstructedMap plain = Reconstruct(lean);
  StereoRig& rig = lean.drives[0].rig;
  rig.disparity_bias.coefficients_px = {0.3, -0.2, 0.5};
  const ReconstructedMap biased = Reconstruct(lean);
  const auto perfect = ViewFrom(plain, 10, 0).features, measured = ViewFrom(biased, 10, 0).features;
  ASSERT_EQ(perfect.size(), measured.size());
  for (size_t i = 0; i < perfect.size(); ++i) {
    const double x = (perfect[i].x_px - rig.camera.cx) / rig.camera.fx;
    EXPECT_NEAR(measured[i].disparity_px, perfect[i].disparity_px + rig.disparity_bias.At(x), 1e-4);
  }
}

// What the keyframes around saw stands there too, though this one did not hold on to it.
TEST(KeyframeView, ShowsWhatTheKeyframesAroundSaw) {
  LeanMap lean = StreetMap();
  for (size_t i = 0; i < lean.landmarks.size(); ++i) {  // each keyframe keeps every third
    auto& seen_by = lean.landmarks[i].keyframe_idxs;
    std::erase_if(seen_by, [&](uint32_t k) { return (i + k) % 3 != 0; });
    if (!seen_by.empty()) lean.landmarks[i].anchor_idx = seen_by.back();
  }
  std::erase_if(lean.landmarks,
                [](const LeanLandmark& landmark) { return landmark.keyframe_idxs.empty(); });
  const ReconstructedMap map = Reconstruct(lean);
  const size_t own = ViewFrom(map, 10, 0).features.size();
  const KeyframeView view = ViewFrom(map, 10, 16);
  EXPECT_GT(view.features.size(), 2 * own);
  for (const Feature& feature : view.features) {
    EXPECT_TRUE(kStreetRig.camera.Contains({feature.x_px, feature.y_px}));
  }
}

TEST(KeyframeView, LeavesOutWhatNoCameraCanSee) {
  LeanMap lean = StreetMap();
  LeanLandmark& landmark = lean.landmarks.front();
  const uint32_t keyframe_idx = landmark.keyframe_idxs.front();
  landmark.position_in_map =
      lean.keyframes[keyframe_idx].map_from_camera * Eigen::Vector3d(0, 0, -5);
  const KeyframeView view = ViewFrom(Reconstruct(lean), keyframe_idx, 16);
  EXPECT_EQ(std::count(view.landmark_idxs.begin(), view.landmark_idxs.end(), 0u), 0);
}

}  // namespace
}  // namespace carmap
