#include "carmap/eval/image_measures.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <opencv2/core.hpp>
#include <vector>

#include "carmap/feature/corner_detector.h"

namespace carmap {
namespace {

constexpr int kSaturated = 255;

/// The value below which this share of a histogram lies.
double Percentile(const std::vector<size_t>& histogram, double share) {
  const auto count =
      static_cast<double>(std::accumulate(histogram.begin(), histogram.end(), size_t{0}));
  double below = 0;
  for (size_t i = 0; i < histogram.size(); ++i) {
    below += static_cast<double>(histogram[i]);
    if (below >= share * count) return static_cast<double>(i);
  }
  return 0;
}

void MeasureGradients(const cv::Mat& image, GreyMeasures& measures) {
  constexpr double kBinsPerGrey = 10;
  std::vector<size_t> histogram(static_cast<size_t>(kBinsPerGrey * 256));
  for (int y = 1; y + 1 < image.rows; ++y) {
    const uint8_t *above = image.ptr<uint8_t>(y - 1), *row = image.ptr<uint8_t>(y),
                  *below = image.ptr<uint8_t>(y + 1);
    for (int x = 1; x + 1 < image.cols; ++x) {
      const double dx = 0.5 * (row[x + 1] - row[x - 1]), dy = 0.5 * (below[x] - above[x]);
      ++histogram[static_cast<size_t>(std::lround(kBinsPerGrey * std::sqrt(dx * dx + dy * dy)))];
    }
  }
  measures.gradient_median = Percentile(histogram, 0.5) / kBinsPerGrey;
  measures.gradient_p90 = Percentile(histogram, 0.9) / kBinsPerGrey;
}

double FlatNoise(const cv::Mat& image) {
  constexpr int kSide = 8, kArea = kSide * kSide;
  std::vector<double> spreads;
  for (int y0 = 0; y0 + kSide <= image.rows; y0 += kSide) {
    for (int x0 = 0; x0 + kSide <= image.cols; x0 += kSide) {
      int sum = 0, squares = 0;
      bool is_saturated = false;
      for (int y = y0; y < y0 + kSide; ++y) {
        for (int x = x0; x < x0 + kSide; ++x) {
          const int grey = image.at<uint8_t>(y, x);
          sum += grey;
          squares += grey * grey;
          is_saturated |= grey == kSaturated;
        }
      }
      if (is_saturated) continue;
      spreads.push_back(std::sqrt(kArea * squares - sum * sum) / kArea);
    }
  }
  if (spreads.empty()) return 0;
  const auto tenth = spreads.begin() + static_cast<std::ptrdiff_t>(spreads.size() / 10);
  std::nth_element(spreads.begin(), tenth, spreads.end());
  return *tenth;
}

/// Sums the power of a square tile under a Hann window over three octaves of frequency, the last
/// up to half a cycle a pixel.
class OctavePower {
 public:
  explicit OctavePower(int side) : side_(side), hann_(side) {
    for (int i = 0; i < side; ++i) {
      hann_[i] = static_cast<float>(0.5 - 0.5 * std::cos(2 * std::numbers::pi * (i + 0.5) / side));
    }
  }

  void Add(const cv::Mat& tile) {
    const auto mean = static_cast<float>(cv::mean(tile)[0]);
    cv::Mat windowed(side_, side_, CV_32F);
    for (int y = 0; y < side_; ++y) {
      for (int x = 0; x < side_; ++x) {
        windowed.at<float>(y, x) =
            hann_[y] * hann_[x] * (static_cast<float>(tile.at<uint8_t>(y, x)) - mean);
      }
    }
    cv::Mat spectrum;
    cv::dft(windowed, spectrum, cv::DFT_COMPLEX_OUTPUT);
    for (int y = 0; y < side_; ++y) {
      const int fy = std::min(y, side_ - y);
      for (int x = 0; x <= side_ / 2; ++x) {
        const int octave = OctaveOf(x * x + fy * fy);
        if (octave < 0) continue;
        const auto& value = spectrum.at<cv::Vec2f>(y, x);
        power_[octave] += value[0] * value[0] + value[1] * value[1];
        ++count_[octave];
      }
    }
  }

  /// n of 1/f^n between this octave and the next.
  double Fall(int octave) const {
    const double here = power_[octave] / std::max(count_[octave], 1.0),
                 next = power_[octave + 1] / std::max(count_[octave + 1], 1.0);
    return here > 0 && next > 0 ? std::log2(here / next) : 0;
  }

 private:
  static constexpr int kOctaves = 3;

  /// From 1/16 to 1/8 cycles a pixel, to 1/4, to 1/2; -1 outside.
  int OctaveOf(int squared_cycles) const {
    for (int octave = 0; octave < kOctaves; ++octave) {
      const int from = side_ >> (kOctaves + 1 - octave), to = 2 * from;
      if (squared_cycles >= from * from && squared_cycles < to * to) return octave;
    }
    return -1;
  }

  const int side_;
  std::vector<float> hann_;
  std::array<double, kOctaves> power_{}, count_{};
};

void MeasureSpectrum(const cv::Mat& image, GreyMeasures& measures) {
  constexpr int kMaxSide = 128;
  const auto shorter = static_cast<unsigned>(std::min(image.rows, image.cols));
  const int side = std::min(kMaxSide, static_cast<int>(std::bit_floor(shorter)));
  OctavePower power(side);
  for (int y = 0; y + side <= image.rows; y += side) {
    for (int x = 0; x + side <= image.cols; x += side) power.Add(image({x, y, side, side}));
  }
  measures.spectrum_coarse = power.Fall(0);
  measures.spectrum_fine = power.Fall(1);
}

constexpr int kPatchRadius = 5, kPatchSide = 2 * kPatchRadius + 1;
using Patch = Eigen::Matrix<float, kPatchSide, kPatchSide, Eigen::RowMajor>;

/// Bilinear. Nothing if the patch is not all inside.
std::optional<Patch> SamplePatch(const cv::Mat& image, double x, double y) {
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  if (x0 < kPatchRadius || y0 < kPatchRadius || x0 + kPatchRadius + 1 >= image.cols ||
      y0 + kPatchRadius + 1 >= image.rows) {
    return std::nullopt;
  }
  const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  Patch patch;
  for (int row = 0; row < kPatchSide; ++row) {
    const uint8_t* a = image.ptr<uint8_t>(y0 - kPatchRadius + row, x0 - kPatchRadius);
    const uint8_t* b = a + image.step[0];
    for (int i = 0; i < kPatchSide; ++i) {
      const float upper = (1 - fx) * a[i] + fx * a[i + 1], lower = (1 - fx) * b[i] + fx * b[i + 1];
      patch(row, i) = (1 - fy) * upper + fy * lower;
    }
  }
  return patch;
}

/// Squared difference but for brightness.
double ShapeDifference(const Patch& a, const Patch& b) {
  const Patch difference = a - b;
  return (difference.array() - difference.mean()).square().sum();
}

/// The row offset of the best fit between three equally spaced samples of which the middle one is
/// best: the bottom of the parabola through them.
double RefineOffset(double middle, double step, double before, double at, double after) {
  const double curvature = before - 2 * at + after;
  return curvature > 0 ? middle + 0.5 * step * (before - after) / curvature : middle;
}

/// The offset, in rows of `image`, at which it looks most like the patch near (x, y).
std::optional<double> FindRowOffset(const Patch& patch, const cv::Mat& image, double x, double y) {
  constexpr double kStepPx = 0.5;
  constexpr int kSteps = 3, kSamples = 2 * kSteps + 1;
  std::array<double, kSamples> differences;
  for (int i = 0; i < kSamples; ++i) {
    const auto there = SamplePatch(image, x, y + kStepPx * (i - kSteps));
    if (!there) return std::nullopt;
    differences[i] = ShapeDifference(patch, *there);
  }
  const auto best = static_cast<int>(std::min_element(differences.begin(), differences.end()) -
                                     differences.begin());
  const double offset_px = kStepPx * (best - kSteps);
  if (best == 0 || best == kSamples - 1) return offset_px;
  return RefineOffset(offset_px, kStepPx, differences[best - 1], differences[best],
                      differences[best + 1]);
}

}  // namespace

GreyMeasures MeasureGrey(const cv::Mat& image) {
  GreyMeasures measures;
  cv::Scalar mean, spread;
  cv::meanStdDev(image, mean, spread);
  measures.mean = mean[0];
  measures.spread = spread[0];
  measures.saturated_percent =
      100.0 * cv::countNonZero(image == kSaturated) / static_cast<double>(image.total());
  MeasureGradients(image, measures);
  measures.flat_noise = FlatNoise(image);
  MeasureSpectrum(image, measures);
  return measures;
}

CornerCounts CountCorners(const ImagePyramid& pyramid) {
  constexpr int kStrong = 20, kWeak = 7, kMarginPx = 16;
  CornerCounts counts;
  for (int level = 0; level < kLevelCount; ++level) {
    // A corner's neighbours of higher score suppress it whatever the threshold, so the strong ones
    // are among the weak ones.
    const std::vector<Corner> corners = DetectCorners(pyramid[level], kWeak, kMarginPx);
    counts.weak += static_cast<int>(corners.size());
    counts.strong[level] = static_cast<int>(std::count_if(
        corners.begin(), corners.end(), [](const Corner& c) { return c.score >= kStrong; }));
  }
  return counts;
}

std::optional<StereoFit> MeasureStereoFit(const ImagePyramid& left, const ImagePyramid& right,
                                          const Feature& feature) {
  if (!feature.has_disparity()) return std::nullopt;
  const double scale = ScaleOfLevel(feature.level);
  const double x = std::round(LevelFromFullSize(feature.x_px, scale)),
               y = std::round(LevelFromFullSize(feature.y_px, scale));
  const double right_x = x - feature.disparity_px / scale;
  const auto patch = SamplePatch(left[feature.level], x, y);
  if (!patch) return std::nullopt;
  const auto offset_px = FindRowOffset(*patch, right[feature.level], right_x, y);
  if (!offset_px) return std::nullopt;
  const auto there = SamplePatch(right[feature.level], right_x, y + *offset_px);
  if (!there) return std::nullopt;
  return StereoFit{.difference = (*there - *patch).cwiseAbs().mean(),
                   .brightness = (*there - *patch).mean(),
                   .row_offset_px = *offset_px};
}

}  // namespace carmap
