#include "carmap/slam/fix_judgement.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kFrames = 120;
const GpsFix kOrigin{49.011, 8.416, 115};

/// Where the drive's frame lies: its z points north-east, its y down.
Rigid3 EnuFromMap() {
  Eigen::Matrix3d axes;  // columns: right, down, ahead
  axes << M_SQRT1_2, 0, M_SQRT1_2, -M_SQRT1_2, 0, M_SQRT1_2, 0, -1, 0;
  return {Eigen::Quaterniond(axes), {20, -30, 5}};
}

/// A bend, a frame each 0.1 s and metre; the vehicle stands from frame `stop` to frame `go`.
Trajectory Drive(int stop = kFrames, int go = kFrames) {
  Trajectory trajectory;
  Rigid3 pose;
  for (int i = 0; i < kFrames; ++i) {
    trajectory.push_back({Timestamp::FromSeconds(0.1 * i), pose});
    if (i < stop || i >= go) pose = pose * Rigid3{RotationExp({0, 0.02, 0}), {0, 0, 1}};
  }
  return trajectory;
}

/// Row i of the file, given the true fix.
using RowOf = std::function<GpsFix(int, const GpsFix&)>;

GpsLog LogOf(const Trajectory& trajectory, const RowOf& row_of) {
  const LocalEnu enu(kOrigin);
  std::vector<Timestamp> times;
  const auto path = std::filesystem::path(testing::TempDir()) / "carmap_fix_judgement_test.txt";
  std::ofstream file(path);
  for (size_t i = 0; i < trajectory.size(); ++i) {
    times.push_back(*trajectory[i].timestamp);
    const Eigen::Vector3d& p_in_map = trajectory[i].world_from_camera->translation;
    const GpsFix fix = row_of(static_cast<int>(i), enu.ToGps(EnuFromMap() * p_in_map));
    file << fmt::format("{} {} {} {}\n", times.back().seconds(), fix.latitude_deg,
                        fix.longitude_deg, fix.altitude_m);
  }
  file.close();
  return *GpsLog::Read(path, times);
}

/// Those of the keyframes: a vehicle that stands makes none.
std::vector<PlacedFix> FixesOf(const GpsLog& log, const Trajectory& trajectory) {
  std::vector<PlacedFix> fixes;
  std::optional<Eigen::Vector3d> last;
  for (const TimedPose& pose : trajectory) {
    if (last == pose.world_from_camera->translation) continue;
    last = pose.world_from_camera->translation;
    if (const auto fix = log.At(*pose.timestamp)) fixes.push_back({*pose.world_from_camera, *fix});
  }
  return fixes;
}

/// Of a drive that is mapped with these rows.
GpsUse Judge(const Trajectory& trajectory, const RowOf& row_of) {
  const GpsLog log = LogOf(trajectory, row_of);
  return JudgeFixes(log, trajectory, GeoreferenceOf(FixesOf(log, trajectory), {}), {});
}

GpsFix North(GpsFix fix, double metres) {
  fix.latitude_deg += metres / 111200;
  return fix;
}

TEST(FixJudgement, CountsOutliersAndRowsWithoutAFix) {
  const GpsUse use = Judge(Drive(), [](int i, const GpsFix& fix) {
    if (i < 10) return GpsFix{0, 0, 0};
    if (i == 20) return GpsFix{52.52, 13.4, 30};
    return i >= 50 && i < 60 ? North(fix, 40) : fix;
  });
  EXPECT_EQ(use.rows, size_t{kFrames});
  EXPECT_EQ(use.without_fix, 10u);
  EXPECT_EQ(use.outliers, 11u);
  EXPECT_EQ(use.frozen, 0u);
  EXPECT_EQ(use.used, size_t{kFrames - 21});
  EXPECT_THAT(use.contradiction, IsEmpty());
}

TEST(FixJudgement, RowsThatRepeatAreFrozenOnlyIfTheVehicleDrives) {
  const Trajectory drive = Drive(30, 60);
  GpsFix held;
  const GpsUse use = Judge(drive, [&](int i, const GpsFix& fix) {
    if (i < 80 || i >= 95) held = fix;
    return held;
  });
  EXPECT_EQ(use.frozen, 15u) << "rows 80 to 94, which are that of 79; not those of the stop";
  EXPECT_EQ(use.outliers, 0u);
  EXPECT_EQ(use.used, size_t{kFrames - 15});
}

TEST(FixJudgement, ALongStopAtAWrongPlaceContradictsNothing) {
  const GpsUse use = Judge(Drive(30, 60), [](int i, const GpsFix& fix) {
    return i >= 30 && i < 60 ? North(fix, 15 + 0.01 * i) : fix;
  });
  EXPECT_EQ(use.outliers, 30u);
  EXPECT_THAT(use.contradiction, IsEmpty());
}

TEST(FixJudgement, ARecordWithoutAWayContradictsNothing) {
  EXPECT_THAT(Judge(Drive(5, kFrames), [](int, const GpsFix& fix) { return fix; }).contradiction,
              IsEmpty());
  EXPECT_THAT(Judge(Drive(),
                    [](int, const GpsFix&) {
                      return GpsFix{0, 0, 0};
                    })
                  .contradiction,
              IsEmpty());
  EXPECT_EQ(Judge({}, [](int, const GpsFix& fix) { return fix; }).rows, 0u);
}

TEST(FixJudgement, NamesWhatTheRowsMayBe) {
  constexpr double kRadPerDeg = M_PI / 180;
  const auto contradiction_of = [](const RowOf& row_of) {
    const GpsUse use = Judge(Drive(), row_of);
    EXPECT_EQ(use.used, 0u) << "they hold nothing";
    return use.contradiction;
  };
  EXPECT_THAT(contradiction_of([](int, const GpsFix& fix) {
                return GpsFix{kRadPerDeg * fix.latitude_deg, kRadPerDeg * fix.longitude_deg, 115};
              }),
              HasSubstr("are radians; "));
  EXPECT_THAT(contradiction_of([](int, const GpsFix& fix) {
                return GpsFix{fix.longitude_deg, fix.latitude_deg, 115};
              }),
              HasSubstr("are swapped; "));
  EXPECT_THAT(contradiction_of([](int, const GpsFix& fix) {
                return GpsFix{fix.latitude_deg, -fix.longitude_deg, 115};
              }),
              HasSubstr("west as negative"));
  EXPECT_THAT(contradiction_of([](int i, const GpsFix&) {
                return GpsFix{50 + 1e-5 * std::abs(i - 60), 9 - 1e-5 * i, 100};
              }),
              HasSubstr("of another drive"));
  EXPECT_THAT(contradiction_of([](int, const GpsFix&) { return kOrigin; }),
              HasSubstr("repeat one place"));
}

TEST(FixJudgement, MeasuresHowFarFromAGivenMapTheFixesLie) {
  const Trajectory drive = Drive();
  const auto base =
      GeoreferenceOf(FixesOf(LogOf(drive, [](int, const GpsFix& fix) { return fix; }), drive), {});
  const GpsLog log = LogOf(drive, [](int, const GpsFix& fix) { return North(fix, 60); });
  const GpsUse use = JudgeFixes(log, drive, base, {});
  EXPECT_EQ(use.outliers, size_t{kFrames});
  EXPECT_THAT(use.contradiction, HasSubstr("lie 60 m"));
}

TEST(FixJudgement, DoesNotJudgeWhereTheVehicleWasLost) {
  Trajectory drive = Drive();
  const GpsLog log = LogOf(drive, [](int, const GpsFix& fix) { return fix; });
  const auto georeference = GeoreferenceOf(FixesOf(log, drive), {});
  for (size_t i = 40; i < 50; ++i) drive[i].world_from_camera.reset();
  const GpsUse use = JudgeFixes(log, drive, georeference, {});
  EXPECT_EQ(use.rows, size_t{kFrames});
  EXPECT_EQ(use.used, size_t{kFrames - 11}) << "row 50 lies at the end of what was lost";
}

}  // namespace
}  // namespace carmap
