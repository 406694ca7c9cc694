#include "carmap/vehicle/base_tracker.h"

#include <gtest/gtest.h>

#include <memory>
#include <utility>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

constexpr double kStreetLengthM = 160;
const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};
const StreetNoise kNoise{.pixel_px = 0.4, .descriptor_bits = 6};

/// A vehicle in a map: what it sees, and its own odometry, good to a centimetre a frame, which
/// knows the rig's disparity bias; its calibration does not.
class TestVehicle {
 public:
  TestVehicle(const ReconstructedMap& map, const StereoRig& rig, double start_s = 0)
      : rig_(rig),
        tracker_({std::shared_ptr<const void>(), &map}, {rig.camera, rig.baseline_m},
                 {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()}),
        time_s_(start_s) {}

  VehiclePose Drive(const Street& street, const Rigid3& world_from_camera,
                    const StreetNoise& noise = kNoise) {
    auto features = SeeStreet(street, rig_, world_from_camera, noise, ++frames_);
    for (Feature& feature : features) {
      const double x = (feature.x_px - rig_.camera.cx) / rig_.camera.fx;
      feature.disparity_px += static_cast<float>(rig_.disparity_bias.At(x));
    }
    return Take(world_from_camera, std::move(features), /*tracks_itself=*/true);
  }
  /// What it sees moves along with it: its odometry says that it stands.
  VehiclePose DriveDragged(const Street& street, const Rigid3& world_from_camera) {
    last_tracked_->second = world_from_camera;
    return Drive(street, world_from_camera);
  }
  void Swap(const ReconstructedMap& map) { tracker_.Swap({std::shared_ptr<const void>(), &map}); }
  /// Its images show nothing.
  VehiclePose DriveBlind(const Rigid3& world_from_camera) {
    return Take(world_from_camera, {}, /*tracks_itself=*/false);
  }

 private:
  VehiclePose Take(const Rigid3& world_from_camera, std::vector<Feature> features,
                   bool tracks_itself) {
    time_s_ += 0.1;
    ExtractedFrame frame{.timestamp = Timestamp::FromSeconds(time_s_)};
    frame.features = std::make_shared<const std::vector<Feature>>(std::move(features));
    TrackedFrame own;
    if (tracks_itself) {
      own.reference = KeyframeId{};
      own.disparity_bias = rig_.disparity_bias;
      if (last_tracked_) {
        Vector6d error;
        for (int i = 0; i < 3; ++i) error[i] = random_.Normal(0.004);
        for (int i = 3; i < 6; ++i) error[i] = random_.Normal(0.0004);
        own.camera_from_previous =
            Perturb(world_from_camera.Inverse() * last_tracked_->second, error);
        own.since_previous_s = time_s_ - last_tracked_->first;
      }
      last_tracked_ = {time_s_, world_from_camera};
    }
    return tracker_.Take(frame, own);
  }

  const StereoRig rig_;
  BaseTracker tracker_;
  StreetRandom random_{9};
  uint64_t frames_ = 0;
  double time_s_;
  std::optional<std::pair<double, Rigid3>> last_tracked_;
};

double PositionError(const VehiclePose& pose, const Rigid3& world_from_camera) {
  return (pose.pose->camera_from_base.Inverse().translation -
          (kMapFromWorld * world_from_camera).translation)
      .norm();
}

class BaseTrackerTest : public ::testing::Test {
 protected:
  BaseTrackerTest()
      : street_(MakeStreet(3, kStreetLengthM)),
        lean_(MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 110), kMapFromWorld, kNoise)),
        map_(Reconstruct(lean_)) {}

  const Street street_;
  const LeanMap lean_;
  const ReconstructedMap map_;
};

TEST_F(BaseTrackerTest, KnowsADriveInTheNextLaneByTheMap) {
  TestVehicle vehicle(map_, kStreetRig);
  int n = 0, within = 0;
  for (const Rigid3& world_from_camera : DriveAlong(3, 3, 100, 1.1)) {
    const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
    ASSERT_EQ(pose.known_by, KnownBy::kMap) << n;
    EXPECT_LT(PositionError(pose, world_from_camera), 0.1) << n;
    EXPECT_EQ(pose.dead_reckoned_m, 0);
    const Vector6d error =
        PoseDifference(pose.pose->camera_from_base, (kMapFromWorld * world_from_camera).Inverse());
    within += error.dot(pose.pose->covariance.ldlt().solve(error)) < 12.6;
    ++n;
  }
  EXPECT_GT(within, 0.85 * n);
}

// As tiles come and go around the vehicle.
TEST_F(BaseTrackerTest, LosesNoFrameWhenTheMapIsSwapped) {
  const ReconstructedMap south =
      Reconstruct(MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 60), kMapFromWorld, kNoise));
  const ReconstructedMap north = Reconstruct(
      MapStreet(street_, {6}, kStreetRig, DriveAlong(0, 40, 110), kMapFromWorld, kNoise));
  TestVehicle vehicle(south, kStreetRig);
  for (const Rigid3& world_from_camera : DriveAlong(1, 3, 100, 1.1)) {
    const double z_m = world_from_camera.translation.z();
    if (z_m > 50) vehicle.Swap(north);
    const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
    ASSERT_EQ(pose.known_by, KnownBy::kMap) << z_m;
    EXPECT_LT(PositionError(pose, world_from_camera), 0.15) << z_m;
  }
}

TEST_F(BaseTrackerTest, DeadReckonsWhereNothingOfTheMapIsSeen) {
  TestVehicle vehicle(map_, kStreetRig);
  const Street rebuilt = MakeStreet(77, kStreetLengthM);
  double sigma_m = 0;
  for (const Rigid3& world_from_camera : DriveAlong(0, 3, 100, 1)) {
    const double z_m = world_from_camera.translation.z();
    const bool is_rebuilt = z_m > 30 && z_m < 48;
    const VehiclePose pose = vehicle.Drive(is_rebuilt ? rebuilt : street_, world_from_camera);
    ASSERT_EQ(pose.known_by, is_rebuilt ? KnownBy::kDeadReckoning : KnownBy::kMap) << z_m;
    EXPECT_LT(PositionError(pose, world_from_camera), is_rebuilt ? 0.3 : 0.1) << z_m;
    if (!is_rebuilt) continue;
    EXPECT_NEAR(pose.dead_reckoned_m, z_m - 30, 1.1);
    const double now_m = std::sqrt(pose.pose->covariance(0, 0));
    EXPECT_GT(now_m, sigma_m) << z_m;
    sigma_m = now_m;
  }
}

TEST_F(BaseTrackerTest, KeepsItsSpeedThroughBlackFramesAndThenKnows) {
  TestVehicle vehicle(map_, kStreetRig);
  const auto poses = DriveAlong(0, 2, 100, 1);
  for (size_t n = 0; n < poses.size(); ++n) {
    const bool is_black = n >= 30 && n < 36;
    const VehiclePose pose =
        is_black ? vehicle.DriveBlind(poses[n]) : vehicle.Drive(street_, poses[n]);
    ASSERT_EQ(pose.known_by, is_black ? KnownBy::kDeadReckoning : KnownBy::kMap) << n;
    EXPECT_LT(PositionError(pose, poses[n]), is_black ? 1.0 : 0.1) << n;
  }
}

TEST_F(BaseTrackerTest, IsNotDraggedAlongByTraffic) {
  TestVehicle vehicle(map_, kStreetRig);
  const Street traffic = MakeStreet(77, kStreetLengthM);
  const auto poses = DriveAlong(0, 2, 100, 1);
  for (size_t n = 0; n < poses.size(); ++n) {
    const bool is_dragged = n >= 30 && n < 36;
    const VehiclePose pose =
        is_dragged ? vehicle.DriveDragged(traffic, poses[n]) : vehicle.Drive(street_, poses[n]);
    ASSERT_EQ(pose.known_by, is_dragged ? KnownBy::kDeadReckoning : KnownBy::kMap) << n;
    EXPECT_LT(PositionError(pose, poses[n]), is_dragged ? 1.0 : 0.1) << n;
  }
}

TEST_F(BaseTrackerTest, IsLostAfterALongTimeInTheDark) {
  TestVehicle vehicle(map_, kStreetRig);
  for (const Rigid3& pose : DriveAlong(0, 2, 20, 1)) vehicle.Drive(street_, pose);
  VehiclePose pose;
  for (int n = 0; n < 100; ++n) pose = vehicle.DriveBlind(Rigid3());
  EXPECT_EQ(pose.known_by, KnownBy::kLost);
  EXPECT_FALSE(pose.pose);
  // ... and finds itself again anywhere.
  for (const Rigid3& seen : DriveAlong(0, 60, 66, 1)) pose = vehicle.Drive(street_, seen);
  EXPECT_EQ(pose.known_by, KnownBy::kMap);
  EXPECT_LT(PositionError(pose, DriveAlong(0, 60, 66, 1).back()), 0.1);
}

TEST_F(BaseTrackerTest, KnowsNothingInAnotherStreet) {
  TestVehicle vehicle(map_, kStreetRig);
  const Street other = MakeStreet(99, kStreetLengthM);
  for (const Rigid3& world_from_camera : DriveAlong(0, 2, 60, 1)) {
    EXPECT_EQ(vehicle.Drive(other, world_from_camera).known_by, KnownBy::kLost);
  }
}

/// The street's first 50 m, and the same façades again from 60 m on.
Street WithARepeatedBlock(const Street& street) {
  Street repeated;
  for (const Street::Corner& corner : street.corners) {
    if (corner.p_in_world.z() > 50) continue;
    repeated.corners.push_back(corner);
    repeated.corners.push_back(corner);
    repeated.corners.back().p_in_world.z() += 60;
  }
  return repeated;
}

TEST_F(BaseTrackerTest, DoesNotChooseBetweenFacadesThatRepeat) {
  const Street repeated = WithARepeatedBlock(street_);
  const ReconstructedMap map = Reconstruct(
      MapStreet(repeated, {5}, kStreetRig, DriveAlong(0, 0, 100), kMapFromWorld, kNoise));
  TestVehicle vehicle(map, kStreetRig);
  for (const Rigid3& world_from_camera : DriveAlong(0, 64, 80, 1)) {
    const VehiclePose pose = vehicle.Drive(repeated, world_from_camera);
    if (pose.pose) {
      EXPECT_LT(PositionError(pose, world_from_camera), 1);
    }
  }
}

// Windows every 4 m, houses every 30 m, each the same but for a share of its corners.
TEST(BaseTracker, FindsTheRightOneOfHousesOfOneKind) {
  for (const double period_m : {4.0, 30.0}) {
    for (const double own_share : {0.3, 0.7}) {
      const Street street = WithRepeatedFacades(MakeStreet(8, 160), 0, 160, period_m, own_share);
      const ReconstructedMap map = Reconstruct(
          MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 120), kMapFromWorld, kNoise));
      TestVehicle vehicle(map, kStreetRig);
      VehiclePose pose;
      for (const Rigid3& world_from_camera : DriveAlong(1, 35, 100, 1.1)) {
        pose = vehicle.Drive(street, world_from_camera);
        if (pose.pose) {
          EXPECT_LT(PositionError(pose, world_from_camera), 0.2) << period_m << " " << own_share;
        }
      }
      if (own_share > 0.5) {  // less may be too little to tell them apart
        EXPECT_EQ(pose.known_by, KnownBy::kMap) << period_m;
      }
    }
  }
}

// Where all is the same it may not choose; what comes then tells.
TEST(BaseTracker, KnowsWhereItIsBeyondHousesThatAreAllTheSame) {
  const Street street = WithRepeatedFacades(MakeStreet(8, 220), 0, 120, 30);
  const ReconstructedMap map =
      Reconstruct(MapStreet(street, {5}, kStreetRig, DriveAlong(0, 0, 180), kMapFromWorld, kNoise));
  TestVehicle vehicle(map, kStreetRig);
  for (const Rigid3& world_from_camera : DriveAlong(0, 35, 165, 1)) {
    const VehiclePose pose = vehicle.Drive(street, world_from_camera);
    const double z_m = world_from_camera.translation.z();
    if (pose.pose) {
      EXPECT_LT(PositionError(pose, world_from_camera), 1) << z_m;
    }
    if (z_m > 135) {
      EXPECT_EQ(pose.known_by, KnownBy::kMap) << z_m;
    }
  }
}

TEST_F(BaseTrackerTest, FollowsAMapOfAnotherScale) {
  for (const double scale : {0.997, 1.001, 1.003}) {
    const ReconstructedMap map = Reconstruct(Scaled(lean_, scale));
    TestVehicle vehicle(map, kStreetRig);
    for (const Rigid3& world_from_camera : DriveAlong(1, 3, 100, 1.1)) {
      const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
      ASSERT_EQ(pose.known_by, KnownBy::kMap) << scale;
      const Eigen::Vector3d there = scale * (kMapFromWorld * world_from_camera).translation;
      EXPECT_LT((pose.pose->camera_from_base.Inverse().translation - there).norm(), 0.15) << scale;
    }
  }
}

TEST_F(BaseTrackerTest, DoesNotMindAClockThatIsHoursFromTheMaps) {
  for (const double start_s : {-3 * 3600.0, 5 * 3600.0, 1.7e9}) {
    TestVehicle vehicle(map_, kStreetRig, start_s);
    for (const Rigid3& world_from_camera : DriveAlong(1, 3, 60, 1.1)) {
      const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
      ASSERT_EQ(pose.known_by, KnownBy::kMap) << start_s;
      EXPECT_LT(PositionError(pose, world_from_camera), 0.1) << start_s;
    }
  }
}

TEST_F(BaseTrackerTest, LocalizesACameraOfAnotherFocalLength) {
  StereoRig rig = kStreetRig;
  rig.camera.fx *= 1.6;
  rig.camera.fy *= 1.6;
  const ReconstructedMap map = Reconstruct(lean_, rig.camera.fx);
  TestVehicle vehicle(map, rig);
  for (const Rigid3& world_from_camera : DriveAlong(0, 10, 90, 1)) {
    const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
    ASSERT_EQ(pose.known_by, KnownBy::kMap);
    EXPECT_LT(PositionError(pose, world_from_camera), 0.1);
  }
}

// Two cars of one series have the same calibration, and each its own bias: here two pixels apart,
// which is a tenth of the depth at 20 m.
TEST_F(BaseTrackerTest, GoesByItsOwnBiasNotByThatOfARigOfTheSameCalibration) {
  LeanMap lean = lean_;
  lean.drives[0].rig.disparity_bias.coefficients_px = {-1, 0, 0};
  const ReconstructedMap map = Reconstruct(lean);
  StereoRig rig = kStreetRig;
  rig.disparity_bias.coefficients_px = {1, 0.2, 0};
  TestVehicle vehicle(map, rig);
  for (const Rigid3& world_from_camera : DriveAlong(0, 10, 90, 1)) {
    const VehiclePose pose = vehicle.Drive(street_, world_from_camera);
    ASSERT_EQ(pose.known_by, KnownBy::kMap);
    EXPECT_LT(PositionError(pose, world_from_camera), 0.1);
  }
}

TEST_F(BaseTrackerTest, TakesEmptyMapsAndFrames) {
  const ReconstructedMap nothing = Reconstruct(LeanMap());
  TestVehicle lost(nothing, kStreetRig);
  EXPECT_EQ(lost.Drive(street_, Rigid3()).known_by, KnownBy::kLost);
  EXPECT_EQ(lost.DriveBlind(Rigid3()).known_by, KnownBy::kLost);
  TestVehicle blind(map_, kStreetRig);
  EXPECT_EQ(blind.DriveBlind(Rigid3()).known_by, KnownBy::kLost);
}

}  // namespace
}  // namespace carmap
