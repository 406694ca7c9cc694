#include "carmap/slam/local_mapper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

constexpr DriveId kDrive{7};

/// A drive along a street whose frames are all keyframes. The map's frame is that of its first
/// camera.
class LocalMapperTest : public ::testing::Test {
 protected:
  NewKeyframe KeyframeAt(uint32_t index, std::vector<Feature> features,
                         const Rigid3& error = {}) const {
    NewKeyframe made;
    made.keyframe.id = {kDrive, index};
    made.keyframe.timestamp = Timestamp::FromSeconds(0.1 * index);
    made.keyframe.map_from_camera = Truth(index) * error;
    made.keyframe.features = std::make_shared<const std::vector<Feature>>(std::move(features));
    return made;
  }
  /// The keyframe, with the landmarks of the keyframe before as tracking would find them.
  NewKeyframe TrackedAt(const LocalMapper& mapper, uint32_t index, std::vector<Feature> features,
                        const Rigid3& error = {}) const {
    NewKeyframe made = KeyframeAt(index, std::move(features), error);
    if (index == 0) return made;
    for (const auto& link : mapper.map().LandmarksOf({kDrive, index - 1})) {
      if (!link) continue;
      const Descriptor& descriptor = mapper.map().Find(*link)->descriptor;
      for (uint32_t i = 0; i < made.keyframe.features->size(); ++i) {
        if (HammingDistance((*made.keyframe.features)[i].descriptor, descriptor) > 25) continue;
        made.landmark_of_feature.emplace_back(*link, i);
      }
    }
    return made;
  }
  std::vector<Feature> See(uint32_t index, const StreetNoise& noise = {}) const {
    return SeeStreet(street_, kStreetRig, poses_.at(index), noise, index + 1);
  }
  Rigid3 Truth(uint32_t index) const { return poses_.front().Inverse() * poses_.at(index); }
  double PositionError(const Map& map, uint32_t index) const {
    return (map.Find(KeyframeId{kDrive, index})->map_from_camera.translation -
            Truth(index).translation)
        .norm();
  }
  /// Distance of each landmark to the corner that its signature names.
  std::vector<double> LandmarkErrors(const Map& map) const {
    std::vector<double> errors;
    for (const auto& [id, landmark] : map.landmarks()) {
      const Eigen::Vector3d p = poses_.front() * landmark.position_in_map;
      for (const Street::Corner& corner : street_.corners) {
        if (HammingDistance(corner.descriptor, landmark.descriptor) > 30) continue;
        errors.push_back((corner.p_in_world - p).norm());
        break;
      }
    }
    std::sort(errors.begin(), errors.end());
    return errors;
  }

  const Street street_ = MakeStreet(4, 80);
  const std::vector<Rigid3> poses_ = DriveAlong(0, 0, 30);
};

TEST_F(LocalMapperTest, TheFirstKeyframeMakesALandmarkOfEachFeatureWithDepth) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  std::vector<Feature> features = See(0);
  const size_t count = features.size();
  features.push_back({.x_px = 100, .y_px = 100});                        // without depth
  features.push_back({.x_px = 200, .y_px = 100, .disparity_px = 1.4f});  // too far away
  const auto local = mapper.Insert(KeyframeAt(0, features));
  EXPECT_TRUE(CheckConsistency(mapper.map()).ok()) << CheckConsistency(mapper.map());
  EXPECT_EQ(mapper.map().landmarks().size(), count);
  EXPECT_EQ(local->snapshot.landmarks.size(), count);
  ASSERT_EQ(local->snapshot.keyframes.size(), 1u);
  EXPECT_LT(LandmarkErrors(mapper.map()).back(), 1e-3);
}

TEST_F(LocalMapperTest, SeesEachCornerAsOneLandmarkWithoutNoise) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  size_t features = 0;
  for (uint32_t i = 0; i < 12; ++i) {
    const auto seen = See(i);
    features += seen.size();
    const auto local = mapper.Insert(TrackedAt(mapper, i, seen));
    ASSERT_TRUE(CheckConsistency(mapper.map()).ok()) << CheckConsistency(mapper.map());
    EXPECT_EQ(local->snapshot.keyframes.back().id, (KeyframeId{kDrive, i}));
    EXPECT_LT(PositionError(mapper.map(), i), 1e-3);
  }
  const std::vector<double> errors = LandmarkErrors(mapper.map());
  EXPECT_EQ(errors.size(), mapper.map().landmarks().size());
  EXPECT_LT(errors.at(errors.size() * 9 / 10), 0.01);
  std::vector<Descriptor> signatures;
  size_t observations = 0;
  for (const auto& [id, landmark] : mapper.map().landmarks()) {
    signatures.push_back(landmark.descriptor);
    observations += landmark.observations.size();
  }
  std::sort(signatures.begin(), signatures.end());
  EXPECT_EQ(std::unique(signatures.begin(), signatures.end()), signatures.end()) << "none twice";
  EXPECT_GT(static_cast<double>(observations), 0.95 * static_cast<double>(features));
}

TEST_F(LocalMapperTest, MendsPosesThatTrackingGotWrong) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  const Rigid3 error{RotationExp({0, 0.001, 0}), {0.02, -0.01, 0.02}};
  for (uint32_t i = 0; i < 8; ++i) {
    mapper.Insert(TrackedAt(mapper, i, See(i, {.pixel_px = 0.25, .descriptor_bits = 5}),
                            i > 0 ? error : Rigid3()));
  }
  EXPECT_EQ(mapper.map().keyframes().begin()->second.map_from_camera.translation,
            Truth(0).translation)
      << "the first keyframe is where the map begins";
  for (uint32_t i = 1; i < 8; ++i) EXPECT_LT(PositionError(mapper.map(), i), 0.02) << i;
  EXPECT_TRUE(CheckConsistency(mapper.map()).ok());
}

TEST_F(LocalMapperTest, TakesOverWhatTrackingFound) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  mapper.Insert(KeyframeAt(0, See(0)));
  const auto [id, landmark] = *mapper.map().landmarks().begin();
  std::vector<Feature> features = See(1);
  for (uint32_t i = 0; i < features.size(); ++i) {
    if (features[i].descriptor != landmark.descriptor) continue;
    NewKeyframe keyframe = KeyframeAt(1, features);
    keyframe.landmark_of_feature = {{id, i}, {LandmarkId{kDrive, 999999}, 0}};  // one gone since
    mapper.Insert(keyframe);
    EXPECT_EQ(mapper.map().LandmarksOf({kDrive, 1})[i], id);
    EXPECT_TRUE(CheckConsistency(mapper.map()).ok());
    return;
  }
  FAIL() << "the second frame does not see the landmark";
}

TEST_F(LocalMapperTest, FeaturesSeenOnceDoNotStay) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  StreetRandom random(5);
  for (uint32_t i = 0; i < 10; ++i) {
    std::vector<Feature> features = See(i);
    for (int n = 0; n < 100; ++n) {
      features.push_back({.x_px = static_cast<float>(random.Uniform(20, 1200)),
                          .y_px = static_cast<float>(random.Uniform(20, 350)),
                          .disparity_px = static_cast<float>(random.Uniform(3, 60)),
                          .descriptor = random.RandomDescriptor()});
    }
    mapper.Insert(TrackedAt(mapper, i, features));
  }
  std::vector<size_t> strange_of_keyframe(10, 0);
  for (const auto& [id, landmark] : mapper.map().landmarks()) {
    const bool known = std::any_of(
        street_.corners.begin(), street_.corners.end(),
        [&, &mark = landmark](const auto& corner) { return corner.descriptor == mark.descriptor; });
    if (!known) ++strange_of_keyframe.at(landmark.observations.front().keyframe_id.index);
  }
  for (size_t i = 0; i < 7; ++i) EXPECT_LT(strange_of_keyframe[i], 5u) << i;
  EXPECT_GT(strange_of_keyframe[9], 80u) << "still on trial";
}

TEST_F(LocalMapperTest, FindsTheRigsDisparityBias) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  StereoRig biased = kStreetRig;
  biased.disparity_bias.coefficients_px = {0.2, -0.1, 0.15};
  std::shared_ptr<const LocalMap> local;
  for (uint32_t i = 0; i < poses_.size(); ++i) {
    std::vector<Feature> features = See(i, {.pixel_px = 0.2});
    for (Feature& feature : features) {
      feature.disparity_px += static_cast<float>(
          biased.disparity_bias.At((feature.x_px - biased.camera.cx) / biased.camera.fx));
    }
    local = mapper.Insert(TrackedAt(mapper, i, features));
  }
  for (const double x : {-0.6, 0.0, 0.6}) {
    EXPECT_NEAR(mapper.rig().disparity_bias.At(x), biased.disparity_bias.At(x), 0.05) << x;
  }
  EXPECT_EQ(local->rig, mapper.rig());
}

TEST_F(LocalMapperTest, OffersAWindowOfSoManyKeyframes) {
  LocalMapper mapper(kStreetRig, kDrive, {.window = {.keyframes = 4}});
  std::shared_ptr<const LocalMap> local;
  for (uint32_t i = 0; i < 8; ++i) local = mapper.Insert(TrackedAt(mapper, i, See(i)));
  ASSERT_EQ(local->snapshot.keyframes.size(), 4u);
  EXPECT_EQ(local->snapshot.keyframes.back().id.index, 7u);
  EXPECT_EQ(local->snapshot.version, mapper.map().version());
}

TEST_F(LocalMapperTest, KeyframesThatShareNothingStandAlone) {
  LocalMapper mapper(kStreetRig, kDrive, {});
  mapper.Insert(KeyframeAt(0, See(0)));
  const Street other = MakeStreet(99, 80);
  const auto local = mapper.Insert(KeyframeAt(1, SeeStreet(other, kStreetRig, poses_[1])));
  EXPECT_EQ(local->snapshot.keyframes.size(), 1u);
  const auto of_empty = mapper.Insert(KeyframeAt(2, {}));
  EXPECT_EQ(of_empty->snapshot.keyframes.size(), 1u);
  EXPECT_TRUE(of_empty->snapshot.landmarks.empty());
  EXPECT_TRUE(CheckConsistency(mapper.map()).ok());
}

}  // namespace
}  // namespace carmap
