#include "carmap/localize/place_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/localize/keyframe_view.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};
const StreetNoise kNoise{.pixel_px = 0.5, .descriptor_bits = 10};
const GpsFix kOrigin{49, 8.4, 110};

std::shared_ptr<const Vocabulary> TheVocabulary() {
  return {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()};
}

GpsFix FixAt(double x_m, double z_m) { return LocalEnu(kOrigin).ToGps({x_m, z_m, 0}); }

LeanMap WithGps(LeanMap map) {
  for (LeanKeyframe& keyframe : map.keyframes) {
    const Eigen::Vector3d p = kMapFromWorld.Inverse() * keyframe.map_from_camera.translation;
    keyframe.gps = FixAt(p.x(), p.z());
  }
  return map;
}

std::vector<PlaceHypothesis> SearchOnce(PlaceSearch& search, const std::vector<Feature>& features,
                                        const std::optional<GpsFix>& gps = std::nullopt) {
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  return search.Search(grid, kStreetRig, gps);
}

double ErrorM(const PlaceHypothesis& hypothesis, const Rigid3& world_from_camera) {
  return (hypothesis.camera_from_map.Inverse().translation -
          (kMapFromWorld * world_from_camera).translation)
      .norm();
}

class PlaceSearchTest : public ::testing::Test {
 protected:
  const Street street_ = MakeStreet(3, 260);
  const LeanMap lean_ =
      WithGps(MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 210), kMapFromWorld));
  const ReconstructedMap map_ = Reconstruct(lean_);
};

TEST_F(PlaceSearchTest, FindsEachFrameByItselfInTheNextLane) {
  LeanMap without_gps = lean_;
  for (LeanKeyframe& keyframe : without_gps.keyframes) keyframe.gps.reset();
  const ReconstructedMap map = Reconstruct(without_gps);
  for (const Rigid3& pose : DriveAlong(3, 2, 200, 9.7)) {
    PlaceSearch search(map, TheVocabulary());
    const auto features = SeeStreet(street_, kStreetRig, pose, kNoise);
    for (const auto& gps : {std::optional<GpsFix>(), std::optional(FixAt(0, 900))}) {
      const auto places = SearchOnce(search, features, gps);
      ASSERT_FALSE(places.empty()) << pose.translation.z();
      EXPECT_LT(ErrorM(places[0], pose), 0.1);
      EXPECT_GE(places[0].inliers.size(), 80u);
      EXPECT_GT(places[0].seen_share, 0.15);
      EXPECT_LE(places[0].seen_share, 1);
      EXPECT_FALSE(places[0].is_near_fix);
      const double sigma_m = std::sqrt(places[0].covariance.topLeftCorner<3, 3>().trace());
      EXPECT_GT(sigma_m, 1e-4);
      EXPECT_LT(sigma_m, 0.05);
      const auto& place = map.snapshot.keyframes[places[0].keyframe_idx].map_from_camera;
      EXPECT_LT((place.translation - (kMapFromWorld * pose).translation).norm(), 45);
    }
  }
}

TEST_F(PlaceSearchTest, TakesAFixThatIsRightWrongOrOfAnotherTown) {
  for (const Rigid3& pose : DriveAlong(0, 5, 150, 31)) {
    const auto features = SeeStreet(street_, kStreetRig, pose, kNoise);
    const double z = pose.translation.z();
    for (const GpsFix& fix : {FixAt(20, z - 20), FixAt(60, z), FixAt(0, z + 60), GpsFix{0, 0, 0},
                              FixAt(90'000, 7'000), GpsFix{90, 180, 0}}) {
      PlaceSearch search(map_, TheVocabulary());
      std::vector<PlaceHypothesis> places;
      for (int i = 0; i < 4 && places.empty(); ++i) places = SearchOnce(search, features, fix);
      ASSERT_FALSE(places.empty()) << z << " " << fix.latitude_deg << " " << fix.longitude_deg;
      EXPECT_LT(ErrorM(places[0], pose), 0.05);
      EXPECT_TRUE(places[0].is_near_fix || !(fix == FixAt(20, z - 20)));
    }
  }
}

TEST(PlaceSearch, TellsOfAllPlacesThatExplainAFrame) {
  const Street street = WithRepeatedFacades(MakeStreet(8, 160), 0, 160, 40);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 100), kMapFromWorld));
  PlaceSearch search(map, TheVocabulary());
  for (const double z : {43.0, 57.0}) {
    const Rigid3 pose{Eigen::Quaterniond::Identity(), {0.5, 0, z}};
    const auto places = SearchOnce(search, SeeStreet(street, kStreetRig, pose, kNoise));
    ASSERT_GE(places.size(), 2u);
    EXPECT_GE(2 * places[1].inliers.size(), places[0].inliers.size());
    const bool is_told = std::any_of(places.begin(), places.end(),
                                     [&](const auto& place) { return ErrorM(place, pose) < 0.1; });
    EXPECT_TRUE(is_told);
    for (const PlaceHypothesis& place : places) {  // the others are off by whole periods
      EXPECT_LT(std::abs(std::remainder(ErrorM(place, pose), 40)), 0.2);
    }
  }
}

TEST(PlaceSearch, FindsTheRightOneOfHousesOfOneKind) {
  for (const double period_m : {4.0, 30.0}) {
    const Street street = WithRepeatedFacades(MakeStreet(8, 200), 0, 200, period_m, 0.4);
    const ReconstructedMap map =
        Reconstruct(MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 150), kMapFromWorld));
    PlaceSearch search(map, TheVocabulary());
    for (const Rigid3& pose : DriveAlong(1, 3, 140, 11)) {
      search.Forget();
      const auto places = SearchOnce(search, SeeStreet(street, kStreetRig, pose, kNoise));
      ASSERT_FALSE(places.empty()) << period_m << " " << pose.translation.z();
      EXPECT_LT(ErrorM(places[0], pose), 0.1) << period_m << " " << pose.translation.z();
    }
  }
}

TEST_F(PlaceSearchTest, FindsFramesInMapsOfAnotherScale) {
  for (const double scale : {0.997, 1.001, 1.003}) {
    const ReconstructedMap map = Reconstruct(Scaled(lean_, scale));
    PlaceSearch search(map, TheVocabulary());
    for (const Rigid3& pose : DriveAlong(0, 2, 200, 17)) {
      const auto places = SearchOnce(search, SeeStreet(street_, kStreetRig, pose, kNoise));
      ASSERT_FALSE(places.empty()) << scale;
      const Eigen::Vector3d there = scale * (kMapFromWorld * pose).translation;
      EXPECT_LT((places[0].camera_from_map.Inverse().translation - there).norm(), 0.1) << scale;
    }
  }
}

TEST_F(PlaceSearchTest, FindsNothingElsewhere) {
  const Street other = MakeStreet(99, 260);
  PlaceSearch search(map_, TheVocabulary());
  for (const Rigid3& pose : DriveAlong(0, 2, 200, 10)) {
    EXPECT_THAT(SearchOnce(search, SeeStreet(other, kStreetRig, pose)), IsEmpty());
    EXPECT_THAT(SearchOnce(search, SeeStreet(other, kStreetRig, pose), FixAt(0, 50)), IsEmpty());
  }
}

TEST_F(PlaceSearchTest, TakesEmptyMapsAndFrames) {
  const auto features = SeeStreet(street_, kStreetRig, DriveAlong(0, 30, 30)[0]);
  const ReconstructedMap nothing = Reconstruct(LeanMap());
  PlaceSearch in_nothing(nothing, TheVocabulary());
  EXPECT_THAT(SearchOnce(in_nothing, features), IsEmpty());
  LeanMap bare = lean_;
  bare.landmarks.clear();
  const ReconstructedMap bare_map = Reconstruct(bare);
  PlaceSearch in_bare(bare_map, TheVocabulary());
  EXPECT_THAT(SearchOnce(in_bare, features, FixAt(0, 30)), IsEmpty());
  PlaceSearch search(map_, TheVocabulary());
  EXPECT_THAT(SearchOnce(search, {}, FixAt(0, 30)), IsEmpty());
  EXPECT_THAT(SearchOnce(search, features, FixAt(0, 30)), SizeIs(1));
}

/// `count` other places that show what the frame shows, but in disorder.
LeanMap WithDecoys(const LeanMap& map, const std::vector<Feature>& frame, int count) {
  LeanMap decoyed = map;
  StreetRandom random(4);
  for (int n = 1; n <= count; ++n) {
    const auto first_keyframe = static_cast<uint32_t>(decoyed.keyframes.size());
    for (LeanKeyframe keyframe : map.keyframes) {
      keyframe.id.index = static_cast<uint32_t>(3 * decoyed.keyframes.size());
      keyframe.map_from_camera.translation.x() += 500 * n;
      decoyed.keyframes.push_back(keyframe);
    }
    for (LeanLandmark landmark : map.landmarks) {
      landmark.id.index = static_cast<uint32_t>(decoyed.landmarks.size());
      landmark.descriptor = frame[random.Bits() % frame.size()].descriptor;
      landmark.position_in_map.x() += 500 * n;
      for (uint32_t& idx : landmark.keyframe_idxs) idx += first_keyframe;
      landmark.anchor_idx += first_keyframe;
      decoyed.landmarks.push_back(landmark);
    }
  }
  return decoyed;
}

TEST(PlaceSearch, TriesOtherPlacesFrameAfterFrame) {
  const Street street = MakeStreet(3, 60);
  const Rigid3 pose{Eigen::Quaterniond::Identity(), {0, 0, 5}};
  const auto features = SeeStreet(street, kStreetRig, pose, {.descriptor_bits = 22});
  const ReconstructedMap map = Reconstruct(WithDecoys(
      MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 10), kMapFromWorld), features, 10));
  PlaceSearchOptions options;
  options.max_tries = 2;
  options.resting_searches = 50;
  PlaceSearch search(map, TheVocabulary(), options);
  int searches = 0;
  std::vector<PlaceHypothesis> places;
  for (; searches < 12 && places.empty(); ++searches) places = SearchOnce(search, features);
  ASSERT_FALSE(places.empty());
  EXPECT_GT(searches, 5);  // all decoys resemble the frame more
  EXPECT_LT(ErrorM(places[0], pose), 0.1);
  EXPECT_FALSE(SearchOnce(search, features).empty());
  search.Forget();
  EXPECT_TRUE(SearchOnce(search, features).empty());
}

TEST_F(PlaceSearchTest, IsDeterministic) {
  const auto features = SeeStreet(street_, kStreetRig, DriveAlong(1, 77, 77)[0], kNoise);
  PlaceSearch a(map_, TheVocabulary()), b(map_, TheVocabulary());
  const auto of_a = SearchOnce(a, features), of_b = SearchOnce(b, features);
  ASSERT_THAT(of_a, SizeIs(of_b.size()));
  for (size_t i = 0; i < of_a.size(); ++i) {
    EXPECT_EQ(of_a[i].camera_from_map.translation, of_b[i].camera_from_map.translation);
    EXPECT_EQ(of_a[i].inliers.size(), of_b[i].inliers.size());
  }
}

TEST_F(PlaceSearchTest, PlacesAreKeyframesSideBySide) {
  const PlaceIndex index(map_, TheVocabulary(), {.radius_m = 6, .max_keyframes = 4});
  ASSERT_GT(index.size(), 210 / 14u);
  ASSERT_LT(index.size(), 210 / 4u);
  for (uint32_t i = 0; i < map_.snapshot.keyframes.size(); ++i) {
    const uint32_t center = index.CenterOf(index.PlaceOf(i));
    EXPECT_LE((map_.snapshot.keyframes[i].map_from_camera.translation -
               map_.snapshot.keyframes[center].map_from_camera.translation)
                  .norm(),
              6);
  }
  const std::vector<Feature> features = ViewFrom(map_, 100, 0).features;
  const auto similar = index.FindSimilar(index.HistogramOfFrame(features), 3);
  ASSERT_THAT(similar, SizeIs(3));
  EXPECT_EQ(similar[0].place_idx, index.PlaceOf(100));
  EXPECT_GE(similar[0].similarity, similar[1].similarity);
}

TEST_F(PlaceSearchTest, SizedFeaturesMatchWhatIsOfTheSameSizeOnly) {
  const auto features = SeeStreet(street_, kStreetRig, DriveAlong(2, 50, 50)[0]);
  const SizedFeatures sized(features, kStreetRig);
  size_t comparisons = 0;
  const auto all = AllLandmarks(map_.snapshot);
  const auto matches = sized.Match(map_.snapshot, all, {}, comparisons);
  EXPECT_GT(matches.size(), features.size() / 2);
  for (const LandmarkMatch& match : matches) {
    EXPECT_EQ(map_.snapshot.landmarks[match.landmark_idx].descriptor,
              features[match.feature_idx].descriptor);
  }
  EXPECT_GT(comparisons, 0u);
  EXPECT_LT(comparisons, all.size() * features.size());
  auto nearer = features;  // and so smaller than the landmarks
  for (Feature& feature : nearer) feature.disparity_px *= 3;
  EXPECT_THAT(SizedFeatures(nearer, kStreetRig).Match(map_.snapshot, all, {}, comparisons),
              IsEmpty());
}

}  // namespace
}  // namespace carmap
