#include "carmap/slam/tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <set>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr DriveId kDrive{7};

/// A tracker, and the local map of the first keyframes of a drive in steps of 0.5 m.
class TrackerTest : public ::testing::Test {
 protected:
  TrackerTest() : mapper_(kStreetRig, kDrive, {}) { InsertKeyframe(0); }

  std::vector<Feature> See(size_t n) const { return SeeStreet(street_, kStreetRig, poses_.at(n)); }
  Rigid3 Truth(size_t n) const { return poses_.front().Inverse() * poses_.at(n); }
  static Timestamp TimeOf(size_t n) { return Timestamp::FromSeconds(0.1 * static_cast<double>(n)); }

  void InsertKeyframe(size_t n) {
    local_ = mapper_.Insert({{.id = {kDrive, static_cast<uint32_t>(n)},
                              .timestamp = TimeOf(n),
                              .map_from_camera = Truth(n),
                              .features = std::make_shared<const std::vector<Feature>>(See(n))},
                             {}});
  }
  TrackedFrame Track(size_t n) { return tracker_.Track(TimeOf(n), See(n), local_.get()); }
  void ExpectAt(const TrackedFrame& frame, size_t n, double tolerance = 1e-3) const {
    ASSERT_TRUE(frame.reference) << n << ": " << frame.lost_because;
    EXPECT_LT((frame.map_from_camera.translation - Truth(n).translation).norm(), tolerance) << n;
    EXPECT_THAT(frame.lost_because, IsEmpty());
    const Rigid3 reference = mapper_.map().Find(*frame.reference)->map_from_camera;
    const Rigid3 by_reference = reference * frame.camera_from_reference.Inverse();
    EXPECT_LT((by_reference.translation - frame.map_from_camera.translation).norm(), 1e-9);
  }

  const Street street_ = MakeStreet(4, 80);
  const std::vector<Rigid3> poses_ = DriveAlong(0, 0, 30, 0.5);
  LocalMapper mapper_;
  std::shared_ptr<const LocalMap> local_;
  Tracker tracker_{TrackerOptions()};
};

TEST_F(TrackerTest, WithoutAMapItAsksForOneWhereThereIsDepthEnough) {
  std::vector<Feature> features(150, {.disparity_px = 5});
  for (size_t i = 0; i < 51; ++i) features[i].disparity_px = Feature::kNoDisparity;
  TrackedFrame frame = tracker_.Track({}, features, nullptr);
  EXPECT_FALSE(frame.wants_keyframe);
  EXPECT_FALSE(frame.reference);
  EXPECT_THAT(frame.lost_because, HasSubstr("only 99 features with depth, 100 are needed"));
  features[0].disparity_px = 5;
  frame = tracker_.Track({}, features, nullptr);
  EXPECT_TRUE(frame.wants_keyframe);
  EXPECT_THAT(frame.lost_because, IsEmpty());
}

TEST_F(TrackerTest, FollowsADrive) {
  for (size_t n = 1; n < 30; ++n) {
    const TrackedFrame frame = Track(n);
    ExpectAt(frame, n);
    EXPECT_GT(frame.landmark_of_feature.size(), 50u) << n;
    std::set<LandmarkId> landmarks;
    for (const auto& [id, feature_idx] : frame.landmark_of_feature) {
      EXPECT_TRUE(landmarks.insert(id).second);
      EXPECT_EQ(mapper_.map().Find(id)->descriptor, See(n)[feature_idx].descriptor);
    }
    if (frame.wants_keyframe) InsertKeyframe(n);
  }
  EXPECT_GT(mapper_.map().keyframes().size(), 5u);
}

TEST_F(TrackerTest, AsksForAKeyframeAfterSoManyMetres) {
  Tracker patient({.max_keyframe_distance_m = 1.8, .min_tracked_ratio = 0, .min_tracked = 0});
  for (size_t n = 1; n < 6; ++n) {
    const TrackedFrame frame = patient.Track(TimeOf(n), See(n), local_.get());
    EXPECT_EQ(frame.wants_keyframe, n >= 4) << n;
  }
}

TEST_F(TrackerTest, AsksForAKeyframeWhenFewLandmarksAreLeft) {
  Tracker tracker({.max_keyframe_distance_m = 100, .max_keyframe_turn_rad = 10, .min_tracked = 0});
  EXPECT_FALSE(tracker.Track(TimeOf(1), See(1), local_.get()).wants_keyframe);
  std::vector<Feature> half = See(2);
  half.resize(half.size() / 2);
  EXPECT_TRUE(tracker.Track(TimeOf(2), half, local_.get()).wants_keyframe);
}

TEST_F(TrackerTest, SaysWhyAFrameIsLostAndGoesOn) {
  ExpectAt(Track(1), 1);
  ExpectAt(Track(2), 2);
  const TrackedFrame black = tracker_.Track(TimeOf(3), {}, local_.get());
  EXPECT_FALSE(black.reference);
  EXPECT_FALSE(black.wants_keyframe);
  EXPECT_THAT(black.lost_because, HasSubstr("only 0 features"));
  const auto strange = SeeStreet(MakeStreet(99, 80), kStreetRig, poses_[4]);
  EXPECT_THAT(tracker_.Track(TimeOf(4), strange, local_.get()).lost_because,
              HasSubstr("do not agree with the map"));
  ExpectAt(Track(5), 5);
}

TEST_F(TrackerTest, FindsItselfAgainFarFromThePrediction) {
  ExpectAt(Track(1), 1);
  ExpectAt(Track(9), 9);  // four metres on at once
}

TEST_F(TrackerTest, FollowsTheMapWhenItIsAdjusted) {
  ExpectAt(Track(1), 1);
  ExpectAt(Track(2), 2);
  // The whole map moves, as after an adjustment; the next frame is where the moved map says.
  const Rigid3 moved{RotationExp({0, 0.5, 0}), {10, 0, 5}};
  LocalMap local = *local_;
  for (SnapshotKeyframe& keyframe : local.snapshot.keyframes) {
    keyframe.map_from_camera = moved * keyframe.map_from_camera;
  }
  for (SnapshotLandmark& landmark : local.snapshot.landmarks) {
    landmark.position_in_map = moved * landmark.position_in_map;
    landmark.direction_to_viewers =
        (moved.rotation * landmark.direction_to_viewers.cast<double>()).cast<float>();
  }
  const TrackedFrame frame = tracker_.Track(TimeOf(3), See(3), &local);
  ASSERT_TRUE(frame.reference);
  EXPECT_LT((frame.map_from_camera.translation - (moved * Truth(3)).translation).norm(), 1e-3);
}

TEST_F(TrackerTest, IsDeterministic) {
  Tracker other{TrackerOptions()};
  for (size_t n = 1; n < 5; ++n) {
    const TrackedFrame a = Track(n), b = other.Track(TimeOf(n), See(n), local_.get());
    EXPECT_EQ(a.map_from_camera.translation, b.map_from_camera.translation);
    EXPECT_EQ(a.landmark_of_feature, b.landmark_of_feature);
  }
}

}  // namespace
}  // namespace carmap
