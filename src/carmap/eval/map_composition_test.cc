#include "carmap/eval/map_composition.h"

#include <gtest/gtest.h>

#include <memory>

#include "carmap/format/lean_codec.h"
#include "carmap/map/map_edit.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

constexpr DriveId kDrive{5};

/// The map of a street without noise: each corner that a keyframe sees is its landmark.
Map MapOfStreet(const Street& street, const std::vector<Rigid3>& poses) {
  MapEdit edit;
  for (uint32_t i = 0; i < poses.size(); ++i) {
    auto features =
        std::make_shared<const std::vector<Feature>>(SeeStreet(street, kStreetRig, poses[i]));
    edit.added_keyframes.push_back({{kDrive, i}, {}, poses[i], std::nullopt, std::move(features)});
  }
  for (uint32_t c = 0; c < street.corners.size(); ++c) {
    const Street::Corner& corner = street.corners[c];
    Landmark landmark{{kDrive, c}, corner.p_in_world, corner.descriptor, {}};
    for (const Keyframe& keyframe : edit.added_keyframes) {
      for (size_t f = 0; f < keyframe.features->size(); ++f) {
        if ((*keyframe.features)[f].descriptor != corner.descriptor) continue;
        landmark.observations.push_back({keyframe.id, static_cast<int32_t>(f)});
      }
    }
    if (!landmark.observations.empty()) edit.added_landmarks.push_back(landmark);
  }
  Map map;
  EXPECT_EQ(Apply(edit, map).value(), 0u);
  return map;
}

TEST(MapComposition, MeasuresAllPartsOfAWorkingMap) {
  const Map map = MapOfStreet(MakeStreet(3, 40), DriveAlong(0, 0, 15));
  const StrippedMap stripped = Strip(map, {kDrive, kStreetRig});
  ASSERT_GT(stripped.lean.landmarks.size(), 100u);
  const auto bytes = MeasureComposition(map, stripped);
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  EXPECT_EQ(bytes->lean, EncodeLeanMap(stripped.lean)->size());
  EXPECT_GT(bytes->no_keyframe_features, bytes->lean);
  EXPECT_GT(bytes->no_index, bytes->no_keyframe_features);

  // (D) at least: a cell table for each keyframe, each feature and each landmark once.
  size_t features = 0;
  for (const auto& [id, keyframe] : map.keyframes()) features += keyframe.features->size();
  EXPECT_GT(bytes->full - bytes->no_index,
            4 * (77 * 24 * map.keyframes().size() + features + stripped.lean.landmarks.size()));
}

TEST(MapComposition, TakesAMapWithoutLandmarks) {
  const Map map = MapOfStreet(MakeStreet(3, 40), DriveAlong(0, 0, 0.5));
  const StrippedMap stripped = Strip(map, {kDrive, kStreetRig});
  ASSERT_TRUE(stripped.lean.landmarks.empty());
  EXPECT_TRUE(MeasureComposition(map, stripped).ok());
}

}  // namespace
}  // namespace carmap
