#include "carmap/solve/georeference.h"

#include <gtest/gtest.h>

#include <cmath>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

/// The cameras of a drive along a bent road, and its enu_from_map: y of the camera points down.
struct Drive {
  explicit Drive(TestRandom& random, int length_m, double turn_rad_per_m) {
    Rigid3 map_from_camera;
    const Eigen::Quaterniond enu_from_first = RotationExp({0, 0, random.Uniform(-3, 3)}) *
                                              RotationExp({-1.5707963267948966, 0, 0}) *
                                              RotationExp(random.Normal3(0.01));
    enu_from_map = {enu_from_first, random.Normal3(500)};
    for (int i = 0; i < length_m; ++i) {
      fixes.push_back({map_from_camera, enu_from_map * map_from_camera.translation});
      map_from_camera = map_from_camera * Rigid3{RotationExp({0, turn_rad_per_m, 0}), {0, 0, 1}};
    }
  }
  double WorstError(const Rigid3& found) const {
    double worst = 0;
    for (const CameraFix& fix : fixes) {
      const Eigen::Vector3d p = fix.map_from_camera.translation;
      worst = std::max(worst, (found * p - enu_from_map * p).norm());
    }
    return worst;
  }
  std::vector<CameraFix> fixes;
  Rigid3 enu_from_map;
};

TEST(AlignToFixesTest, FindsTheTransformWithoutNoise) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    const Drive drive(random, 300, 0.01);
    const auto found = AlignToFixes(drive.fixes);
    ASSERT_TRUE(found);
    // The cars' mean up is not quite the Earth's, which counts a little.
    EXPECT_LT(drive.WorstError(*found), 0.15) << seed;
    EXPECT_LT(RotationBetween(*found, drive.enu_from_map), 0.003) << seed;
  }
}

TEST(AlignToFixesTest, BearsNoiseAndAThirdOfWrongFixes) {
  for (uint64_t seed = 1; seed <= 10; ++seed) {
    TestRandom random(seed);
    Drive drive(random, 600, 0.004);
    for (size_t i = 0; i < drive.fixes.size(); ++i) {
      CameraFix& fix = drive.fixes[i];
      fix.p_in_enu += random.Normal3(1);
      if (i % 60 < 20) fix.p_in_enu += Eigen::Vector3d(50, -20, 30);
    }
    const auto found = AlignToFixes(drive.fixes);
    ASSERT_TRUE(found);
    EXPECT_LT(drive.WorstError(*found), 1.5) << seed;
  }
}

TEST(AlignToFixesTest, OnAStraightRoadTheCarsTellUp) {
  TestRandom random(3);
  Drive drive(random, 300, 0);
  for (CameraFix& fix : drive.fixes) fix.p_in_enu += random.Normal3(1);
  const auto found = AlignToFixes(drive.fixes);
  ASSERT_TRUE(found);
  EXPECT_LT(RotationBetween(*found, drive.enu_from_map), 0.04);
}

TEST(AlignToFixesTest, NothingFromFixesOfOnePlace) {
  TestRandom random(3);
  EXPECT_FALSE(AlignToFixes({}));
  EXPECT_FALSE(AlignToFixes(Drive(random, 1, 0).fixes));
  EXPECT_FALSE(AlignToFixes(Drive(random, 20, 0).fixes));
  const std::vector<CameraFix> standing(100, Drive(random, 1, 0).fixes[0]);
  EXPECT_FALSE(AlignToFixes(standing));
}

TEST(AlignToFixesTest, SameBitsTwice) {
  TestRandom random(3);
  Drive drive(random, 300, 0.01);
  for (CameraFix& fix : drive.fixes) fix.p_in_enu += random.Normal3(1);
  EXPECT_TRUE(SameBits(*AlignToFixes(drive.fixes), *AlignToFixes(drive.fixes)));
}

}  // namespace
}  // namespace carmap
