#include "carmap/sim/gps_simulator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "carmap/dataset/kitti_drive.h"

namespace carmap {
namespace {

const GpsFix kOrigin{49.011, 8.416, 115};
constexpr GpsModel kNoErrors{.noise_m = 0, .bias_m = 0};
constexpr double kFrameS = 0.1;

/// Eastwards with a wave, `speed_mps` fast, standing from frame `stop` on for `pause` frames.
Trajectory Drive(size_t frames, double speed_mps, size_t stop = 0, size_t pause = 0) {
  Trajectory trajectory;
  double east_m = 0;
  for (size_t i = 0; i < frames; ++i) {
    const Rigid3 pose{Eigen::Quaterniond::Identity(),
                      {east_m, 20 * std::sin(east_m / 200), 3 + east_m / 100}};
    trajectory.push_back({Timestamp::FromSeconds(kFrameS * static_cast<double>(i)), pose});
    if (i < stop || i >= stop + pause) east_m += speed_mps * kFrameS;
  }
  return trajectory;
}

/// Of fixes at the frames' rate.
std::vector<Eigen::Vector3d> Errors(const Trajectory& truth,
                                    const std::vector<SimulatedFix>& fixes) {
  const LocalEnu enu(kOrigin);
  std::vector<Eigen::Vector3d> errors;
  for (const SimulatedFix& fix : fixes) {
    const auto frame = static_cast<size_t>(std::lround(fix.time.seconds() / kFrameS));
    errors.push_back(enu.FromGps(fix.fix) - truth[frame].world_from_camera->translation);
  }
  return errors;
}

/// Mean of products of values `lag` apart, for each axis.
Eigen::Vector3d Covariance(const std::vector<Eigen::Vector3d>& values, size_t lag) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (size_t i = lag; i < values.size(); ++i) sum += values[i].cwiseProduct(values[i - lag]);
  return sum / static_cast<double>(values.size() - lag);
}

TEST(GpsSimulator, WithoutErrorsItIsTheTruth) {
  const Trajectory truth = Drive(500, 10);
  for (const double rate_hz : {1.0, 10.0, 25.0}) {
    GpsModel model = kNoErrors;
    model.rate_hz = rate_hz;
    const std::vector<SimulatedFix> fixes = SimulateGps(truth, kOrigin, model, 1);
    ASSERT_EQ(fixes.size(), std::floor(49.9 * rate_hz + 1e-6) + 1) << "both ends have one";
    const LocalEnu enu(kOrigin);
    for (const SimulatedFix& fix : fixes) {
      const double east_m = 10 * fix.time.seconds();
      const Eigen::Vector3d there(east_m, 20 * std::sin(east_m / 200), 3 + east_m / 100);
      EXPECT_LT((enu.FromGps(fix.fix) - there).norm(), 1e-3);
    }
  }
}

TEST(GpsSimulator, NoiseIsWhiteAndOfTheStatedSize) {
  GpsModel model = kNoErrors;
  model.noise_m = 1.5;
  const Trajectory truth = Drive(20000, 10);
  const auto errors = Errors(truth, SimulateGps(truth, kOrigin, model, 4));
  ASSERT_EQ(errors.size(), truth.size());
  const Eigen::Vector3d sigma = Covariance(errors, 0).cwiseSqrt();
  EXPECT_NEAR(sigma.x(), 1.5, 0.03);
  EXPECT_NEAR(sigma.y(), 1.5, 0.03);
  EXPECT_NEAR(sigma.z(), 3.0, 0.06) << "vertical_factor";
  EXPECT_LT(Covariance(errors, 1).norm(), 0.15);
}

TEST(GpsSimulator, BiasWandersAsStated) {
  GpsModel model = kNoErrors;
  model.bias_m = 3;
  model.bias_time_s = 20;
  model.rate_hz = 1;
  const Trajectory truth = Drive(30000, 1);  // 150 times as long as it takes to forget
  Eigen::Vector3d now = Eigen::Vector3d::Zero(), later = Eigen::Vector3d::Zero();
  constexpr int kSeeds = 20;
  for (int seed = 0; seed < kSeeds; ++seed) {
    const auto fixes = SimulateGps(truth, kOrigin, model, static_cast<uint64_t>(seed));
    const auto errors = Errors(truth, fixes);
    now += Covariance(errors, 0) / kSeeds;
    later += Covariance(errors, 20) / kSeeds;
    for (size_t i = 1; i < errors.size(); ++i) ASSERT_LT((errors[i] - errors[i - 1]).norm(), 15);
  }
  const Eigen::Vector3d sigma = now.cwiseSqrt();
  EXPECT_NEAR(sigma.x(), 3, 0.15);
  EXPECT_NEAR(sigma.y(), 3, 0.15);
  EXPECT_NEAR(sigma.z(), 6, 0.3);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(later[axis] / now[axis], std::exp(-1), 0.06) << "after bias_time_s";
  }
}

TEST(GpsSimulator, AllButTheNoiseIsTheSameAtAnyRate) {
  GpsModel model = ModelOf(GpsQuality::kUrban);
  model.noise_m = 0;
  const Trajectory truth = Drive(3000, 10);
  const auto often = SimulateGps(truth, kOrigin, model, 7);
  model.rate_hz = 2;
  const auto rarely = SimulateGps(truth, kOrigin, model, 7);
  size_t common = 0;
  for (size_t i = 0, k = 0; i < rarely.size(); ++i) {
    while (k < often.size() && often[k].time < rarely[i].time) ++k;
    ASSERT_LT(k, often.size());
    ASSERT_EQ(often[k].time, rarely[i].time);
    EXPECT_NEAR(often[k].fix.latitude_deg, rarely[i].fix.latitude_deg, 1e-9);
    EXPECT_NEAR(often[k].fix.longitude_deg, rarely[i].fix.longitude_deg, 1e-9);
    ++common;
  }
  EXPECT_GT(common, 500);
}

/// Runs of neighbouring fixes with an error.
struct Excursion {
  double peak_m = 0, duration_s = 0;
};
std::vector<Excursion> ExcursionsIn(const std::vector<Eigen::Vector3d>& errors) {
  std::vector<Excursion> excursions;
  bool inside = false;
  for (const Eigen::Vector3d& error : errors) {
    const double size_m = error.head<2>().norm();
    if (size_m > 1e-3 && !inside) excursions.emplace_back();
    inside = size_m > 1e-3;
    if (!inside) continue;
    excursions.back().peak_m = std::max(excursions.back().peak_m, size_m);
    excursions.back().duration_s += kFrameS;
  }
  return excursions;
}

TEST(GpsSimulator, ExcursionsAreOfTheStatedNumberAndSize) {
  GpsModel model = ModelOf(GpsQuality::kUrban);
  model.noise_m = model.bias_m = model.outages_per_km = 0;
  const Trajectory truth = Drive(20000, 10);  // 20 km
  const auto errors = Errors(truth, SimulateGps(truth, kOrigin, model, 3));
  const std::vector<Excursion> excursions = ExcursionsIn(errors);
  EXPECT_GT(excursions.size(), 0.85 * model.excursions_per_km * 20) << "some coincide";
  EXPECT_LE(excursions.size(), model.excursions_per_km * 20);
  for (const Excursion& excursion : excursions) {
    EXPECT_GT(excursion.peak_m, model.excursion_min_m - 1);
    EXPECT_LE(excursion.peak_m, model.excursion_max_m);
    EXPECT_GT(excursion.duration_s, 0.5 * model.excursion_s - 0.5);
    EXPECT_LT(excursion.duration_s, 1.5 * model.excursion_s + 0.1);
  }
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (size_t i = 1; i < errors.size(); ++i) {
    // sin² of 50 m rises by at most 50 m · π / duration a second.
    EXPECT_LT((errors[i] - errors[i - 1]).norm(), 50 * M_PI / (0.5 * model.excursion_s) * kFrameS);
    mean += errors[i].head<2>() / static_cast<double>(errors.size());
  }
  EXPECT_LT(mean.norm(), 1) << "in all directions";
}

TEST(GpsSimulator, AVehicleThatStandsCollectsNoMoreExcursions) {
  GpsModel model = ModelOf(GpsQuality::kUrban);
  model.noise_m = model.bias_m = model.outages_per_km = 0;
  const Trajectory going = Drive(10000, 10), halting = Drive(20000, 10, 3000, 10000);
  const auto without = ExcursionsIn(Errors(going, SimulateGps(going, kOrigin, model, 5)));
  const auto with = ExcursionsIn(Errors(halting, SimulateGps(halting, kOrigin, model, 5)));
  EXPECT_GT(without.size(), 30);
  EXPECT_NEAR(static_cast<double>(with.size()), static_cast<double>(without.size()), 1);
}

TEST(GpsSimulator, OutagesLeaveRowsOut) {
  const GpsModel model = ModelOf(GpsQuality::kUrban);
  const Trajectory truth = Drive(20000, 10);
  const auto fixes = SimulateGps(truth, kOrigin, model, 3);
  size_t outages = 0;
  for (size_t i = 1; i < fixes.size(); ++i) {
    const double gap_s = fixes[i].time.seconds() - fixes[i - 1].time.seconds();
    if (gap_s < 1.5 * kFrameS) continue;
    ++outages;
    EXPECT_GT(gap_s, 0.5 * model.outage_s);
    EXPECT_LT(gap_s, 1.5 * model.outage_s + 2 * kFrameS);
  }
  EXPECT_NEAR(static_cast<double>(outages), model.outages_per_km * 20, 4);
  EXPECT_EQ(SimulateGps(truth, kOrigin, ModelOf(GpsQuality::kOpen), 3).size(), truth.size());
}

TEST(GpsSimulator, UrbanIsWorseThanOpen) {
  const Trajectory truth = Drive(20000, 10);
  const auto median_m = [&](GpsQuality quality) {
    std::vector<double> sizes;
    for (const auto& error : Errors(truth, SimulateGps(truth, kOrigin, ModelOf(quality), 1))) {
      sizes.push_back(error.head<2>().norm());
    }
    std::nth_element(sizes.begin(), sizes.begin() + static_cast<long>(sizes.size() / 2),
                     sizes.end());
    return sizes[sizes.size() / 2];
  };
  EXPECT_NEAR(median_m(GpsQuality::kOpen), 1.18 * std::hypot(0.5, 1), 0.4);
  EXPECT_GT(median_m(GpsQuality::kUrban), 2 * median_m(GpsQuality::kOpen));
}

TEST(GpsSimulator, FollowsFromTheSeed) {
  const Trajectory truth = Drive(300, 10);
  const GpsModel model = ModelOf(GpsQuality::kUrban);
  const auto text = [&](uint64_t seed) {
    return GpsText(SimulateGps(truth, kOrigin, model, seed), model);
  };
  EXPECT_EQ(text(1), text(1));
  EXPECT_NE(text(1), text(2));
  EXPECT_TRUE(SimulateGps({}, kOrigin, model, 1).empty());
  EXPECT_EQ(SimulateGps(Drive(1, 10), kOrigin, model, 1).size(), 1);
}

TEST(GpsSimulator, ItsTextIsReadWithADrive) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::path(testing::TempDir()) / "carmap_gps_simulator_test";
  constexpr size_t kFrames = 5;
  const auto write = [&](const char* name) { return std::ofstream(folder / name); };
  for (const char* side : {"image_0", "image_1"}) {
    fs::create_directories(folder / side);
    for (size_t i = 0; i < kFrames; ++i) {
      cv::imwrite(folder / side / (std::to_string(i) + ".png"), cv::Mat(32, 64, CV_8UC1, 7.0));
    }
  }
  write("calib.txt") << "P0: 9 0 4 0 0 9 4 0 0 0 1 0\nP1: 9 0 4 -4 0 9 4 0 0 0 1 0\n";
  write("times.txt") << "0\n0.1\n0.2\n0.3\n0.4\n";
  const GpsModel model = ModelOf(GpsQuality::kOpen);
  const auto fixes = SimulateGps(Drive(kFrames, 10), kOrigin, model, 1);
  write("gps.txt") << GpsText(fixes, model);

  const auto drive = KittiDrive::Open(folder);
  ASSERT_TRUE(drive.ok()) << drive.status();
  const LocalEnu enu(kOrigin);
  for (size_t i = 0; i < kFrames; ++i) {
    const auto frame = (*drive)->Next();
    ASSERT_TRUE(frame && frame->gps);
    EXPECT_LT((enu.FromGps(*frame->gps) - enu.FromGps(fixes[i].fix)).norm(), 1e-3);
  }
}

}  // namespace
}  // namespace carmap
