#include "carmap/localize/localizer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/localize/motion_model.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kStreetLengthM = 160;
const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};
const StreetNoise kNoise{.pixel_px = 0.5, .descriptor_bits = 12};

double PositionError(const LocalizedFrame& frame, const Rigid3& map_from_camera) {
  return (frame.map_from_camera->translation - map_from_camera.translation).norm();
}

double RotationError(const LocalizedFrame& frame, const Rigid3& map_from_camera) {
  return RotationAngle(frame.map_from_camera->rotation.conjugate() * map_from_camera.rotation);
}

class LocalizerTest : public ::testing::Test {
 protected:
  LocalizerTest()
      : street_(MakeStreet(3, kStreetLengthM)),
        lean_(MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 110), kMapFromWorld)),
        map_(Reconstruct(lean_)) {}

  const Street street_;
  const LeanMap lean_;
  const ReconstructedMap map_;
};

TEST_F(LocalizerTest, FollowsADriveToAMillimetreWithoutNoise) {
  Localizer localizer(map_, kStreetRig);
  int n = 0;
  for (const Rigid3& world_from_camera : DriveAlong(0, 3, 100, 1.1)) {
    const auto frame = localizer.Localize(Timestamp::FromSeconds(0.1 * n),
                                          SeeStreet(street_, kStreetRig, world_from_camera));
    ASSERT_TRUE(frame.map_from_camera) << n;
    EXPECT_LT(PositionError(frame, kMapFromWorld * world_from_camera), 1e-3) << n;
    EXPECT_LT(RotationError(frame, kMapFromWorld * world_from_camera), 1e-4) << n;
    EXPECT_EQ(frame.found_by, n == 0 ? FoundBy::kRelocalization : FoundBy::kTracking) << n;
    ++n;
  }
}

TEST_F(LocalizerTest, FollowsADriveInTheNextLaneWithNoise) {
  const ReconstructedMap map = Reconstruct(
      MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 110), kMapFromWorld, kNoise));
  Localizer localizer(map, kStreetRig);
  int n = 0;
  for (const Rigid3& world_from_camera : DriveAlong(3, 3, 100, 1.1)) {
    const auto frame =
        localizer.Localize(Timestamp::FromSeconds(0.1 * n),
                           SeeStreet(street_, kStreetRig, world_from_camera, kNoise, n + 1));
    ASSERT_TRUE(frame.map_from_camera) << n;
    EXPECT_LT(PositionError(frame, kMapFromWorld * world_from_camera), 0.1) << n;
    EXPECT_LT(RotationError(frame, kMapFromWorld * world_from_camera), 5e-3) << n;
    ++n;
  }
}

TEST_F(LocalizerTest, FindsEachFrameByItself) {
  int n = 0;
  for (const Rigid3& world_from_camera : DriveAlong(1.5, 2, 100, 7.3)) {
    const auto frame =
        Localizer(map_, kStreetRig).Localize({}, SeeStreet(street_, kStreetRig, world_from_camera));
    ASSERT_TRUE(frame.map_from_camera) << n++;
    EXPECT_LT(PositionError(frame, kMapFromWorld * world_from_camera), 1e-3);
    EXPECT_EQ(frame.found_by, FoundBy::kRelocalization);
  }
}

TEST_F(LocalizerTest, FindsItsPlaceAgainAfterBlackFrames) {
  Localizer localizer(map_, kStreetRig);
  const auto poses = DriveAlong(0, 2, 100, 1);
  for (size_t n = 0; n < poses.size(); ++n) {
    const bool is_black = n >= 30 && n < 55;
    const auto features =
        is_black ? std::vector<Feature>() : SeeStreet(street_, kStreetRig, poses[n]);
    const auto frame =
        localizer.Localize(Timestamp::FromSeconds(0.1 * static_cast<double>(n)), features);
    ASSERT_EQ(frame.map_from_camera.has_value(), !is_black) << n;
    if (is_black) {
      EXPECT_EQ(frame.found_by, FoundBy::kNothing);
    } else {
      EXPECT_LT(PositionError(frame, kMapFromWorld * poses[n]), 1e-3) << n;
    }
  }
}

// The second frame is eleven metres on and nothing tells the speed: where distant landmarks alone
// agree is no pose.
TEST_F(LocalizerTest, IsNotMisledByAPredictionFarBehind) {
  const auto poses = DriveAlong(0, 2, 100, 11);
  for (size_t n = 0; n + 1 < poses.size(); ++n) {
    Localizer localizer(map_, kStreetRig);
    localizer.Localize({}, SeeStreet(street_, kStreetRig, poses[n]));
    const auto frame =
        localizer.Localize(Timestamp::FromSeconds(1), SeeStreet(street_, kStreetRig, poses[n + 1]));
    ASSERT_TRUE(frame.map_from_camera);
    EXPECT_LT(PositionError(frame, kMapFromWorld * poses[n + 1]), 1e-3);
  }
}

TEST_F(LocalizerTest, FindsNothingInAnotherStreet) {
  const Street other = MakeStreet(99, kStreetLengthM);
  for (const Rigid3& world_from_camera : DriveAlong(0, 2, 100, 20)) {
    const auto frame =
        Localizer(map_, kStreetRig).Localize({}, SeeStreet(other, kStreetRig, world_from_camera));
    EXPECT_FALSE(frame.map_from_camera);
  }
}

TEST_F(LocalizerTest, LocalizesACameraOfAnotherFocalLength) {
  StereoRig rig = kStreetRig;
  rig.camera.fx *= 1.6;
  rig.camera.fy *= 1.6;
  const ReconstructedMap map = Reconstruct(lean_, rig.camera.fx);
  int found = 0, total = 0;
  for (const Rigid3& world_from_camera : DriveAlong(0, 10, 90, 10)) {
    ++total;
    const auto frame = Localizer(map, rig).Localize({}, SeeStreet(street_, rig, world_from_camera));
    if (!frame.map_from_camera) continue;
    ++found;
    EXPECT_LT(PositionError(frame, kMapFromWorld * world_from_camera), 1e-3);
  }
  EXPECT_EQ(found, total);
}

TEST_F(LocalizerTest, LooksWhereTheGpsFixSays) {
  LeanMap lean = lean_;
  const LocalEnu enu({49, 8.4, 110});
  for (LeanKeyframe& keyframe : lean.keyframes) {
    const Eigen::Vector3d p = kMapFromWorld.Inverse() * keyframe.map_from_camera.translation;
    keyframe.gps = enu.ToGps({p.x(), p.z(), 0});
  }
  const ReconstructedMap map = Reconstruct(lean);
  const auto features = SeeStreet(street_, kStreetRig, DriveAlong(0, 30, 30)[0]);
  EXPECT_THAT(CandidateKeyframes(map, enu.ToGps({0, 30, 0}), 2), ElementsAre(20, 19, 21));
  EXPECT_TRUE(
      Localizer(map, kStreetRig).Localize({}, features, enu.ToGps({20, 50, 0})).map_from_camera);
  EXPECT_FALSE(
      Localizer(map, kStreetRig).Localize({}, features, enu.ToGps({0, 900, 0})).map_from_camera);
  // A map without fixes is searched as a whole.
  EXPECT_TRUE(
      Localizer(map_, kStreetRig).Localize({}, features, enu.ToGps({0, 900, 0})).map_from_camera);
}

TEST_F(LocalizerTest, TakesEmptyMapsAndFramesAndTimesThatGoBack) {
  const auto features = SeeStreet(street_, kStreetRig, DriveAlong(0, 30, 30)[0]);
  const ReconstructedMap nothing = Reconstruct(LeanMap());
  EXPECT_FALSE(Localizer(nothing, kStreetRig).Localize({}, features).map_from_camera);
  LeanMap bare = lean_;
  bare.landmarks.clear();
  const ReconstructedMap bare_map = Reconstruct(bare);
  EXPECT_FALSE(Localizer(bare_map, kStreetRig).Localize({}, features).map_from_camera);

  Localizer localizer(map_, kStreetRig);
  EXPECT_FALSE(localizer.Localize({}, {}).map_from_camera);
  for (const double seconds : {5.0, 5.0, 1.0, 9.0}) {
    EXPECT_TRUE(localizer.Localize(Timestamp::FromSeconds(seconds), features).map_from_camera);
  }
}

TEST(LandmarksAround, TakesKeyframesNearThatLookTheSameWay) {
  const Street street = MakeStreet(3, 160);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 110), Rigid3()));
  const Rigid3 pose{Eigen::Quaterniond::Identity(), {0, 0, 50}};
  const auto near = LandmarksAround(map, pose, {.radius_m = 5, .covisible_neighbours = 0});
  EXPECT_EQ(near, LandmarksSeenBy(map, {31, 32, 33, 34, 35, 36}));
  const Rigid3 back{RotationExp({0, M_PI, 0}), pose.translation};
  EXPECT_THAT(LandmarksAround(map, back), IsEmpty());
  EXPECT_THAT(LandmarksAround(map, {pose.rotation, {0, 0, 500}}), IsEmpty());
}

TEST(Extrapolate, ContinuesAMotion) {
  const Rigid3 motion{RotationExp({0.02, -0.1, 0.01}), {0.1, 0, -1}};
  const Rigid3 twice = Extrapolate(motion, 2);
  EXPECT_NEAR(RotationAngle(twice.rotation.conjugate() * (motion * motion).rotation), 0, 1e-12);
  EXPECT_EQ(twice.translation, Eigen::Vector3d(0.2, 0, -2));
  EXPECT_EQ(Extrapolate(Rigid3(), 7).translation, Eigen::Vector3d::Zero());
}

}  // namespace
}  // namespace carmap
