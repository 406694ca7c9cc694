#include "carmap/format/alternatives.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"

namespace carmap {
namespace {

constexpr size_t kFeatures = 100;

/// `lean` with keyframes of 100 features each and an index of a few entries.
PlainMapContents CompleteMap(const LeanMap& lean) {
  PlainMapContents map;
  map.lean = &lean;
  map.keyframe_features.assign(lean.keyframes.size(),
                               std::make_shared<std::vector<Feature>>(kFeatures));
  for (const LeanLandmark& landmark : lean.landmarks) {
    map.observed_feature_idxs.emplace_back(landmark.keyframe_idxs.size(), 7);
  }
  map.feature_grids.assign(lean.keyframes.size(), {{0, 1, 2}, {4, 5}});
  map.keyframe_tree = {{1, 2, 3}, {0.5f}};
  map.landmark_tree = {{1, 2}, {}};
  map.covisibility = {{0, 1, 20}, {1, 2, 30}};
  return map;
}

TEST(MeasureComposition, AddsUpToTheFieldsThatTheHeaderNames) {
  const LeanMap lean = RandomStreet(1);
  const PlainMapContents map = CompleteMap(lean);
  const auto bytes = MeasureComposition(map);
  ASSERT_TRUE(bytes.ok()) << bytes.status();

  size_t keyframes = 88 * lean.drives.size(), observations = 0;
  for (const LeanKeyframe& keyframe : lean.keyframes) keyframes += keyframe.gps ? 65 : 41;
  for (const LeanLandmark& landmark : lean.landmarks) observations += landmark.keyframe_idxs.size();
  const size_t a = 33 * lean.landmarks.size();
  const size_t b = lean.keyframes.size() * (4 + 29 * kFeatures);
  const size_t c_of_landmarks = 4 * lean.landmarks.size() + 8 * observations;
  const size_t c_of_features = 4 * kFeatures * lean.keyframes.size();
  const size_t c_of_keyframes = 4 * lean.keyframes.size() + 4 * observations;
  const size_t trees = (4 + 12 + 4 + 4) + (4 + 8 + 4 + 0) + (4 + 2 * 12);
  const size_t grids = lean.keyframes.size() * (4 + 12 + 4 + 8);
  EXPECT_EQ(bytes->full, keyframes + a + b + c_of_landmarks + c_of_features + trees + grids);
  EXPECT_EQ(bytes->no_index, keyframes + a + b + c_of_landmarks);
  EXPECT_EQ(bytes->no_keyframe_features, keyframes + a + c_of_landmarks + c_of_keyframes + trees);
  EXPECT_EQ(bytes->lean, EncodeLeanMap(lean)->size());
}

TEST(MeasureComposition, RefusesPartsThatDoNotFit) {
  const LeanMap lean = RandomStreet(1);
  PlainMapContents map = CompleteMap(lean);
  map.keyframe_features.pop_back();
  EXPECT_TRUE(absl::IsInvalidArgument(MeasureComposition(map).status()));
  map = CompleteMap(lean);
  map.observed_feature_idxs[3].push_back(0);
  EXPECT_TRUE(absl::IsInvalidArgument(MeasureComposition(map).status()));
  map = CompleteMap(lean);
  map.observed_feature_idxs[3][0] = kFeatures;
  EXPECT_TRUE(absl::IsInvalidArgument(MeasureComposition(map).status()));
  map = CompleteMap(lean);
  map.keyframe_features[2] = nullptr;
  EXPECT_TRUE(absl::IsInvalidArgument(MeasureComposition(map).status()));
}

}  // namespace
}  // namespace carmap
