#include "carmap/localize/appearance_localizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/index/reconstruct.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};
const StreetNoise kNoise{.pixel_px = 0.3, .descriptor_bits = 4};

class AppearanceLocalizerTest : public ::testing::Test {
 protected:
  AppearanceLocalizerTest()
      : street_(MakeStreet(3, 160)),
        map_(Reconstruct(
            MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 110), kMapFromWorld, kNoise))),
        localizer_(map_.snapshot, DefaultVocabulary()) {}

  const Street street_;
  const ReconstructedMap map_;
  const AppearanceLocalizer localizer_;
};

TEST_F(AppearanceLocalizerTest, FindsEachFrameByItself) {
  for (const Rigid3& world_from_camera : DriveAlong(1, 2, 100, 9.7)) {
    const auto features = SeeStreet(street_, kStreetRig, world_from_camera, kNoise, 9);
    const auto pose = localizer_.Localize(features, kStreetRig);
    ASSERT_TRUE(pose) << world_from_camera.translation.z();
    const Rigid3 error = pose->camera_from_map * kMapFromWorld * world_from_camera;
    EXPECT_LT(error.translation.norm(), 0.1);
    EXPECT_LT(RotationAngle(error.rotation), 5e-3);
    for (const auto& [landmark_idx, feature_idx] : pose->inliers) {
      EXPECT_LE(HammingDistance(map_.snapshot.landmarks[landmark_idx].descriptor,
                                features[feature_idx].descriptor),
                16 + 8);
    }
  }
}

TEST_F(AppearanceLocalizerTest, ProposesKeyframesNearBy) {
  const Rigid3 world_from_camera = DriveAlong(0, 50, 50).front();
  const auto candidates =
      localizer_.Candidates(SeeStreet(street_, kStreetRig, world_from_camera, kNoise, 9));
  ASSERT_FALSE(candidates.empty());
  const Rigid3 best =
      kMapFromWorld.Inverse() * map_.snapshot.keyframes[candidates.front()].map_from_camera;
  EXPECT_LT((best.translation - world_from_camera.translation).norm(), 6);
  EXPECT_LE(candidates.size(), AppearanceLocalizerOptions().max_candidates);
}

TEST_F(AppearanceLocalizerTest, FindsNothingElsewhere) {
  const Street other = MakeStreet(4, 160);
  for (const Rigid3& world_from_camera : DriveAlong(0, 2, 100, 20)) {
    EXPECT_FALSE(localizer_.Localize(SeeStreet(other, kStreetRig, world_from_camera), kStreetRig));
  }
  EXPECT_FALSE(localizer_.Localize({}, kStreetRig));
  const MapSnapshot empty;
  EXPECT_FALSE(
      AppearanceLocalizer(empty, DefaultVocabulary())
          .Localize(SeeStreet(street_, kStreetRig, DriveAlong(0, 2, 2).front()), kStreetRig));
}

}  // namespace
}  // namespace carmap
