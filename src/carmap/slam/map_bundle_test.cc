#include "carmap/slam/map_bundle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::SizeIs;

constexpr DriveId kDrive{7};

KeyframeId Frame(uint32_t index) { return {kDrive, index}; }
LandmarkId Point(uint32_t index) { return {kDrive, index}; }

/// Keyframes 0 to 3, 1 m apart. Landmark 0 is seen by 0 and 1, landmark 1 by 1, 2 and 3, landmark 2
/// by 2 alone; each exactly where it is.
Map MakeMap() {
  const std::vector<std::vector<uint32_t>> viewers = {{0, 1}, {1, 2, 3}, {2}};
  const std::vector<Eigen::Vector3d> positions = {{1, 0, 12}, {-2, 1, 15}, {3, -1, 11}};
  MapEdit edit;
  for (uint32_t i = 0; i < 4; ++i) {
    Keyframe keyframe{.id = Frame(i)};
    keyframe.map_from_camera.translation = {0, 0, 1.0 * i};
    std::vector<Feature> features;
    for (const Eigen::Vector3d& p : positions) {
      const Eigen::Vector3d uvd = kStreetRig.Project(p - keyframe.map_from_camera.translation);
      features.push_back({.x_px = static_cast<float>(uvd.x()),
                          .y_px = static_cast<float>(uvd.y()),
                          .disparity_px = static_cast<float>(uvd.z())});
    }
    keyframe.features = std::make_shared<const std::vector<Feature>>(std::move(features));
    edit.added_keyframes.push_back(keyframe);
  }
  for (uint32_t j = 0; j < positions.size(); ++j) {
    Landmark landmark{.id = Point(j), .position_in_map = positions[j]};
    for (const uint32_t i : viewers[j])
      landmark.observations.push_back({Frame(i), static_cast<int32_t>(j)});
    edit.added_landmarks.push_back(landmark);
  }
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

TEST(MapBundle, LandmarksSeenOnceHoldNoPose) {
  const Map map = MakeMap();
  EXPECT_THAT(SharedLandmarks(map, {Frame(2), Frame(3)}), ElementsAre(Point(1)));
  EXPECT_THAT(SharedLandmarks(map, {Frame(0), Frame(1), Frame(2)}),
              ElementsAre(Point(0), Point(1)));
}

TEST(MapBundle, OthersThatSeeTheLandmarksHoldStill) {
  const Map map = MakeMap();
  const MapBundle problem = MakeMapBundle(map, kStreetRig, {}, {Frame(2), Frame(3)}, {Point(1)});
  EXPECT_THAT(problem.keyframe_ids, ElementsAre(Frame(2), Frame(3), Frame(1)));
  EXPECT_THAT(problem.bundle.pose_is_fixed, ElementsAre(false, false, true));
  EXPECT_THAT(problem.links, SizeIs(3));
  EXPECT_EQ(problem.map_version, map.version());
}

TEST(MapBundle, OneKeyframeAlwaysHoldsStill) {
  const Map map = MakeMap();
  const auto fixed = [&](const std::vector<KeyframeId>& free,
                         const std::vector<LandmarkId>& points) {
    return MakeMapBundle(map, kStreetRig, {}, free, points).bundle.pose_is_fixed;
  };
  EXPECT_THAT(fixed({Frame(0), Frame(1)}, {Point(0)}), ElementsAre(true, false))
      << "where the map begins";
  EXPECT_THAT(fixed({Frame(1), Frame(2), Frame(3)}, {Point(1)}), ElementsAre(true, false, false));
}

TEST(MapBundle, MeasurementsAreThoseOfTheFeatures) {
  const Map map = MakeMap();
  const MapBundle problem = MakeMapBundle(map, kStreetRig, {}, {Frame(0), Frame(1)}, {Point(0)});
  for (const BundleObservation& o : problem.bundle.observations) {
    const Eigen::Vector3d uvd = kStreetRig.Project(problem.bundle.camera_from_map[o.pose_idx] *
                                                   problem.bundle.points_in_map[o.point_idx]);
    EXPECT_LT((o.px - uvd.head<2>()).norm(), 1e-3);
    EXPECT_NEAR(o.disparity_px, uvd.z(), 1e-3);
  }
}

TEST(MapBundle, EditMovesWhatIsFreeAndTakesOutliersAway) {
  Map map = MakeMap();
  MapBundle problem = MakeMapBundle(map, kStreetRig, {}, {Frame(2), Frame(3)}, {Point(1)});
  for (Rigid3& pose : problem.bundle.camera_from_map) pose.translation.x() -= 0.5;
  problem.bundle.points_in_map[0].x() += 0.25;
  BundleSummary summary{.is_outlier = {false, true, false}};
  const MapEdit edit = EditOf(problem, summary);
  ASSERT_THAT(edit.removed_observations, SizeIs(1));
  EXPECT_EQ(edit.removed_observations[0].observation.keyframe_id, Frame(2));
  EXPECT_EQ(*Apply(edit, map), 0u);
  EXPECT_EQ(map.Find(Frame(1))->map_from_camera.translation.x(), 0);
  EXPECT_NEAR(map.Find(Frame(2))->map_from_camera.translation.x(), 0.5, 1e-12);
  EXPECT_NEAR(map.Find(Point(1))->position_in_map.x(), -1.75, 1e-12);
  EXPECT_THAT(map.Find(Point(1))->observations, SizeIs(2));
  EXPECT_TRUE(CheckConsistency(map).ok()) << CheckConsistency(map);
}

TEST(MapBundle, LandmarksAtNoDistanceThatCouldBeToldGo) {
  Map map = MakeMap();
  MapBundle problem = MakeMapBundle(map, kStreetRig, {}, {Frame(2), Frame(3)}, {Point(1)});
  problem.bundle.points_in_map[0] *= 1e6;
  const MapEdit edit = EditOf(problem, {.is_outlier = {false, false, false}});
  EXPECT_THAT(edit.removed_landmarks, ElementsAre(Point(1)));
  EXPECT_EQ(*Apply(edit, map), 0u);
  EXPECT_EQ(map.Find(Point(1)), nullptr);
  EXPECT_TRUE(CheckConsistency(map).ok()) << CheckConsistency(map);
}

}  // namespace
}  // namespace carmap
