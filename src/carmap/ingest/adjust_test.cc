#include "carmap/ingest/adjust.h"

#include <cmath>
#include <map>

#include "carmap/ingest/revert.h"
#include "carmap/ingest/test_base.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

using ::testing::Gt;
using ::testing::IsEmpty;
using ::testing::Lt;
using ::testing::Not;

/// A street around a block, and drives along parts of it that take lengths for a little more or
/// less than they are.
class AdjustTest : public BaseTest {
 protected:
  static constexpr double kRadiusM = 60, kRoundM = 2 * M_PI * kRadiusM;

  static Rigid3 Section(double z) {
    const double angle = z / kRadiusM;
    return {RotationExp({0, angle, 0}),
            {kRadiusM * (1 - std::cos(angle)), 0, kRadiusM * std::sin(angle)}};
  }
  static Rigid3 OnRound(const Rigid3& pose) {
    Rigid3 in_section = pose;
    in_section.translation.z() = 0;
    return Section(pose.translation.z()) * in_section;
  }

  AdjustTest() : round_(MakeStreet(8, kRoundM)) {
    for (Street::Corner& corner : round_.corners) {
      const Eigen::Vector3d& p = corner.p_in_world;
      corner.p_in_world = Section(p.z()) * Eigen::Vector3d(p.x(), p.y(), 0);
    }
  }

  LeanMap Map(uint64_t id, double from_m, double to_m, double scale, bool has_gps = true,
              const Eigen::Vector3d& gps_error = {0, 0, 0}) {
    std::vector<Rigid3> poses = DriveAlong(0, from_m, to_m);
    for (Rigid3& pose : poses) pose = OnRound(pose);
    const Rigid3 map_from_street{RotationExp({0, 0.4 * static_cast<double>(id), 0}), {7, 0, -2}};
    LeanMap map =
        Scaled(MapStreet(round_, {id, 5}, kStreetRig, poses, map_from_street, kNoise), scale);
    for (size_t i = 0; i < poses.size(); ++i) {
      truth_[map.keyframes[i].id] = poses[i];
      if (!has_gps) continue;
      const Eigen::Vector3d place =
          EcefFromEnu(kHere).Inverse() * (EcefFromStreet() * poses[i].translation);
      map.keyframes[i].gps = LocalEnu(kHere).ToGps(place + gps_error);
    }
    return map;
  }

  /// Largest and mean error of one keyframe as seen from another so far away on the road, as a part
  /// of the way.
  struct RelativeError {
    double largest = 0, mean = 0;
  };
  RelativeError Relative(const LeanMap& map) const {
    constexpr double kWayM = 100, kToleranceM = 1;
    RelativeError error;
    size_t count = 0;
    for (const LeanKeyframe& a : map.keyframes) {
      for (const LeanKeyframe& b : map.keyframes) {
        const Rigid3 true_step = truth_.at(a.id).Inverse() * truth_.at(b.id);
        const double chord_m = 2 * kRadiusM * std::sin(kWayM / (2 * kRadiusM));
        if (std::abs(true_step.translation.norm() - chord_m) > kToleranceM) continue;
        const Rigid3 step = a.map_from_camera.Inverse() * b.map_from_camera;
        const double ratio = (step.translation - true_step.translation).norm() / kWayM;
        error.largest = std::max(error.largest, ratio);
        error.mean += ratio;
        ++count;
      }
    }
    error.mean /= static_cast<double>(count);
    return error;
  }

  Adjustment AdjustAll() {
    const auto made = Adjust(base_->Components().value().front(), *base_);
    EXPECT_TRUE(made.ok()) << made.status();
    return made.value_or(Adjustment{});
  }

  Street round_;
  std::map<KeyframeId, Rigid3> truth_;
};

TEST_F(AdjustTest, DrivesAroundABlockShareTheMisfit) {
  constexpr double kTurnRadPerM = 5e-4;
  RelativeError before, after;
  for (uint64_t seed = 1; seed <= 4; ++seed) {
    base_ = BaseMap::Over(MakeMemoryStore(BaseMap::NewHeader()), "base").value();
    Add(Drifted(Map(1, 0, 240, 1), 1.002, kTurnRadPerM, 2 * seed));
    const Contribution closing =
        Add(Drifted(Map(2, 200, kRoundM + 40, 1), 0.998, kTurnRadPerM, 2 * seed + 1));
    ASSERT_FALSE(closing.is_new_component);
    const RelativeError of_seed = Relative(Whole(1).map());
    const Adjustment made = AdjustAll();
    EXPECT_EQ(made.contributions, 2u);
    EXPECT_THAT(made.anchors, Gt(10u));
    EXPECT_THAT(made.largest_move_m, Gt(0.05));
    EXPECT_THAT(made.misfit_after, Lt(made.misfit_before));
    EXPECT_THAT(made.tiles, Not(IsEmpty()));
    const RelativeError adjusted = Relative(Whole(1).map());
    before.largest += of_seed.largest;
    before.mean += of_seed.mean;
    after.largest += adjusted.largest;
    after.mean += adjusted.mean;
  }
  EXPECT_THAT(after.largest, Lt(0.8 * before.largest));
  EXPECT_THAT(after.mean, Lt(0.8 * before.mean));
  ExpectPatchesLeadToTiles();
  EXPECT_EQ(Log().back().kind, "adjust");
}

TEST_F(AdjustTest, LandmarksRideOnTheirAnchorsAndNothingElseChanges) {
  Add(Map(1, 0, 240, 1.003));
  Add(Map(2, 200, kRoundM + 40, 0.997));
  const LeanMap before = Whole(1).map();
  AdjustAll();
  const LeanMap after = Whole(1).map();
  ASSERT_EQ(after.landmarks.size(), before.landmarks.size());
  for (size_t i = 0; i < after.landmarks.size(); ++i) {
    EXPECT_EQ(after.landmarks[i].id, before.landmarks[i].id);
    EXPECT_EQ(after.landmarks[i].keyframe_idxs, before.landmarks[i].keyframe_idxs);
    EXPECT_LT((PositionInAnchor(after, after.landmarks[i]) -
               PositionInAnchor(before, before.landmarks[i]))
                  .norm(),
              1e-3);
  }
}

TEST_F(AdjustTest, WhatFitsAlreadyStays) {
  Add(Map(1, 0, 240, 1.003));
  Add(Map(2, 200, kRoundM + 40, 0.997));
  AdjustAll();
  EXPECT_THAT(AdjustAll().largest_move_m, Lt(0.02));
}

TEST_F(AdjustTest, ASingleDriveStays) {
  Add(Map(1, 0, 150, 1.002));
  const Adjustment made = AdjustAll();
  EXPECT_THAT(made.largest_move_m, Lt(0.02));
  EXPECT_FALSE(made.sequence);
  EXPECT_THAT(made.tiles, IsEmpty());
  EXPECT_EQ(Log().size(), 1u);
}

TEST_F(AdjustTest, WithoutGpsTheFirstKeyframeStays) {
  Add(Map(1, 0, 240, 1.003, false));
  Add(Map(2, 200, kRoundM + 40, 0.997, false));
  const KeyframeId first = Whole(1).map().keyframes.front().id;
  const auto pose_of = [&] {
    const LeanMap map = Whole(1).map();
    return FindById(map.keyframes, first)->map_from_camera.translation;
  };
  const Eigen::Vector3d before = pose_of();
  const Adjustment made = AdjustAll();
  EXPECT_THAT(made.largest_move_m, Gt(0.1));
  EXPECT_LT((pose_of() - before).norm(), 2e-3);
}

TEST_F(AdjustTest, ManyDrivesPutTheComponentWhereTheirFixesAgree) {
  Add(Map(1, 0, 150, 1, true, {4, 0, 0}));
  for (uint64_t id = 2; id < 6; ++id) Add(Map(id, 0, 150, 1, true, {0, 0, 0}));
  const Adjustment made = AdjustAll();
  EXPECT_NEAR(made.median_move_m, 3.2, 0.9);  // the mean of all is 0.8 m off
}

TEST_F(AdjustTest, RefusesToMoveAComponentOutOfItsTiles) {
  Add(Map(1, 0, 150, 1, true, {45, 0, 0}));
  for (uint64_t id = 2; id < 6; ++id) Add(Map(id, 0, 150, 1, true, {0, 0, 0}));
  const auto made = Adjust(base_->Components().value().front(), *base_);
  EXPECT_EQ(made.status().code(), absl::StatusCode::kFailedPrecondition) << made.status();
  EXPECT_THAT(made.status().message(), ::testing::HasSubstr("would move by"));
  EXPECT_EQ(Log().size(), 5u);
}

TEST_F(AdjustTest, WhatIsTakenBackDoesNotCountAndCanBeTakenBackAfterwards) {
  Add(Map(1, 0, 240, 1.003));
  Add(Map(2, 200, kRoundM + 40, 0.997));
  Add(Map(3, 100, 300, 1.0));
  AdjustAll();
  ASSERT_TRUE(Revert(ToHex(DriveId{3, 5}), *base_).ok());
  ExpectPatchesLeadToTiles();
  const Adjustment made = AdjustAll();
  EXPECT_EQ(made.contributions, 2u);
  ExpectPatchesLeadToTiles();
}

}  // namespace
}  // namespace carmap
