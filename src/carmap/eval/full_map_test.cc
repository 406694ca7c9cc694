#include "carmap/eval/full_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <string>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/format/container.h"
#include "carmap/format/lean_codec.h"
#include "carmap/localize/appearance_localizer.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;

const DriveId kDrive{77};
const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};

/// Keyframes along a street; the first feature of each sees one landmark, the third has no depth.
Map StreetMap(double length_m) {
  const Street street = MakeStreet(3, length_m + 50);
  MapEdit edit;
  Landmark landmark{.id = {kDrive, 9}};
  landmark.position_in_map = {1, 2, 3};
  uint32_t index = 0;
  for (const Rigid3& world_from_camera : DriveAlong(0, 0, length_m, 2)) {
    auto features = SeeStreet(street, kStreetRig, world_from_camera);
    features[2].disparity_px = Feature::kNoDisparity;
    const KeyframeId id{kDrive, 3 * index++};
    edit.added_keyframes.push_back({id, Timestamp::FromSeconds(0.3 * index),
                                    kMapFromWorld * world_from_camera, std::nullopt,
                                    std::make_shared<const std::vector<Feature>>(features)});
    landmark.observations.push_back({id, 0});
  }
  edit.added_landmarks.push_back(landmark);
  Map map;
  EXPECT_TRUE(Apply(edit, map).ok());
  return map;
}

TEST(FullMap, ComesBackFromItsBytesWithAllFeatures) {
  const Map map = StreetMap(20);
  const FullMap full = FullMapOf(map, {kDrive, kStreetRig});
  const auto decoded = DecodeFullMap(EncodeFullMap(full), "m");
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  EXPECT_EQ(decoded->drive.rig, kStreetRig);
  EXPECT_EQ(decoded->drive.id, kDrive);
  ASSERT_EQ(decoded->keyframes.size(), map.keyframes().size());
  for (const FullKeyframe& keyframe : decoded->keyframes) {
    const Keyframe& original = *map.Find(KeyframeId{kDrive, keyframe.index});
    EXPECT_EQ(keyframe.timestamp, original.timestamp);
    EXPECT_EQ(keyframe.map_from_camera.translation, original.map_from_camera.translation);
    ASSERT_EQ(keyframe.features.size(), original.features->size());
    for (size_t i = 0; i < keyframe.features.size(); ++i) {
      const auto& [feature, landmark_idx] = keyframe.features[i];
      EXPECT_EQ(feature.descriptor, (*original.features)[i].descriptor);
      EXPECT_EQ(feature.x_px, (*original.features)[i].x_px);
      EXPECT_EQ(feature.disparity_px, (*original.features)[i].disparity_px);
      EXPECT_EQ(feature.level, (*original.features)[i].level);
      EXPECT_EQ(landmark_idx, i == 0 ? 0 : FullFeature::kNoLandmark);
    }
  }
  EXPECT_EQ(EncodeFullMap(*decoded), EncodeFullMap(full));
}

TEST(FullMap, PlacesFeaturesByTheirLandmarkOrDisparity) {
  const FullMap full = FullMapOf(StreetMap(20), {kDrive, kStreetRig});
  const MapSnapshot snapshot = SnapshotOf(full);
  ASSERT_EQ(snapshot.keyframes.size(), full.keyframes.size());
  for (size_t k = 0; k < full.keyframes.size(); ++k) {
    const auto& landmark_idxs = snapshot.keyframes[k].landmark_idxs;
    ASSERT_EQ(landmark_idxs.size(), full.keyframes[k].features.size() - 1) << "one has no depth";
    EXPECT_EQ(snapshot.landmarks[landmark_idxs[0]].position_in_map, Eigen::Vector3d(1, 2, 3));
    const Feature& second = full.keyframes[k].features[1].feature;
    const Eigen::Vector3d p = full.keyframes[k].map_from_camera.Inverse() *
                              snapshot.landmarks[landmark_idxs[1]].position_in_map;
    EXPECT_NEAR(kStreetRig.Project(p).x(), second.x_px, 1e-3);
    EXPECT_NEAR(kStreetRig.Project(p).z(), second.disparity_px, 1e-3);
  }
  const LeanMap keyframes = KeyframesOf(full);
  EXPECT_TRUE(CheckConsistency(keyframes).ok());
  EXPECT_EQ(keyframes.keyframes.size(), full.keyframes.size());
}

TEST(FullMap, CanBeLocalizedIn) {
  const MapSnapshot snapshot = SnapshotOf(FullMapOf(StreetMap(60), {kDrive, kStreetRig}));
  const AppearanceLocalizer localizer(snapshot, DefaultVocabulary());
  const Rigid3 world_from_camera = DriveAlong(0.5, 31, 31).front();
  const auto pose =
      localizer.Localize(SeeStreet(MakeStreet(3, 110), kStreetRig, world_from_camera), kStreetRig);
  ASSERT_TRUE(pose);
  EXPECT_LT((pose->camera_from_map * kMapFromWorld * world_from_camera).translation.norm(), 0.01);
}

TEST(FullMap, OfHostileBytesIsRefused) {
  const std::string bytes = EncodeFullMap(FullMapOf(StreetMap(4), {kDrive, kStreetRig}));
  const auto sections = ReadContainer(bytes, "m");
  ASSERT_TRUE(sections.ok());
  const std::string content(sections->front().content);
  const auto decode = [](const std::string& damaged) {
    return DecodeFullMap(WriteContainer({{100, true, damaged}}), "m").status();
  };
  ASSERT_TRUE(decode(content).ok());
  // Cut anywhere, or followed by more: checksums that fit do not help.
  for (size_t length = 0; length < content.size(); length += length < 400 ? 1 : 97) {
    EXPECT_EQ(decode(content.substr(0, length)).code(), absl::StatusCode::kDataLoss) << length;
  }
  EXPECT_EQ(decode(content + '\0').code(), absl::StatusCode::kDataLoss);
  // Counts of four billion records end at once.
  constexpr size_t kLandmarkCount = 8 + 8 * 8 + 2 * 4;
  std::string huge = content;
  huge.replace(kLandmarkCount, 4, 4, '\xff');
  EXPECT_THAT(std::string(decode(huge).message()), HasSubstr("m: "));
  // Any other damage is refused or harmless.
  std::mt19937 generator(1);
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = content;
    damaged[generator() % damaged.size()] = static_cast<char>(generator());
    const auto map = DecodeFullMap(WriteContainer({{100, true, damaged}}), "m");
    if (map.ok()) SnapshotOf(*map);
  }
  std::string flipped = bytes;
  flipped[bytes.size() / 2] ^= 1;
  EXPECT_EQ(DecodeFullMap(flipped, "m").status().code(), absl::StatusCode::kDataLoss);
}

TEST(FullMap, IsNotMistakenForALeanOne) {
  const FullMap full = FullMapOf(StreetMap(4), {kDrive, kStreetRig});
  EXPECT_FALSE(DecodeLeanMap(EncodeFullMap(full), "m").ok());
  const auto lean = EncodeLeanMap(KeyframesOf(full));
  ASSERT_TRUE(lean.ok());
  EXPECT_EQ(DecodeFullMap(*lean, "m").status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace carmap
