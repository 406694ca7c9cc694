#include "carmap/dataset/gps_log.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kFrames = 100;

/// A frame each 0.1 s from `start_s` on.
std::vector<Timestamp> FrameTimes(double start_s = 0) {
  std::vector<Timestamp> times;
  for (int i = 0; i < kFrames; ++i) times.push_back(Timestamp::FromSeconds(start_s + 0.1 * i));
  return times;
}

/// The fix of frame i.
GpsFix FixOf(int i) { return {49 + 1e-5 * i, 8 + 2e-5 * i, 100}; }

std::string RowOf(double time_s, const GpsFix& fix) {
  return fmt::format("{:.3f} {} {} {}\n", time_s, fix.latitude_deg, fix.longitude_deg,
                     fix.altitude_m);
}

/// A row a frame, on a clock by which the first frame was at `start_s`.
std::string Rows(double start_s, int first = 0) {
  std::string text;
  for (int i = first; i < kFrames; ++i) text += RowOf(start_s + 0.1 * i, FixOf(i));
  return text;
}

GpsLog LogOf(const std::string& text, const std::vector<Timestamp>& frame_times) {
  const auto path = std::filesystem::path(testing::TempDir()) / "carmap_gps_log_test.txt";
  std::ofstream(path) << text;
  auto log = GpsLog::Read(path, frame_times);
  EXPECT_TRUE(log.ok()) << log.status();
  return *std::move(log);
}

GpsUse UseOf(const GpsLog& log, const std::vector<Timestamp>& times) {
  return log.UseOf(times.front(), times.back());
}

/// That frames have their own fixes, from frame `first` on.
void ExpectOwnFixes(const GpsLog& log, const std::vector<Timestamp>& times, int first = 0) {
  for (int i = first; i < kFrames; ++i) {
    const auto fix = log.At(times[static_cast<size_t>(i)]);
    ASSERT_TRUE(fix) << i;
    EXPECT_NEAR(fix->latitude_deg, FixOf(i).latitude_deg, 1e-8) << i;
  }
}

TEST(GpsLog, TakesTheCamerasClockAsItIs) {
  const auto times = FrameTimes();
  // The receiver had no fix for most of the drive.
  const GpsLog log = LogOf(Rows(0, 80), times);
  EXPECT_FALSE(log.At(times[50]));
  ExpectOwnFixes(log, times, 80);
  EXPECT_EQ(UseOf(log, times).clock, GpsClock::kCamera);
  EXPECT_EQ(UseOf(log, times).rows, 20u);
  EXPECT_THAT(UseOf(log, times).contradiction, IsEmpty());
}

TEST(GpsLog, CountsFromTheFirstRowWhereTheCameraStartsAtZero) {
  const auto times = FrameTimes();
  const GpsLog log = LogOf(Rows(1317042145.964), times);
  ExpectOwnFixes(log, times);
  EXPECT_EQ(UseOf(log, times).clock, GpsClock::kStartTogether);
  EXPECT_NEAR(UseOf(log, times).clock_offset_s, -1317042145.964, 1e-3);
  EXPECT_THAT(UseOf(log, times).contradiction, IsEmpty()) << "receivers are like this";
}

TEST(GpsLog, RowsWithoutAFixCountButAreNone) {
  const auto times = FrameTimes();
  std::string text;
  for (int i = 0; i < 15; ++i) text += RowOf(1317042145.964 + 0.1 * i, {0, 0, 0});
  text += Rows(1317042145.964, 15);
  text += "1317042146.010 nan nan nan\n1317042146.020 999 999 0\n1317042146.030 inf 8 0\n";
  const GpsLog log = LogOf(text, times);
  EXPECT_FALSE(log.At(times[5]));
  ExpectOwnFixes(log, times, 15);  // recording began with the first row, not with the first fix
  const GpsUse use = UseOf(log, times);
  EXPECT_EQ(use.rows, size_t{kFrames + 3});
  EXPECT_EQ(use.without_fix, 18u);
  EXPECT_THAT(use.contradiction, IsEmpty());
}

TEST(GpsLog, CountsTheRowsOfARange) {
  const auto times = FrameTimes();
  const GpsLog log = LogOf(Rows(0), times);
  EXPECT_EQ(log.UseOf(times[20], times[29]).rows, 12u) << "and one on each side, for interpolation";
}

TEST(GpsLog, ASingleRowOfAnotherTimeDoesNotTellTheClock) {
  const auto times = FrameTimes();
  for (const double time_s : {0.0, 5.0, 3.15e8, 2.0e9}) {
    const GpsLog log = LogOf(RowOf(time_s, FixOf(0)) + Rows(1317042145.964), times);
    ExpectOwnFixes(log, times, 1);
  }
}

TEST(GpsLog, ClocksHoursApartAreTimeZones) {
  const auto times = FrameTimes(1317042145);
  for (const double hours : {2.0, -5.5}) {
    // The receiver was switched on 20 s before the camera.
    const double start_s = 1317042145 + 3600 * hours;
    const GpsLog log = LogOf(RowOf(start_s - 20, FixOf(0)) + Rows(start_s), times);
    ExpectOwnFixes(log, times);
    const GpsUse use = UseOf(log, times);
    EXPECT_EQ(use.clock, GpsClock::kTimeZone);
    EXPECT_EQ(use.clock_offset_s, -3600 * hours);
    EXPECT_THAT(use.contradiction, HasSubstr(hours > 0 ? "2.00 h ahead" : "5.50 h behind"));
    EXPECT_THAT(use.contradiction, HasSubstr("; write both times in one"));
  }
}

TEST(GpsLog, ADayApartItIsAnotherDrives) {
  const auto times = FrameTimes(1317042145);
  const GpsLog log = LogOf(Rows(1317042145 - 100000), times);
  EXPECT_FALSE(log.At(times[50]));
  EXPECT_EQ(UseOf(log, times).clock, GpsClock::kOfAnotherDay);
  EXPECT_THAT(UseOf(log, times).contradiction, HasSubstr("is of another drive"));
}

TEST(GpsLog, DoesNotInterpolateFromARowThatIsRepeated) {
  // Measured each second, written each tenth.
  std::string text;
  for (int i = 0; i < kFrames; ++i) text += RowOf(0.1 * i, FixOf(i / 10 * 10));
  const GpsLog log = LogOf(text, FrameTimes());
  EXPECT_EQ(log.At(Timestamp::FromSeconds(1.95)), FixOf(20));
  EXPECT_EQ(log.At(Timestamp::FromSeconds(2.05)), FixOf(20));
}

TEST(GpsLog, SaysWhatRowsAreThatAreNoPlaces) {
  const auto times = FrameTimes();
  std::string swapped, minutes;
  for (int i = 0; i < kFrames; ++i) {
    swapped += RowOf(0.1 * i, {116.4 + 1e-5 * i, 39.9, 50});
    minutes += RowOf(0.1 * i, {4900.9 + 1e-3 * i, 826.05, 50});  // of NMEA
  }
  EXPECT_THAT(UseOf(LogOf(swapped, times), times).contradiction, HasSubstr("swapped"));
  EXPECT_THAT(UseOf(LogOf(minutes, times), times).contradiction, HasSubstr("write degrees"));
  EXPECT_EQ(UseOf(LogOf(minutes, times), times).without_fix, size_t{kFrames});
}

}  // namespace
}  // namespace carmap
