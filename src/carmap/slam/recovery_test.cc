#include "carmap/slam/recovery.h"

#include <gtest/gtest.h>

#include <memory>

#include "carmap/map/test_street.h"
#include "carmap/slam/local_mapper.h"

namespace carmap {
namespace {

constexpr DriveId kDrive{7};

/// The map of a drive of 60 m, and another frame in it.
class RecoveryTest : public ::testing::Test {
 protected:
  RecoveryTest() {
    for (uint32_t i = 0; i < poses_.size(); ++i) {
      NewKeyframe made;
      made.keyframe.id = {kDrive, i};
      made.keyframe.timestamp = Timestamp::FromSeconds(0.2 * i);
      made.keyframe.map_from_camera = map_from_world_ * poses_[i];
      made.keyframe.features =
          std::make_shared<const std::vector<Feature>>(SeeStreet(street_, kStreetRig, poses_[i]));
      if (i > 0) made.landmark_of_feature = KnownLandmarks(*made.keyframe.features);
      mapper_.Insert(made);
    }
    for (const auto& [id, keyframe] : map().keyframes()) all_.push_back(id);
  }
  const Map& map() const { return mapper_.map(); }

  using Links = std::vector<std::pair<LandmarkId, uint32_t>>;
  /// What tracking would find: the landmarks of the latest keyframe with the same signatures.
  Links KnownLandmarks(const std::vector<Feature>& features) const {
    Links links;
    for (const auto& link : map().LandmarksOf(map().keyframes().rbegin()->first)) {
      for (uint32_t i = 0; link && i < features.size(); ++i) {
        if (features[i].descriptor == map().Find(*link)->descriptor) links.emplace_back(*link, i);
      }
    }
    return links;
  }
  void ExpectAt(const std::optional<FoundPlace>& found, const Rigid3& world_from_camera) const {
    ASSERT_TRUE(found);
    const Rigid3 map_from_camera = map_from_world_ * world_from_camera;
    EXPECT_LT(
        (found->pose.camera_from_map.Inverse().translation - map_from_camera.translation).norm(),
        0.02);
    EXPECT_GE(found->pose.inliers.size(), 30u);
    for (const LandmarkMatch& match : found->pose.inliers) {
      EXPECT_LT(match.landmark_idx, found->snapshot.landmarks.size());
    }
    EXPECT_NE(map().Find(found->keyframe_id), nullptr);
  }

  const Street street_ = MakeStreet(4, 110);
  const std::vector<Rigid3> poses_ = DriveAlong(0, 0, 60, 2);
  const Rigid3 map_from_world_ = poses_.front().Inverse();
  LocalMapper mapper_{kStreetRig, kDrive, {}};
  std::vector<KeyframeId> all_;
  const Rigid3 elsewhere_{RotationExp({0, 0.05, 0}), {0.8, 0, 31}};
};

TEST_F(RecoveryTest, FindsAFrameNearThePrediction) {
  const auto features = SeeStreet(street_, kStreetRig, elsewhere_);
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  Rigid3 predicted = map_from_world_ * elsewhere_;
  predicted.translation.z() += 12;
  ExpectAt(FindNear(map(), all_, grid, kStreetRig, predicted, {}), elsewhere_);
}

TEST_F(RecoveryTest, LooksOnlyNearThePredictionAndAmongTheCandidates) {
  const auto features = SeeStreet(street_, kStreetRig, elsewhere_);
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  Rigid3 predicted = map_from_world_ * elsewhere_;
  EXPECT_FALSE(FindNear(map(), {}, grid, kStreetRig, predicted, {}));
  predicted.translation.x() += 100;
  EXPECT_FALSE(FindNear(map(), all_, grid, kStreetRig, predicted, {}));
}

TEST_F(RecoveryTest, FindsAFrameAnywhere) {
  for (const double z : {5.0, 55.0}) {
    const Rigid3 pose{RotationExp({0, -0.05, 0}), {-0.8, 0, z}};
    const auto features = SeeStreet(street_, kStreetRig, pose, {.descriptor_bits = 10});
    const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
    ExpectAt(FindAnywhere(map(), all_, grid, kStreetRig, {}), pose);
  }
}

TEST_F(RecoveryTest, FindsNoFrameOfAnotherStreet) {
  const auto strange = SeeStreet(MakeStreet(99, 110), kStreetRig, elsewhere_);
  const FeatureGrid grid(strange, kStreetRig.camera.width, kStreetRig.camera.height);
  EXPECT_FALSE(FindNear(map(), all_, grid, kStreetRig, map_from_world_ * elsewhere_, {}));
  EXPECT_FALSE(FindAnywhere(map(), all_, grid, kStreetRig, {}));
}

}  // namespace
}  // namespace carmap
