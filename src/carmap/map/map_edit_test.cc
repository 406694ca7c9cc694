#include "carmap/map/map_edit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <random>

namespace carmap {
namespace {

using ::testing::ElementsAre;
using ::testing::Eq;
using ::testing::IsEmpty;
using ::testing::Optional;
using ::testing::SizeIs;

constexpr DriveId kDrive{7};
constexpr int kFeatureCount = 6;

KeyframeId Frame(uint32_t index) { return {kDrive, index}; }
LandmarkId Mark(uint32_t index) { return {kDrive, index}; }

Keyframe MakeKeyframe(uint32_t index) {
  Keyframe keyframe{.id = Frame(index)};
  keyframe.features = std::make_shared<const std::vector<Feature>>(kFeatureCount);
  return keyframe;
}

Landmark MakeLandmark(uint32_t index, std::vector<Observation> observations) {
  return {.id = Mark(index), .observations = std::move(observations)};
}

/// Keyframes 1, 2 and 3. Landmark 10 is feature 0 of 1 and 2, 11 is feature 1 of 2 and 3, 12 is
/// feature 2 of 1 alone.
Map MakeMap() {
  MapEdit edit;
  for (const uint32_t index : {1u, 2u, 3u}) edit.added_keyframes.push_back(MakeKeyframe(index));
  edit.added_landmarks = {MakeLandmark(10, {{Frame(1), 0}, {Frame(2), 0}}),
                          MakeLandmark(11, {{Frame(2), 1}, {Frame(3), 1}}),
                          MakeLandmark(12, {{Frame(1), 2}})};
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

size_t LeftOut(MapEdit edit, Map& map) {
  edit.base_version = map.version();
  const uint64_t version = map.version();
  const size_t left_out = *Apply(edit, map);
  EXPECT_EQ(map.version(), version + 1);
  EXPECT_TRUE(CheckConsistency(map).ok()) << CheckConsistency(map);
  return left_out;
}

TEST(Map, StartsEmpty) {
  const Map map;
  EXPECT_EQ(map.version(), 0u);
  EXPECT_THAT(map.keyframes(), IsEmpty());
  EXPECT_EQ(map.Find(Frame(1)), nullptr);
  EXPECT_EQ(map.Find(Mark(1)), nullptr);
  EXPECT_TRUE(CheckConsistency(map).ok());
}

TEST(Apply, AddsWithBothSidesOfEachLink) {
  const Map map = MakeMap();
  EXPECT_EQ(map.version(), 1u);
  EXPECT_TRUE(CheckConsistency(map).ok());
  ASSERT_NE(map.Find(Mark(10)), nullptr);
  EXPECT_THAT(map.Find(Mark(10))->observations,
              ElementsAre(Observation{Frame(1), 0}, Observation{Frame(2), 0}));
  EXPECT_THAT(map.LandmarksOf(Frame(2)),
              ElementsAre(Optional(Mark(10)), Optional(Mark(11)), Eq(std::nullopt),
                          Eq(std::nullopt), Eq(std::nullopt), Eq(std::nullopt)));
}

TEST(Apply, KeepsObservationsInOrder) {
  Map map = MakeMap();
  EXPECT_EQ(LeftOut({.added_observations = {{Mark(11), {Frame(1), 5}}}}, map), 0u);
  EXPECT_THAT(
      map.Find(Mark(11))->observations,
      ElementsAre(Observation{Frame(1), 5}, Observation{Frame(2), 1}, Observation{Frame(3), 1}));
}

TEST(Apply, LeavesOutKeyframesThatAreThereOrHaveNoFeatures) {
  Map map = MakeMap();
  Keyframe bare{.id = Frame(8)};
  EXPECT_EQ(LeftOut({.added_keyframes = {MakeKeyframe(2), bare, MakeKeyframe(9)}}, map), 2u);
  EXPECT_THAT(map.keyframes(), SizeIs(4));
  EXPECT_THAT(map.LandmarksOf(Frame(2))[0], Optional(Mark(10)));
}

TEST(Apply, LeavesOutLinksThatAreTakenOrLeadNowhere) {
  Map map = MakeMap();
  const Map before = map;
  EXPECT_EQ(LeftOut({.added_observations = {{Mark(11), {Frame(1), 0}},   // belongs to 10
                                            {Mark(10), {Frame(2), 4}},   // 10 is seen there already
                                            {Mark(99), {Frame(1), 4}},   // no such landmark
                                            {Mark(10), {Frame(9), 0}},   // no such keyframe
                                            {Mark(10), {Frame(3), -1}},  // no such feature
                                            {Mark(10), {Frame(3), kFeatureCount}}}},
                    map),
            6u);
  for (const auto& [id, landmark] : before.landmarks()) {
    EXPECT_EQ(map.Find(id)->observations, landmark.observations);
  }
}

TEST(Apply, AddsALandmarkWithThoseOfItsObservationsThatFit) {
  Map map = MakeMap();
  EXPECT_EQ(
      LeftOut({.added_landmarks = {MakeLandmark(20, {{Frame(1), 0}, {Frame(3), 4}}),  // 10 has it
                                   MakeLandmark(21, {{Frame(9), 0}}),  // fits nowhere
                                   MakeLandmark(22, {}), MakeLandmark(10, {{Frame(3), 5}})}},
              map),
      4u);
  EXPECT_THAT(map.Find(Mark(20))->observations, ElementsAre(Observation{Frame(3), 4}));
  EXPECT_EQ(map.Find(Mark(21)), nullptr);
  EXPECT_EQ(map.Find(Mark(22)), nullptr);
  EXPECT_THAT(map.Find(Mark(10))->observations, SizeIs(2));
}

TEST(Apply, ALandmarkThatLosesItsLastObservationGoes) {
  Map map = MakeMap();
  EXPECT_EQ(
      LeftOut({.removed_observations = {{Mark(10), {Frame(1), 0}}, {Mark(12), {Frame(1), 2}}}},
              map),
      0u);
  EXPECT_THAT(map.Find(Mark(10))->observations, ElementsAre(Observation{Frame(2), 0}));
  EXPECT_EQ(map.Find(Mark(12)), nullptr);
  EXPECT_THAT(map.LandmarksOf(Frame(1)), ::testing::Each(Eq(std::nullopt)));
}

TEST(Apply, RemovesOnlyTheObservationThatIsMeant) {
  Map map = MakeMap();
  EXPECT_EQ(LeftOut({.removed_observations = {{Mark(10), {Frame(1), 3}},  // is feature 0 by now
                                              {Mark(10), {Frame(3), 0}},
                                              {Mark(99), {Frame(1), 0}}}},
                    map),
            3u);
  EXPECT_THAT(map.Find(Mark(10))->observations, SizeIs(2));
}

TEST(Apply, MergesObservationsWhereThereIsNone) {
  Map map = MakeMap();
  EXPECT_EQ(LeftOut({.merges = {{Mark(11), Mark(10)}}}, map), 0u);
  EXPECT_EQ(map.Find(Mark(11)), nullptr);
  EXPECT_THAT(
      map.Find(Mark(10))->observations,
      ElementsAre(Observation{Frame(1), 0}, Observation{Frame(2), 0}, Observation{Frame(3), 1}));
  EXPECT_EQ(map.LandmarksOf(Frame(2))[1], std::nullopt) << "frame 2 saw 10 already";
  EXPECT_THAT(map.LandmarksOf(Frame(3))[1], Optional(Mark(10)));
}

TEST(Apply, LeavesOutMergesWithItselfAndWithWhatIsGone) {
  Map map = MakeMap();
  EXPECT_EQ(
      LeftOut({.merges = {{Mark(10), Mark(10)}, {Mark(99), Mark(10)}, {Mark(10), Mark(99)}}}, map),
      3u);
  EXPECT_THAT(map.landmarks(), SizeIs(3));
  // A chain ends in its last; 12 is in 10 already when it is to be merged once more.
  EXPECT_EQ(
      LeftOut({.merges = {{Mark(12), Mark(11)}, {Mark(11), Mark(10)}, {Mark(12), Mark(10)}}}, map),
      1u);
  EXPECT_THAT(map.landmarks(), SizeIs(1));
}

TEST(Apply, MovesAndChanges) {
  Map map = MakeMap();
  Descriptor descriptor;
  descriptor.words[1] = 5;
  const MapEdit edit{
      .moved_keyframes = {{Frame(2), {RotationExp({0, 1, 0}), {1, 2, 3}}}, {Frame(9), {}}},
      .moved_landmarks = {{Mark(11), {4, 5, 6}}, {Mark(99), {0, 0, 0}}},
      .changed_descriptors = {{Mark(12), descriptor}, {Mark(99), descriptor}}};
  EXPECT_EQ(LeftOut(edit, map), 3u);
  EXPECT_EQ(map.Find(Frame(2))->map_from_camera.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(map.Find(Mark(11))->position_in_map, Eigen::Vector3d(4, 5, 6));
  EXPECT_EQ(map.Find(Mark(12))->descriptor, descriptor);
  EXPECT_EQ(map.Find(Mark(10))->position_in_map, Eigen::Vector3d(0, 0, 0));
}

TEST(Apply, RemovesLandmarks) {
  Map map = MakeMap();
  EXPECT_EQ(LeftOut({.removed_landmarks = {Mark(10), Mark(10), Mark(99)}}, map), 2u);
  EXPECT_EQ(map.Find(Mark(10)), nullptr);
  EXPECT_EQ(map.LandmarksOf(Frame(1))[0], std::nullopt);
  EXPECT_EQ(map.LandmarksOf(Frame(2))[0], std::nullopt);
}

TEST(Apply, RebasesAnEditOfAnOlderVersion) {
  Map map = MakeMap();
  const MapEdit stale{.base_version = map.version(),
                      .added_observations = {{Mark(12), {Frame(3), 3}}, {Mark(11), {Frame(1), 4}}},
                      .moved_landmarks = {{Mark(10), {1, 1, 1}}, {Mark(11), {2, 2, 2}}},
                      .removed_landmarks = {Mark(12)}};
  // Meanwhile another edit takes the feature and merges landmark 10 away.
  EXPECT_EQ(LeftOut({.added_landmarks = {MakeLandmark(13, {{Frame(3), 3}})},
                     .merges = {{Mark(10), Mark(11)}}},
                    map),
            0u);
  // 11 now has the observation of 10 in frame 1, so it cannot get another there.
  EXPECT_EQ(*Apply(stale, map), 3u);
  EXPECT_TRUE(CheckConsistency(map).ok());
  EXPECT_EQ(map.Find(Mark(11))->position_in_map, Eigen::Vector3d(2, 2, 2));
  EXPECT_THAT(map.LandmarksOf(Frame(3))[3], Optional(Mark(13)));
  EXPECT_EQ(map.Find(Mark(12)), nullptr);
}

TEST(Apply, RefusesAnEditOfAVersionYetToCome) {
  Map map = MakeMap();
  const auto applied = Apply({.base_version = 2, .removed_landmarks = {Mark(10)}}, map);
  EXPECT_EQ(applied.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(map.version(), 1u);
  EXPECT_THAT(map.landmarks(), SizeIs(3));
}

TEST(Apply, RefusesPlacesThatAreNotFinite) {
  Map map = MakeMap();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Rigid3 nowhere{Eigen::Quaterniond::Identity(), {0, nan, 0}},
      no_rotation{Eigen::Quaterniond(0, 0, 0, 0), {0, 0, 0}};
  Keyframe keyframe = MakeKeyframe(9);
  keyframe.map_from_camera = nowhere;
  Landmark landmark = MakeLandmark(20, {{Frame(1), 4}});
  landmark.position_in_map.x() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(LeftOut({.added_keyframes = {keyframe},
                     .added_landmarks = {landmark},
                     .moved_keyframes = {{Frame(1), nowhere}, {Frame(2), no_rotation}},
                     .moved_landmarks = {{Mark(11), {0, nan, 0}}}},
                    map),
            5u);
  EXPECT_EQ(map.Find(Frame(9)), nullptr);
  EXPECT_EQ(map.Find(Mark(20)), nullptr);
  EXPECT_EQ(map.Find(Frame(1))->map_from_camera.translation, Eigen::Vector3d(0, 0, 0));
  EXPECT_EQ(map.Find(Mark(11))->position_in_map, Eigen::Vector3d(0, 0, 0));
}

TEST(Apply, AMoveOfAnOlderVersionDoesNotOverwriteANewerOne) {
  Map map = MakeMap();
  const Rigid3 older{Eigen::Quaterniond::Identity(), {1, 0, 0}},
      newer{Eigen::Quaterniond::Identity(), {2, 0, 0}};
  const MapEdit stale{.base_version = map.version(),
                      .moved_keyframes = {{Frame(1), older}, {Frame(2), older}},
                      .moved_landmarks = {{Mark(10), {1, 1, 1}}, {Mark(11), {1, 1, 1}}}};
  EXPECT_EQ(
      LeftOut({.moved_keyframes = {{Frame(1), newer}}, .moved_landmarks = {{Mark(10), {2, 2, 2}}}},
              map),
      0u);
  EXPECT_EQ(*Apply(stale, map), 2u);
  EXPECT_EQ(map.Find(Frame(1))->map_from_camera.translation, newer.translation);
  EXPECT_EQ(map.Find(Frame(2))->map_from_camera.translation, older.translation);
  EXPECT_EQ(map.Find(Mark(10))->position_in_map, Eigen::Vector3d(2, 2, 2));
  EXPECT_EQ(map.Find(Mark(11))->position_in_map, Eigen::Vector3d(1, 1, 1));
}

TEST(Apply, ObservationsFollowALandmarkThatWasMergedMeanwhile) {
  Map map = MakeMap();
  const MapEdit stale{.base_version = map.version(),
                      .added_observations = {{Mark(12), {Frame(3), 3}}},
                      .removed_observations = {{Mark(12), {Frame(1), 2}}}};
  EXPECT_EQ(LeftOut({.merges = {{Mark(12), Mark(11)}}}, map), 0u);
  EXPECT_EQ(LeftOut({.removed_observations = {{Mark(11), {Frame(3), 1}}},
                     .merges = {{Mark(11), Mark(10)}}},
                    map),
            0u);
  // 12 went to 11, which went to 10, which frame 1 saw already.
  EXPECT_EQ(*Apply(stale, map), 1u);
  EXPECT_TRUE(CheckConsistency(map).ok());
  EXPECT_THAT(
      map.Find(Mark(10))->observations,
      ElementsAre(Observation{Frame(1), 0}, Observation{Frame(2), 0}, Observation{Frame(3), 3}));
}

/// Records drawn without regard for what the map holds.
class EditGenerator {
 public:
  explicit EditGenerator(uint32_t seed) : random_(seed) {}

  MapEdit Draw(uint64_t version) {
    MapEdit edit{.base_version = version - Below(std::min<uint64_t>(version, 3) + 1)};
    Repeat([&] { edit.added_keyframes.push_back(MakeKeyframe(Below(12))); });
    Repeat([&] {
      Landmark landmark = MakeLandmark(Below(40), {});
      Repeat([&] { landmark.observations.push_back(DrawObservation()); });
      edit.added_landmarks.push_back(landmark);
    });
    Repeat([&] { edit.added_observations.push_back({Mark(Below(40)), DrawObservation()}); });
    Repeat([&] { edit.added_observations.push_back({Mark(Below(40)), DrawObservation()}); });
    Repeat([&] { edit.removed_observations.push_back({Mark(Below(40)), DrawObservation()}); });
    if (Below(2)) Repeat([&] { edit.merges.push_back({Mark(Below(40)), Mark(Below(40))}); });
    Repeat([&] { edit.moved_keyframes.push_back({Frame(Below(12)), {}}); });
    Repeat([&] { edit.moved_landmarks.push_back({Mark(Below(40)), {1, 2, 3}}); });
    if (Below(4) == 0) Repeat([&] { edit.removed_landmarks.push_back(Mark(Below(40))); });
    if (Below(10) == 0) edit.removed_keyframes.push_back(Frame(Below(12)));
    return edit;
  }

 private:
  uint32_t Below(uint64_t bound) { return static_cast<uint32_t>(random_() % bound); }
  template <typename Step>
  void Repeat(Step&& step) {
    for (uint32_t n = Below(5); n > 0; --n) step();
  }
  Observation DrawObservation() {
    return {Frame(Below(12)), static_cast<int32_t>(Below(kFeatureCount + 2)) - 1};
  }

  std::mt19937 random_;
};

size_t RecordsOf(const MapEdit& e) {
  return e.added_keyframes.size() + e.added_landmarks.size() + e.added_observations.size() +
         e.removed_observations.size() + e.merges.size() + e.moved_keyframes.size() +
         e.moved_landmarks.size() + e.changed_descriptors.size() + e.removed_landmarks.size() +
         e.removed_keyframes.size();
}

TEST(Apply, KeepsTheMapConsistentWhateverTheEdits) {
  for (uint32_t seed = 1; seed <= 30; ++seed) {
    EditGenerator generator(seed);
    Map map, twin;
    size_t largest = 0;
    for (int n = 0; n < 150; ++n) {
      const MapEdit edit = generator.Draw(map.version());
      const auto left_out = Apply(edit, map);
      ASSERT_TRUE(left_out.ok());
      ASSERT_LE(*left_out, RecordsOf(edit));
      ASSERT_TRUE(CheckConsistency(map).ok()) << CheckConsistency(map) << " seed " << seed;
      ASSERT_EQ(map.version(), static_cast<uint64_t>(n) + 1);
      ASSERT_EQ(*Apply(edit, twin), *left_out);
      largest = std::max(largest, map.landmarks().size());
    }
    EXPECT_GT(largest, 8u) << "an empty map would prove nothing";
    for (const auto& [id, landmark] : map.landmarks()) {
      ASSERT_EQ(twin.Find(id)->observations, landmark.observations);
    }
  }
}

TEST(Apply, AKeyframeGoesWithItsObservations) {
  Map map = MakeMap();
  MapEdit edit;
  edit.removed_keyframes = {Frame(1), Frame(99)};
  EXPECT_EQ(LeftOut(edit, map), 1u) << "the one that is not there";
  EXPECT_EQ(map.Find(Frame(1)), nullptr);
  EXPECT_EQ(map.Find(Mark(12)), nullptr) << "no other keyframe saw it";
  EXPECT_THAT(map.Find(Mark(10))->observations, ElementsAre(Observation{Frame(2), 0}));
  EXPECT_EQ(map.keyframes().size(), 2u);
}

std::shared_ptr<const std::vector<Mobility>> Labels(std::vector<Mobility> of_feature) {
  of_feature.resize(kFeatureCount, Mobility::kUnknown);
  return std::make_shared<const std::vector<Mobility>>(std::move(of_feature));
}

TEST(Apply, KeyframesVoteOnWhatTheySee) {
  Map map = MakeMap();
  const auto labels = Labels({Mobility::kNonStatic, Mobility::kStatic});
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(1), labels}, {Frame(2), labels}}}, map), 0u);
  EXPECT_EQ(map.Find(Mark(10))->votes.non_static, 2u);
  EXPECT_TRUE(map.Find(Mark(10))->is_non_static());
  EXPECT_EQ(map.Find(Mark(11))->votes.is_static, 1u);
  EXPECT_FALSE(map.Find(Mark(11))->is_non_static());
  EXPECT_EQ(map.Find(Mark(12))->votes.is_static + map.Find(Mark(12))->votes.non_static, 0u);
}

TEST(Apply, AVoteComesAndGoesWithTheObservation) {
  Map map = MakeMap();
  const auto labels = Labels({Mobility::kUnknown, Mobility::kUnknown, Mobility::kNonStatic});
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(3), labels}}}, map), 0u);
  const MapEdit::LandmarkObservation seen{Mark(12), {Frame(3), 2}};
  EXPECT_EQ(LeftOut({.added_observations = {seen}}, map), 0u);
  EXPECT_TRUE(map.Find(Mark(12))->is_non_static());
  EXPECT_EQ(LeftOut({.removed_observations = {seen}}, map), 0u);
  EXPECT_FALSE(map.Find(Mark(12))->is_non_static());
}

TEST(Apply, VotesOutliveTheirKeyframes) {
  Map map = MakeMap();
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(2), Labels({Mobility::kNonStatic})}},
                     .removed_keyframes = {Frame(2)}},
                    map),
            0u);
  EXPECT_TRUE(map.Find(Mark(10))->is_non_static());
}

TEST(Apply, LeavesOutLabelsThatDoNotFit) {
  Map map = MakeMap();
  const auto good = Labels({});
  const auto short_one = std::make_shared<const std::vector<Mobility>>(kFeatureCount - 1);
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(9), good}}}, map), 1u);
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(1), nullptr}}}, map), 1u);
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(1), short_one}}}, map), 1u);
  EXPECT_EQ(LeftOut({.labelled_keyframes = {{Frame(1), good}, {Frame(1), good}}}, map), 1u);
}

}  // namespace
}  // namespace carmap
