#include "carmap/eval/realism.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "carmap/eval/histogram_picture.h"
#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

using ::testing::Each;
using ::testing::HasSubstr;

constexpr int kWidth = 320, kHeight = 200, kDisparityPx = 20, kStepPx = 6;
const StereoRig kRig{{250, 250, 159.5, 99.5, kWidth, kHeight}, 0.4};

const Wall& TheWall() {
  static const Wall wall(kWidth, kHeight, 4);
  return wall;
}

/// A camera moves to the right along a wall, kStepPx a frame.
DriveMeasures MeasureWall(int frames, double noise, int broken_frame = -1) {
  RealismMeter meter(kRig);
  meter.BeginChain();
  for (int i = 0; i < frames; ++i) {
    cv::Mat left = TheWall().Moved(5 * kStepPx * i),
            right = TheWall().Moved(5 * (kStepPx * i + kDisparityPx));
    if (i == broken_frame) left = right = RandomPixels(kWidth, kHeight, 77);
    if (noise > 0) {
      left = WithNoise(left, noise, 100 + i);
      right = WithNoise(right, noise, 200 + i);
    }
    meter.Take(left, right);
  }
  return meter.Finish();
}

double MedianOf(const DriveMeasures& drive, Measure measure) {
  return DistributionOf(drive[measure]).median;
}

TEST(RealismMeter, MeasuresWhatIsKnownOfAWall) {
  const DriveMeasures drive = MeasureWall(13, 0);
  EXPECT_EQ(drive.frames, 13);
  EXPECT_EQ(drive.pairs, 12);
  EXPECT_EQ(drive.lost_pairs, 0);
  EXPECT_NEAR(MedianOf(drive, Measure::kGreyMean), 128, 2);
  EXPECT_NEAR(MedianOf(drive, Measure::kGreySpread), 45, 2);
  EXPECT_GT(MedianOf(drive, Measure::kStereoShare), 80);
  EXPECT_NEAR(MedianOf(drive, Measure::kDisparity), kDisparityPx, 0.02);
  EXPECT_LT(MedianOf(drive, Measure::kStereoDifference), 3);
  EXPECT_LT(MedianOf(drive, Measure::kRowOffset), 0.03);
  // Depth 250 * 0.4 / 20 = 5 m, at which 6 px are 12 cm.
  EXPECT_NEAR(MedianOf(drive, Measure::kMetresPerFrame), 0.12, 0.002);
  EXPECT_GT(MedianOf(drive, Measure::kRepeatability), 60);
  EXPECT_LT(MedianOf(drive, Measure::kPlaceDistance), 0.25);
  EXPECT_GE(DistributionOf(drive[Measure::kTrackFrames]).mean, 4);
  // Of 13 frames three may begin a track; one of n frames is n - 1 steps long.
  ASSERT_EQ(drive[Measure::kTrackMetres].size(), 3);
  EXPECT_NEAR(DistributionOf(drive[Measure::kTrackMetres]).mean,
              0.12 * (DistributionOf(drive[Measure::kTrackFrames]).mean - 1), 0.02);
  for (size_t level = 0; level < kLevelCount; ++level) {
    EXPECT_EQ(drive.samples[static_cast<size_t>(Measure::kStrongCorners) + level].size(), 13);
  }
}

TEST(RealismMeter, NoiseShowsWhereItMust) {
  const DriveMeasures clean = MeasureWall(12, 0), noisy = MeasureWall(12, 8);
  EXPECT_GT(MedianOf(noisy, Measure::kHamming), MedianOf(clean, Measure::kHamming) + 3);
  EXPECT_GT(MedianOf(noisy, Measure::kStereoDifference),
            MedianOf(clean, Measure::kStereoDifference) + 2);
  EXPECT_LT(MedianOf(noisy, Measure::kRepeatability), MedianOf(clean, Measure::kRepeatability));
  EXPECT_GT(MedianOf(noisy, Measure::kPlaceDistance), MedianOf(clean, Measure::kPlaceDistance));
  EXPECT_LT(DistributionOf(noisy[Measure::kTrackFrames]).mean,
            DistributionOf(clean[Measure::kTrackFrames]).mean);
  EXPECT_LT(MedianOf(noisy, Measure::kSpectrumFine), MedianOf(clean, Measure::kSpectrumFine));
}

TEST(RealismMeter, AFrameOfNothingKnownCutsTheTracks) {
  const DriveMeasures drive = MeasureWall(14, 0, /*broken_frame=*/7);
  EXPECT_EQ(drive.pairs, 13);
  EXPECT_EQ(drive.lost_pairs, 2);
  EXPECT_EQ(drive[Measure::kMetresPerFrame].size(), 11);
  EXPECT_THAT(drive[Measure::kTrackFrames], testing::IsEmpty());
}

TEST(RealismMeter, ChainsDoNotRunIntoEachOther) {
  RealismMeter meter(kRig);
  for (int chain = 0; chain < 2; ++chain) {
    meter.BeginChain();
    for (int i = 0; i < 2; ++i) {
      meter.Take(TheWall().Moved(5 * kStepPx * i),
                 TheWall().Moved(5 * (kStepPx * i + kDisparityPx)));
    }
  }
  const DriveMeasures drive = meter.Finish();
  EXPECT_EQ(drive.frames, 4);
  EXPECT_EQ(drive.pairs, 2);
}

TEST(ChooseChains, AreEvenAndApart) {
  for (const auto& [frames, wanted] :
       {std::pair<size_t, size_t>{51, 50}, {11, 50}, {40, 40}, {4000, 50}, {100, 200}, {64, 64}}) {
    const auto chains = ChooseChains(frames, wanted);
    size_t total = 0;
    for (size_t i = 0; i < chains.size(); ++i) {
      total += chains[i].last - chains[i].first + 1;
      EXPECT_GE(chains[i].last - chains[i].first + 1, FeatureTracks::kMinChainFrames);
      if (i == 0) continue;
      EXPECT_GT(chains[i].first, chains[i - 1].last);
    }
    EXPECT_EQ(chains.front().first, 0);
    EXPECT_LT(chains.back().last, frames);
    EXPECT_TRUE(chains.size() == 1 || chains.back().last == frames - 1);
    EXPECT_LE(total, std::min(frames, wanted));
    EXPECT_GT(total + chains.size(), std::min(frames, wanted));
  }
}

/// One sample a measure.
DriveMeasures Constant(double value) {
  DriveMeasures drive;
  drive.rig = kRig;
  for (auto& samples : drive.samples) samples = {value};
  return drive;
}

const MeasureComparison& Of(const RealismComparison& comparison, Measure measure) {
  return comparison.measures[static_cast<size_t>(measure)];
}

TEST(CompareRealism, BoundsAreFactorsOfTheMedians) {
  const auto at = [](double simulated, Measure measure) {
    const auto comparison = CompareRealism(Constant(simulated), Constant(100));
    EXPECT_NEAR(*Of(comparison, measure).ratio, simulated / 100, 1e-12);
    return Of(comparison, measure).is_within;
  };
  EXPECT_EQ(at(149, Measure::kGreyMean), true);
  EXPECT_EQ(at(151, Measure::kGreyMean), false);
  EXPECT_EQ(at(67, Measure::kGreyMean), true);
  EXPECT_EQ(at(66, Measure::kGreyMean), false);
  EXPECT_EQ(at(119, Measure::kHamming), true);
  EXPECT_EQ(at(121, Measure::kHamming), false);
  EXPECT_EQ(at(84, Measure::kHamming), true);
  EXPECT_EQ(at(83, Measure::kHamming), false);
  EXPECT_EQ(at(500, Measure::kMetresPerFrame), std::nullopt);
}

TEST(CompareRealism, CountsWhatIsWithin) {
  const auto same = CompareRealism(Constant(100), Constant(100));
  EXPECT_EQ(same.bounded, kMeasureCount - 1);
  EXPECT_EQ(same.within, same.bounded);
  const auto hamming_off = CompareRealism(Constant(130), Constant(100));
  EXPECT_EQ(hamming_off.within, hamming_off.bounded - 1);
  EXPECT_EQ(CompareRealism(Constant(1000), Constant(100)).within, 0);
}

TEST(CompareRealism, AMeasureWithoutSamplesIsNotWithin) {
  DriveMeasures simulated = Constant(100);
  simulated[Measure::kTrackFrames].clear();
  const auto comparison = CompareRealism(simulated, Constant(100));
  EXPECT_EQ(Of(comparison, Measure::kTrackFrames).is_within, false);
  EXPECT_EQ(Of(comparison, Measure::kTrackFrames).distance, 1);
  EXPECT_THAT(ToText(comparison), HasSubstr(" - "));
}

TEST(CompareRealism, ADifferenceTooSmallToMatterIsNone) {
  const auto comparison = CompareRealism(Constant(0.3), Constant(0));
  EXPECT_EQ(Of(comparison, Measure::kSaturated).is_within, true);
  EXPECT_EQ(Of(comparison, Measure::kSaturated).ratio, std::nullopt);
  EXPECT_EQ(Of(comparison, Measure::kRowOffset).is_within, false);
}

TEST(CompareRealism, DistanceIsThatOfTheDistributions) {
  DriveMeasures simulated = Constant(1), real = Constant(1);
  simulated[Measure::kHamming] = {1, 2, 3, 4};
  real[Measure::kHamming] = {3, 4, 5, 6};
  real[Measure::kDisparity] = {2};
  const auto comparison = CompareRealism(simulated, real);
  EXPECT_DOUBLE_EQ(Of(comparison, Measure::kHamming).distance, 0.5);
  EXPECT_DOUBLE_EQ(Of(comparison, Measure::kDisparity).distance, 1);
  EXPECT_DOUBLE_EQ(Of(comparison, Measure::kGreyMean).distance, 0);
}

TEST(CompareRealism, ScalesToTheRealSizeIfSizesDifferMuch) {
  DriveMeasures half = Constant(100);
  half.rig = {{125, 125, 79.5, 49.5, kWidth / 2, kHeight / 2}, 0.4};
  const auto comparison = CompareRealism(half, Constant(100));
  EXPECT_TRUE(comparison.is_scaled);
  EXPECT_NEAR(Of(comparison, Measure::kWeakCorners).simulated.median, 400, 1e-9);
  EXPECT_NEAR(Of(comparison, Measure::kDisparity).simulated.median, 200, 1e-9);
  EXPECT_NEAR(Of(comparison, Measure::kHamming).simulated.median, 100, 1e-9);
  EXPECT_THAT(ToText(comparison), HasSubstr("scaled"));

  DriveMeasures similar = Constant(100);
  similar.rig.camera.width = kWidth + 10;
  EXPECT_FALSE(CompareRealism(similar, Constant(100)).is_scaled);
}

TEST(Distribution, PercentilesAreSamples) {
  const Distribution d = DistributionOf({10, 1, 2, 3, 4, 5, 6, 7, 8, 9});
  EXPECT_EQ(d.count, 10);
  EXPECT_EQ(d.p10, 1);
  EXPECT_EQ(d.median, 5);
  EXPECT_EQ(d.p90, 9);
  EXPECT_DOUBLE_EQ(d.mean, 5.5);
  EXPECT_EQ(DistributionOf({}).count, 0);
}

TEST(RealismReport, TellsEachMeasureOnce) {
  const auto comparison = CompareRealism(Constant(1.3), Constant(1));
  const nlohmann::ordered_json json = ToJson(comparison);
  EXPECT_EQ(json["measures"].size(), kMeasureCount);
  std::vector<std::string> keys;
  for (const auto& measure : json["measures"]) keys.push_back(measure["key"]);
  std::sort(keys.begin(), keys.end());
  EXPECT_EQ(std::unique(keys.begin(), keys.end()), keys.end());
  EXPECT_EQ(json["bounded"], kMeasureCount - 1);
  EXPECT_EQ(json["measures"][0]["ratio"], 1.3);

  std::vector<size_t> line_lengths;
  std::istringstream lines(ToText(comparison));
  std::string last;
  for (std::string line; std::getline(lines, line); last = line) {
    line_lengths.push_back(line.size());
  }
  EXPECT_THAT(line_lengths, Each(testing::Le(100)));
  EXPECT_THAT(last, HasSubstr(std::to_string(kMeasureCount - 2) + " of "));
}

int CountPixels(const cv::Mat& image, const cv::Scalar& bgr) {
  cv::Mat mask;
  cv::inRange(image, bgr - cv::Scalar::all(25), bgr + cv::Scalar::all(25), mask);
  return cv::countNonZero(mask);
}

TEST(Histograms, ShowBothSeriesWhereTheyLie) {
  const cv::Scalar first_bgr(181, 90, 0), second_bgr(32, 50, 220);
  HistogramPanel panel{"grey", {}, {}};
  for (int i = 0; i < 1000; ++i) {
    panel.first.push_back(0.01 * i);
    panel.second.push_back(20 + 0.01 * i);
  }
  const cv::Mat image = RenderHistograms("title", "a", "b", {panel});
  // Below the panel's name; its left third is the first series' alone, its right third the other's.
  const cv::Rect plot(30, 84 + 36, 340, 130);
  const cv::Mat left = image(cv::Rect(plot.x, plot.y, plot.width / 3 - 5, plot.height)),
                right = image(cv::Rect(plot.x + 2 * plot.width / 3 + 5, plot.y, plot.width / 3 - 5,
                                       plot.height));
  EXPECT_GT(CountPixels(left, first_bgr), 100);
  EXPECT_GT(CountPixels(right, second_bgr), 100);
  EXPECT_LT(CountPixels(right, first_bgr), 300);  // the base line of the other series at most
  EXPECT_GT(RenderHistograms("title", "a", "b", std::vector(5, panel)).rows, image.rows + 150);
}

TEST(Histograms, BearAnySamples) {
  const std::vector<HistogramPanel> panels = {{"none", {}, {}},
                                              {"one", {3}, {}},
                                              {"equal", {0, 0, 0}, {0, 0}},
                                              {"whole", {1, 2, 2, 3}, {2, 2, 40}},
                                              {"tiny", {1e-12, 2e-12}, {1e-12}},
                                              {"negative", {-5.5, -3.25}, {-4.125}}};
  EXPECT_GT(RenderHistograms("", "", "", panels).rows, 400);
  EXPECT_FALSE(RenderHistograms("", "", "", {}).empty());
}

}  // namespace
}  // namespace carmap
