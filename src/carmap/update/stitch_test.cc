#include "carmap/update/stitch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <ctime>
#include <numeric>
#include <set>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/localize/map_neighbourhood.h"
#include "carmap/localize/place_search.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;

const Rigid3 kBaseFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};
const Rigid3 kSegmentFromWorld{RotationExp({-0.02, 1.9, 0.03}), {-400, 5, 60}};
const StreetNoise kNoise{.pixel_px = 0.5, .descriptor_bits = 5};

LeanMap BaseMap(const Street& street, const StreetNoise& noise = {}) {
  return MapStreet(street, {500}, kStreetRig, DriveAlong(0, 0, 70), kBaseFromWorld, noise);
}

/// Of a street whose part beyond 80 m lies that much further on; driven up to `before_m` and from
/// 80 to 140 m of that part.
LeanMap TornBaseMap(Street street, double before_m, double shift_m) {
  for (Street::Corner& corner : street.corners) {
    if (corner.p_in_world.z() > 80) corner.p_in_world.z() += shift_m;
  }
  auto poses = DriveAlong(0, 0, before_m);
  for (const Rigid3& pose : DriveAlong(0, 80 + shift_m, 140 + shift_m)) poses.push_back(pose);
  return MapStreet(street, {500}, kStreetRig, poses, kBaseFromWorld);
}

LeanMap Segment(const Street& street, double lane_m, double from_m, double to_m, DriveId id = {900},
                const StreetNoise& noise = {}) {
  return MapStreet(street, id, kStreetRig, DriveAlong(lane_m, from_m, to_m), kSegmentFromWorld,
                   noise);
}

/// Between where the merged map has keyframes of the segment and where they are, at most.
double LargestErrorM(const StitchedMap& stitched, const std::vector<Rigid3>& world_from_camera,
                     DriveId segment = {900}) {
  double largest_m = 0;
  for (const LeanKeyframe& keyframe : stitched.map.keyframes) {
    if (keyframe.id.drive != segment) continue;
    const Rigid3 truth = kBaseFromWorld * world_from_camera[keyframe.id.index / 3];
    largest_m =
        std::max(largest_m, (keyframe.map_from_camera.translation - truth.translation).norm());
  }
  return largest_m;
}

/// With fixes that are off by `east_m`; without noise.
LeanMap WithGps(LeanMap map, const Rigid3& map_from_world, double east_m = 0) {
  const LocalEnu enu({49, 8.4, 110});
  for (LeanKeyframe& keyframe : map.keyframes) {
    const Eigen::Vector3d p = map_from_world.Inverse() * keyframe.map_from_camera.translation;
    keyframe.gps = enu.ToGps({p.x() + east_m, p.z(), 0});
  }
  return map;
}

void ExpectIdentical(const LeanMap& a, const LeanMap& b) {
  ASSERT_EQ(a.keyframes.size(), b.keyframes.size());
  ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
  for (size_t i = 0; i < a.keyframes.size(); ++i) {
    EXPECT_EQ(a.keyframes[i].id, b.keyframes[i].id);
    EXPECT_EQ(a.keyframes[i].map_from_camera.translation,
              b.keyframes[i].map_from_camera.translation);
    EXPECT_EQ(a.keyframes[i].map_from_camera.rotation.coeffs(),
              b.keyframes[i].map_from_camera.rotation.coeffs());
  }
  for (size_t i = 0; i < a.landmarks.size(); ++i) {
    EXPECT_EQ(a.landmarks[i].id, b.landmarks[i].id);
    EXPECT_EQ(a.landmarks[i].position_in_map, b.landmarks[i].position_in_map);
    EXPECT_EQ(a.landmarks[i].keyframe_idxs, b.landmarks[i].keyframe_idxs);
    EXPECT_EQ(a.landmarks[i].anchor_idx, b.landmarks[i].anchor_idx);
    EXPECT_EQ(a.landmarks[i].anchor_level, b.landmarks[i].anchor_level);
  }
}

TEST(Stitch, PutsKeyframesRightToAMillimetreWithoutNoise) {
  const Street street = MakeStreet(3, 170);
  for (const double lane_m : {0.0, 3.0, -2.0}) {
    const auto stitched = Stitch(BaseMap(street), Segment(street, lane_m, 45, 120));
    ASSERT_TRUE(stitched.ok()) << stitched.status();
    ASSERT_TRUE(CheckConsistency(stitched->map).ok());
    for (const LeanKeyframe& keyframe : stitched->map.keyframes) {
      const double lane = keyframe.id.drive == DriveId{900} ? lane_m : 0;
      const auto poses =
          keyframe.id.drive == DriveId{900} ? DriveAlong(lane, 45, 120) : DriveAlong(lane, 0, 70);
      const Rigid3 truth = kBaseFromWorld * poses[keyframe.id.index / 3];
      EXPECT_LT((keyframe.map_from_camera.translation - truth.translation).norm(), 1e-3);
    }
  }
}

TEST(Stitch, RemovesLandmarksThatBothMapsHold) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = BaseMap(street), segment = Segment(street, 3, 45, 120);
  const auto stitched = Stitch(base, segment);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  std::set<Descriptor> corners;  // unique without noise
  for (const LeanLandmark& landmark : base.landmarks) corners.insert(landmark.descriptor);
  size_t shared = 0;
  for (const LeanLandmark& landmark : segment.landmarks) {
    shared += !corners.insert(landmark.descriptor).second;
  }
  const FitReport& report = stitched->report;
  EXPECT_GT(shared, 100u);
  EXPECT_LE(report.inliers, shared);
  EXPECT_GE(static_cast<double>(report.inliers), 0.95 * static_cast<double>(shared));
  EXPECT_EQ(stitched->map.landmarks.size(),
            base.landmarks.size() + segment.landmarks.size() - report.inliers);
  EXPECT_LT(report.median_distance_m, 1e-3);

  // A landmark of both maps is the base's, seen by keyframes of both.
  size_t seen_by_both = 0;
  for (const LeanLandmark& landmark : stitched->map.landmarks) {
    std::set<DriveId> drives;
    for (const uint32_t idx : landmark.keyframe_idxs) {
      drives.insert(stitched->map.keyframes[idx].id.drive);
    }
    if (drives.size() < 2) continue;
    ++seen_by_both;
    EXPECT_EQ(landmark.id.drive, DriveId{500});
  }
  EXPECT_EQ(seen_by_both, report.inliers);
}

TEST(Stitch, KeepsTheScaleOfALandmarkWhoseAnchorHasAStandIn) {
  const Street street = MakeStreet(3, 170);
  const LeanMap segment = Segment(street, 1, 45, 120);
  const auto stitched = Stitch(BaseMap(street), segment);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  const auto level_at_1m = [](const LeanMap& map, const LeanLandmark& landmark) {
    return landmark.anchor_level +
           std::log(PositionInAnchor(map, landmark).norm()) / std::log(kLevelScale);
  };
  size_t checked = 0;
  for (const LeanLandmark& landmark : stitched->map.landmarks) {
    const LeanKeyframe& anchor = stitched->map.keyframes[landmark.anchor_idx];
    if (landmark.id.drive == anchor.id.drive) continue;
    const auto same = std::find_if(
        segment.landmarks.begin(), segment.landmarks.end(),
        [&](const LeanLandmark& other) { return other.descriptor == landmark.descriptor; });
    ASSERT_NE(same, segment.landmarks.end());
    EXPECT_NEAR(level_at_1m(stitched->map, landmark), level_at_1m(segment, *same), 0.51);
    ++checked;
  }
  EXPECT_GT(checked, 10u);
}

TEST(Stitch, PlacesANoisySegmentOfTheNextLaneAndLocalizesInTheResult) {
  const Street street = MakeStreet(4, 170);
  const auto stitched = Stitch(BaseMap(street, kNoise), Segment(street, 3, 45, 120, {900}, kNoise));
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  EXPECT_LT(LargestErrorM(*stitched, DriveAlong(3, 45, 120)), 0.1);

  const ReconstructedMap map = Reconstruct(stitched->map);
  PlaceSearch search(map, {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()});
  int n = 0;
  for (const Rigid3& world_from_camera : DriveAlong(1, 3, 110, 1.1)) {
    const auto features = SeeStreet(street, kStreetRig, world_from_camera, kNoise, n + 1);
    const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
    const auto places = search.Search(grid, kStreetRig, std::nullopt);
    ASSERT_FALSE(places.empty()) << n;
    const Rigid3 truth = kBaseFromWorld * world_from_camera;
    const Eigen::Vector3d center = places.front().camera_from_map.Inverse().translation;
    EXPECT_LT((center - truth.translation).norm(), 0.1) << n;
    ++n;
  }
}

TEST(Stitch, RefusesASegmentThatDoesNotOverlap) {
  const Street street = MakeStreet(3, 300);
  for (const LeanMap& segment :
       {Segment(street, 0, 180, 250), Segment(MakeStreet(77, 170), 0, 45, 120)}) {
    const auto stitched = Stitch(BaseMap(street), segment);
    ASSERT_EQ(stitched.status().code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(std::string(stitched.status().message()), HasSubstr("does not overlap"));
  }
}

// A receiver may be wrong by any distance; what the segment shows tells where it lies.
TEST(Stitch, JoinsASegmentWhoseGpsIsElsewhere) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = WithGps(BaseMap(street), kBaseFromWorld);
  for (const double east_m : {10.0, 60.0, 2000.0}) {
    const auto stitched =
        Stitch(base, WithGps(Segment(street, 0, 45, 120), kSegmentFromWorld, east_m));
    ASSERT_TRUE(stitched.ok()) << stitched.status();
    EXPECT_LT(LargestErrorM(*stitched, DriveAlong(0, 45, 120)), 0.01) << east_m;
  }
}

TEST(Stitch, FindsTheOverlapByAppearanceAlone) {
  StitchOptions by_appearance;
  by_appearance.fit.locator.by_appearance = true;
  const Street street = MakeStreet(3, 170);
  LeanMap base = BaseMap(street), segment = Segment(street, 0, 45, 120);
  // Fixes that are wrong by kilometres do not matter.
  const LocalEnu enu({49, 8.4, 110});
  for (LeanKeyframe& keyframe : base.keyframes) keyframe.gps = enu.ToGps({0, 0, 0});
  for (LeanKeyframe& keyframe : segment.keyframes) keyframe.gps = enu.ToGps({5000, 0, 0});
  const auto stitched = Stitch(base, segment, by_appearance);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  EXPECT_LT(LargestErrorM(*stitched, DriveAlong(0, 45, 120)), 0.01);
  EXPECT_FALSE(Stitch(base, Segment(MakeStreet(77, 170), 0, 45, 120), by_appearance).ok());
}

// The base map holds one half of the segment's street here, the other elsewhere.
TEST(Stitch, RefusesASegmentThatFitsInTwoPlaces) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = TornBaseMap(street, 60, 200);
  const auto stitched = Stitch(base, Segment(street, 0, 0, 130));
  ASSERT_EQ(stitched.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(stitched.status().message()), HasSubstr("in two places"));
}

struct Stretch {
  double from_m, to_m;
};

LeanMap MapStretch(const Street& street, DriveId drive, const Stretch& stretch) {
  return MapStreet(street, drive, kStreetRig, DriveAlong(0, stretch.from_m, stretch.to_m),
                   drive == DriveId{500} ? kBaseFromWorld : kSegmentFromWorld, kNoise);
}

// Windows every 4 m, houses every 30 m, in the middle of a street; each period is the same but for
// a share of its corners.
TEST(Stitch, FindsTheRightOneOfHousesOfOneKind) {
  for (const double period_m : {4.0, 30.0}) {
    for (const double own_share : {0.2, 0.6}) {
      const Street street = WithRepeatedFacades(MakeStreet(8, 280), 60, 180, period_m, own_share);
      const LeanMap base = MapStretch(street, {500}, {0, 150});
      for (const Stretch& stretch : {Stretch{90, 150}, {90, 230}}) {
        const auto stitched = Stitch(base, MapStretch(street, {900}, stretch));
        if (own_share < 0.5 && !stitched.ok()) {  // which may be too little to tell them apart
          EXPECT_THAT(std::string(stitched.status().message()), HasSubstr("in two places"));
          continue;
        }
        ASSERT_TRUE(stitched.ok()) << period_m << " " << own_share << " " << stitched.status();
        EXPECT_LT(LargestErrorM(*stitched, DriveAlong(0, stretch.from_m, stretch.to_m)), 0.1)
            << period_m << " " << own_share;
      }
    }
  }
}

// Both hold the street beyond the houses at one end only, so that other periods fit as well.
TEST(Stitch, RefusesHousesThatAreAllTheSame) {
  for (const double period_m : {15.0, 30.0}) {
    const Street street = WithRepeatedFacades(MakeStreet(8, 280), 60, 180, period_m);
    const LeanMap base = MapStretch(street, {500}, {0, 150});
    for (const Stretch& stretch : {Stretch{90, 150}, {90, 230}}) {
      const auto stitched = Stitch(base, MapStretch(street, {900}, stretch));
      ASSERT_EQ(stitched.status().code(), absl::StatusCode::kFailedPrecondition);
      EXPECT_THAT(std::string(stitched.status().message()), HasSubstr("in two places"));
    }
  }
}

TEST(Stitch, KnowsHousesThatAreAllTheSameByWhatIsBeyondThemOrByGps) {
  const Street street = WithRepeatedFacades(MakeStreet(8, 280), 60, 120, 30);
  const LeanMap base = MapStretch(street, {500}, {0, 180});
  const auto beyond = Stitch(base, MapStretch(street, {900}, {40, 200}));
  ASSERT_TRUE(beyond.ok()) << beyond.status();
  EXPECT_LT(LargestErrorM(*beyond, DriveAlong(0, 40, 200)), 0.05);

  const Street twice = WithRepeatedFacades(MakeStreet(8, 320), 0, 320, 80);
  const LeanMap base_of_twice = MapStretch(twice, {500}, {0, 180});
  const LeanMap segment_of_twice = MapStretch(twice, {900}, {85, 250});
  EXPECT_FALSE(Stitch(base_of_twice, segment_of_twice).ok());
  const auto by_gps = Stitch(WithGps(base_of_twice, kBaseFromWorld),
                             WithGps(segment_of_twice, kSegmentFromWorld, 5));
  ASSERT_TRUE(by_gps.ok()) << by_gps.status();
  EXPECT_LT(LargestErrorM(*by_gps, DriveAlong(0, 85, 250)), 0.05);
}

/// Two drives along a road that turns and climbs, the second in a lane of its own.
struct WindingRoad {
  explicit WindingRoad(double length_m)
      : winding(length_m + 60),
        street(Wound(MakeStreet(3, length_m + 50, 12), winding)),
        base_poses(Wound(DriveAlong(0, 0, length_m), winding)),
        segment_poses(Wound(DriveAlong(3, 0, length_m), winding)),
        base(MapStreet(street, {500}, kStreetRig, base_poses, kBaseFromWorld, kRoadNoise)),
        segment(
            MapStreet(street, {900}, kStreetRig, segment_poses, kSegmentFromWorld, kRoadNoise)) {}

  static constexpr StreetNoise kRoadNoise{.pixel_px = 0.25, .descriptor_bits = 5};
  Winding winding;
  Street street;
  std::vector<Rigid3> base_poses, segment_poses;
  LeanMap base, segment;
};

constexpr int kSameCornerBits = 30;  // corners of the street are drawn by lot

/// Landmarks of the segment that the base has too.
size_t CountShared(const LeanMap& base, const LeanMap& segment) {
  return static_cast<size_t>(std::count_if(
      segment.landmarks.begin(), segment.landmarks.end(), [&](const LeanLandmark& landmark) {
        return std::any_of(
            base.landmarks.begin(), base.landmarks.end(), [&](const LeanLandmark& other) {
              return HammingDistance(landmark.descriptor, other.descriptor) <= kSameCornerBits;
            });
      }));
}

// Lengths of two maps differ by some tenths of a percent; a rigid move leaves metres of that.
TEST(Stitch, BendsASegmentOfAnotherScale) {
  const WindingRoad road(400);
  const auto shared = static_cast<double>(CountShared(road.base, road.segment));
  for (const double difference : {0.0, 0.001, 0.005, -0.005}) {
    const auto stitched = Stitch(road.base, Scaled(road.segment, 1 + difference));
    ASSERT_TRUE(stitched.ok()) << difference << " " << stitched.status();
    EXPECT_LT(LargestErrorM(*stitched, road.segment_poses), 0.06) << difference;
    EXPECT_NEAR(stitched->report.scale, 1 - difference, 3e-4);
    EXPECT_LT(stitched->report.median_misfit_m, 0.06);
    EXPECT_GE(static_cast<double>(stitched->report.inliers), 0.9 * shared) << difference;
  }
}

TEST(Stitch, BendsASegmentThatDrifted) {
  const WindingRoad road(400);
  const auto stitched = Stitch(road.base, Drifted(road.segment, 1.003, 3e-4, 7));
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  EXPECT_LT(LargestErrorM(*stitched, road.segment_poses), 0.2);
}

// The base knows the road's beginning and end; over 200 m between them the segment drifts by 2 m.
TEST(Stitch, TiesTheSegmentWhereItComesBackToTheBase) {
  const WindingRoad road(400);
  std::vector<Rigid3> known;
  for (size_t i = 0; i < road.base_poses.size(); ++i) {
    const double z = 1.5 * static_cast<double>(i);
    if (z < 100 || z > 300) known.push_back(road.base_poses[i]);
  }
  const LeanMap base = MapStreet(road.street, {500}, kStreetRig, known, kBaseFromWorld);
  const LeanMap segment = Drifted(road.segment, 1.01, 3e-4, 7);
  const auto stitched = Stitch(base, segment);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  for (const LeanKeyframe& keyframe : stitched->map.keyframes) {
    if (keyframe.id.drive != DriveId{900}) continue;
    const size_t i = keyframe.id.index / 3;
    const double z = 1.5 * static_cast<double>(i);
    const Rigid3 truth = kBaseFromWorld * road.segment_poses[i];
    const bool is_known = z < 100 || z > 300;
    EXPECT_LT((keyframe.map_from_camera.translation - truth.translation).norm(),
              is_known ? 0.2 : 1.5)
        << z;
  }
}

// A base that jumps by 3 m, as after frames that were lost.
TEST(Stitch, RefusesABaseThatContradictsTheSegment) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = TornBaseMap(street, 75, 3);
  const auto stitched = Stitch(base, Segment(street, 0, 0, 130));
  ASSERT_EQ(stitched.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(stitched.status().message()), HasSubstr("contradicts the base map"));
}

// What two drives measured is better known than what one did.
TEST(Stitch, PlacesALandmarkOfBothBetterThanOneDriveDid) {
  const WindingRoad road(200);
  const auto stitched = Stitch(road.base, road.segment);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  const auto square_error_of = [&](const LeanLandmark& landmark) {
    const auto corner = std::find_if(
        road.street.corners.begin(), road.street.corners.end(), [&](const Street::Corner& other) {
          return HammingDistance(landmark.descriptor, other.descriptor) <= kSameCornerBits;
        });
    return (landmark.position_in_map - kBaseFromWorld * corner->p_in_world).squaredNorm();
  };
  double before = 0, after = 0;
  for (const LeanLandmark& landmark : stitched->map.landmarks) {
    const auto in_base =
        std::find_if(road.base.landmarks.begin(), road.base.landmarks.end(),
                     [&](const LeanLandmark& other) { return other.id == landmark.id; });
    if (in_base == road.base.landmarks.end() ||
        in_base->position_in_map == landmark.position_in_map) {
      continue;
    }
    before += square_error_of(*in_base);
    after += square_error_of(landmark);
  }
  EXPECT_GT(before, 0);
  EXPECT_LT(after, 0.7 * before);
}

TEST(Stitch, DoesNotMindClocksThatAreHoursApart) {
  const Street street = MakeStreet(4, 170);
  const LeanMap base = BaseMap(street, kNoise);
  const auto same_clock = Stitch(base, Segment(street, 3, 45, 120, {900}, kNoise));
  ASSERT_TRUE(same_clock.ok()) << same_clock.status();
  for (const double start_s : {-3 * 3600.0, 5 * 3600.0, 1.7e9}) {
    const auto stitched = Stitch(base, MapStreet(street, {900}, kStreetRig, DriveAlong(3, 45, 120),
                                                 kSegmentFromWorld, kNoise, start_s));
    ASSERT_TRUE(stitched.ok()) << stitched.status();
    ExpectIdentical(stitched->map, same_clock->map);
    EXPECT_EQ(stitched->map.keyframes.front().timestamp, base.keyframes.front().timestamp);
    EXPECT_NEAR(stitched->map.keyframes.back().timestamp.seconds(), start_s + 50 * 0.3, 1e-3);
  }
}

TEST(Stitch, RefusesADriveThatIsThereAlready) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = BaseMap(street), segment = Segment(street, 0, 45, 120);
  EXPECT_EQ(Stitch(base, base).status().code(), absl::StatusCode::kAlreadyExists);
  const auto stitched = Stitch(base, segment);
  ASSERT_TRUE(stitched.ok());
  EXPECT_EQ(Stitch(stitched->map, segment).status().code(), absl::StatusCode::kAlreadyExists);
}

TEST(Stitch, MergesTwoDrivesOfTheSameRoadIntoOneSetOfLandmarks) {
  const Street street = MakeStreet(3, 120);
  const LeanMap base = BaseMap(street);
  const LeanMap same = MapStreet(street, {501}, kStreetRig, DriveAlong(0, 0, 70), kBaseFromWorld);
  const auto stitched = Stitch(base, same);
  ASSERT_TRUE(stitched.ok()) << stitched.status();
  EXPECT_LT(stitched->map.landmarks.size(), 1.05 * static_cast<double>(base.landmarks.size()));
  EXPECT_NEAR(stitched->report.scale, 1, 1e-5);
}

// The map grows with the road, not with the driving.
TEST(Stitch, KeepsKeyframesOnlyWhereTheBaseHasNone) {
  const Street street = MakeStreet(4, 170);
  LeanMap map = BaseMap(street, kNoise);
  const size_t base_keyframes = map.keyframes.size();
  for (const uint64_t drive : {901, 902, 903}) {
    const auto stitched = Stitch(map, Segment(street, 0.5, 20, 60, {drive}, kNoise));
    ASSERT_TRUE(stitched.ok()) << stitched.status();
    EXPECT_EQ(stitched->keyframes_added, 0u);
    map = stitched->map;
  }
  EXPECT_EQ(map.keyframes.size(), base_keyframes);
  EXPECT_EQ(map.drives.size(), 4u);

  const auto next_lane = Stitch(map, Segment(street, 3, 20, 60, {904}, kNoise));
  ASSERT_TRUE(next_lane.ok()) << next_lane.status();
  EXPECT_EQ(next_lane->keyframes_added, 27u);

  // A camera recognises landmarks at the levels that the lists of keyframes tell.
  const Rigid3 pose = DriveAlong(1, 40, 40)[0];
  const auto features = SeeStreet(street, kStreetRig, pose, kNoise);
  const FeatureGrid grid(features, kStreetRig.camera.width, kStreetRig.camera.height);
  const auto count_inliers = [&](const LeanMap& lean) {
    const ReconstructedMap rebuilt = Reconstruct(lean);
    const Rigid3 base_from_camera = kBaseFromWorld * pose;
    const auto tracked =
        TrackByProjection(rebuilt.snapshot, LandmarksAround(rebuilt, base_from_camera), grid,
                          kStreetRig, base_from_camera.Inverse(), {});
    return tracked ? tracked->inliers.size() : 0;
  };
  EXPECT_GE(count_inliers(next_lane->map), count_inliers(BaseMap(street, kNoise)));
}

TEST(Stitch, TakesDegenerateMaps) {
  const Street street = MakeStreet(3, 170);
  const LeanMap base = BaseMap(street), segment = Segment(street, 0, 45, 120);
  const auto first = Stitch(LeanMap(), segment);
  ASSERT_TRUE(first.ok());
  ExpectIdentical(first->map, segment);

  LeanMap bare = segment;
  bare.landmarks.clear();
  EXPECT_EQ(Stitch(base, bare).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(Stitch(base, LeanMap()).status().code(), absl::StatusCode::kFailedPrecondition);
  LeanMap bare_base = base;
  bare_base.landmarks.clear();
  EXPECT_EQ(Stitch(bare_base, segment).status().code(), absl::StatusCode::kNotFound);

  LeanMap single = segment;
  single.keyframes.resize(1);
  std::erase_if(single.landmarks,
                [](const LeanLandmark& landmark) { return landmark.keyframe_idxs.front() != 0; });
  for (LeanLandmark& landmark : single.landmarks) {
    landmark.keyframe_idxs = {0};
    landmark.anchor_idx = 0;
  }
  EXPECT_EQ(Stitch(base, single).status().code(), absl::StatusCode::kNotFound);

  LeanMap broken = segment;
  broken.landmarks[3].keyframe_idxs = {9999};
  EXPECT_EQ(Stitch(base, broken).status().code(), absl::StatusCode::kInvalidArgument);
}

/// Keyframes at one place that all see the same landmarks.
LeanMap CrowdedMap(DriveId drive, uint32_t keyframe_count, uint32_t landmark_count) {
  StreetRandom random(8);
  LeanMap map;
  map.drives = {{drive, kStreetRig}};
  for (uint32_t k = 0; k < keyframe_count; ++k) {
    LeanKeyframe& keyframe = map.keyframes.emplace_back();
    keyframe.id = {drive, k};
    keyframe.map_from_camera.translation.x() = random.Uniform(0, 0.01);
  }
  for (uint32_t i = 0; i < landmark_count; ++i) {
    LeanLandmark& landmark = map.landmarks.emplace_back();
    landmark.id = {drive, i};
    landmark.descriptor = random.RandomDescriptor();
    landmark.position_in_map = {random.Uniform(-8, 8), random.Uniform(-3, 3), 20};
    landmark.keyframe_idxs.resize(keyframe_count);
    std::iota(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(), 0u);
  }
  return map;
}

// Four times the keyframes take four times as long, though sixteen times as many pairs of them see
// the same; half as much again is allowed for chance.
TEST(Stitch, TakesTimeInProportionToTheMaps) {
  const auto time_of = [](uint32_t keyframe_count) {
    const LeanMap base = CrowdedMap({500}, keyframe_count, 60),
                  segment = CrowdedMap({900}, keyframe_count, 60);
    const std::clock_t start = std::clock();  // of this process, whatever else runs
    const auto stitched = Stitch(base, segment);
    EXPECT_TRUE(stitched.ok()) << stitched.status();
    return static_cast<double>(std::clock() - start);
  };
  const double quarter = time_of(2'000);
  EXPECT_LT(time_of(8'000), 6 * quarter);
}

TEST(Stitch, IsDeterministic) {
  const Street street = MakeStreet(4, 170);
  const LeanMap base = BaseMap(street, kNoise);
  const LeanMap segment = Segment(street, 3, 45, 120, {900}, kNoise);
  const auto a = Stitch(base, segment), b = Stitch(base, segment);
  ASSERT_TRUE(a.ok() && b.ok());
  ExpectIdentical(a->map, b->map);
}

}  // namespace
}  // namespace carmap
