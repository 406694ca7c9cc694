#include "carmap/localize/frame_tracking.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

/// All corners of a street, as keyframes along it saw them.
MapSnapshot SnapshotOfStreet(const Street& street) {
  MapSnapshot map;
  const std::vector<Rigid3> poses = DriveAlong(0, 0, 60);
  for (const Street::Corner& corner : street.corners) {
    std::vector<Eigen::Vector3d> viewers;
    int level = -1;
    for (const Rigid3& world_from_camera : poses) {
      const Feature feature = SeeCorner(corner, kStreetRig, world_from_camera.Inverse());
      if (!feature.has_disparity()) continue;
      level = feature.level;
      viewers.push_back(world_from_camera.translation);
    }
    if (viewers.empty()) continue;
    SnapshotLandmark& landmark = map.landmarks.emplace_back();
    landmark.position_in_map = corner.p_in_world;
    landmark.descriptor = corner.descriptor;
    DeriveVisibility(viewers, viewers.back(), level, landmark);
  }
  return map;
}

class FrameTrackingTest : public ::testing::Test {
 protected:
  FrameTrackingTest() : street_(MakeStreet(3, 100)), map_(SnapshotOfStreet(street_)) {
    all_.resize(map_.landmarks.size());
    std::iota(all_.begin(), all_.end(), 0u);
  }

  std::optional<TrackedPose> Project(const std::vector<Feature>& features, const Rigid3& predicted,
                                     const TrackingOptions& options = {}) const {
    const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
    return TrackByProjection(map_, all_, grid, kStreetRig, predicted, options);
  }
  std::optional<TrackedPose> Appear(const std::vector<Feature>& features, uint64_t seed = 1) const {
    const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
    return TrackByAppearance(map_, all_, grid, kStreetRig, {}, seed);
  }
  static double Distance(const Rigid3& a, const Rigid3& b) {
    return (a.Inverse().translation - b.Inverse().translation).norm();
  }

  const Street street_;
  const MapSnapshot map_;
  std::vector<uint32_t> all_;
  const Rigid3 world_from_camera_{RotationExp({0, 0.03, 0}), {0.5, 0, 21}};
  const Rigid3 truth_ = world_from_camera_.Inverse();
};

TEST_F(FrameTrackingTest, FindsThePoseFromAPredictionNearBy) {
  const auto features = SeeStreet(street_, kStreetRig, world_from_camera_);
  const Rigid3 predicted = Rigid3{RotationExp({0, 0.005, 0}), {0.05, 0, 0.1}} * truth_;
  const auto pose = Project(features, predicted);
  ASSERT_TRUE(pose);
  EXPECT_LT(Distance(pose->camera_from_map, truth_), 1e-4);
  EXPECT_GT(pose->inliers.size(), features.size() / 2);
  for (const LandmarkMatch& match : pose->inliers) {
    EXPECT_EQ(map_.landmarks[match.landmark_idx].descriptor,
              features[match.feature_idx].descriptor);
  }
}

TEST_F(FrameTrackingTest, IsAccurateWithNoise) {
  const auto features =
      SeeStreet(street_, kStreetRig, world_from_camera_, {.pixel_px = 0.5, .descriptor_bits = 10});
  const Rigid3 predicted = Rigid3{RotationExp({0, 0.005, 0}), {0.05, 0, 0.1}} * truth_;
  const auto pose = Project(features, predicted);
  ASSERT_TRUE(pose);
  EXPECT_LT(Distance(pose->camera_from_map, truth_), 0.05);
}

TEST_F(FrameTrackingTest, FeaturesOfMovingThingsAreNoInliers) {
  auto features = SeeStreet(street_, kStreetRig, world_from_camera_);
  const size_t moved = features.size() / 4;
  for (size_t i = 0; i < moved; ++i) features[i].x_px += 3;
  const auto pose = Project(features, truth_);
  ASSERT_TRUE(pose);
  EXPECT_LT(Distance(pose->camera_from_map, truth_), 1e-3);
  for (const LandmarkMatch& match : pose->inliers) EXPECT_GE(match.feature_idx, moved);
}

TEST_F(FrameTrackingTest, FindsNothingFromTooFarOffOrWithTooFewFeatures) {
  const auto features = SeeStreet(street_, kStreetRig, world_from_camera_);
  const Rigid3 turned = Rigid3{RotationExp({0, 0.3, 0}), {0, 0, 0}} * truth_;
  EXPECT_FALSE(Project(features, turned));
  EXPECT_FALSE(Project({}, truth_));
  const std::vector<Feature> few(features.begin(), features.begin() + 19);
  EXPECT_FALSE(Project(few, truth_));
  EXPECT_TRUE(Project(few, truth_, {.min_inliers = 10}));
}

TEST_F(FrameTrackingTest, FindsThePoseByAppearanceAlone) {
  const auto features =
      SeeStreet(street_, kStreetRig, world_from_camera_, {.pixel_px = 0.3, .descriptor_bits = 6});
  const auto pose = Appear(features);
  ASSERT_TRUE(pose);
  EXPECT_LT(Distance(pose->camera_from_map, truth_), 0.05);
  const auto again = Appear(features);
  EXPECT_EQ(again->camera_from_map.translation, pose->camera_from_map.translation);
}

TEST_F(FrameTrackingTest, FindsNothingInAnotherStreet) {
  const auto features = SeeStreet(MakeStreet(77, 100), kStreetRig, world_from_camera_);
  ASSERT_GT(features.size(), 200u);
  EXPECT_FALSE(Project(features, truth_));
  EXPECT_FALSE(Appear(features));
  EXPECT_FALSE(Appear({}));
}

}  // namespace
}  // namespace carmap
