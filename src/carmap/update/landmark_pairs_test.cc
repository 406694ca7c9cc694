#include "carmap/update/landmark_pairs.h"

#include <gtest/gtest.h>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

TEST(MostFrequent, PairsWhatMostKeyframesMatch) {
  const std::vector<LandmarkPair> matches = {{0, 5}, {1, 5}, {0, 5}, {1, 6},
                                             {2, 6}, {2, 6}, {3, 7}};
  EXPECT_EQ(MostFrequent(matches, 4, 8), (std::vector<LandmarkPair>{{0, 5}, {2, 6}, {3, 7}}));
  EXPECT_TRUE(MostFrequent({}, 4, 8).empty());
}

TEST(MostFrequent, TakesTheFirstOfEquallyFrequentOnes) {
  EXPECT_EQ(MostFrequent({{1, 1}, {1, 0}, {0, 1}}, 2, 2),
            (std::vector<LandmarkPair>{{0, 1}, {1, 0}}));
}

TEST(LandmarkCovariance, GrowsAlongTheLineOfSight) {
  LeanMap lean;
  lean.drives = {{{1}, kStreetRig}};
  lean.keyframes.resize(1);
  lean.keyframes[0].id = {{1}, 0};
  for (uint32_t i = 0; i < 2; ++i) {
    LeanLandmark landmark;
    landmark.id = {{1}, i};
    landmark.position_in_map = {0, 0, i == 0 ? 10.0 : 40.0};
    landmark.keyframe_idxs = {0};
    lean.landmarks.push_back(landmark);
  }
  const ReconstructedMap map = Reconstruct(lean);
  const MeasurementNoise noise{.pixel_px = 1, .disparity_px = 0.7};
  const Eigen::Matrix3d near = LandmarkCovariance(map, 0, noise);
  const Eigen::Matrix3d far = LandmarkCovariance(map, 1, noise);
  const double depth_sigma_m = 40 * 40 / (718 * 0.54) * noise.disparity_px;
  EXPECT_NEAR(std::sqrt(far(2, 2)), depth_sigma_m, 0.01 * depth_sigma_m);
  EXPECT_NEAR(std::sqrt(far(0, 0)), std::hypot(40.0 / 718 * noise.pixel_px, 0.02), 0.005);
  EXPECT_NEAR(std::sqrt(far(2, 2) / near(2, 2)), 16, 0.5);
}

// Views of one drive err together, drives on their own.
TEST(LandmarkCovariance, ShrinksWithDrivesNotWithViews) {
  const auto variance_of = [](int drives, uint32_t views_of_drive) {
    LeanMap lean;
    LeanLandmark landmark;
    landmark.id = {{1}, 0};
    landmark.position_in_map = {0, 0, 20};
    for (int d = 1; d <= drives; ++d) {
      const DriveId id{static_cast<uint64_t>(d)};
      lean.drives.push_back({id, kStreetRig});
      for (uint32_t i = 0; i < views_of_drive; ++i) {
        landmark.keyframe_idxs.push_back(static_cast<uint32_t>(lean.keyframes.size()));
        lean.keyframes.emplace_back().id = {id, i};
      }
    }
    lean.landmarks.push_back(landmark);
    return LandmarkCovariance(Reconstruct(lean), 0, MeasurementNoise())(2, 2);
  };
  EXPECT_NEAR(variance_of(1, 12), variance_of(1, 3), 1e-9);
  EXPECT_NEAR(variance_of(4, 3), variance_of(1, 3) / 4, 1e-4);
}

}  // namespace
}  // namespace carmap
