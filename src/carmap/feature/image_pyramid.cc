#include "carmap/feature/image_pyramid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

// What follows is compiled once for each kind of processor; the best of them runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "carmap/feature/image_pyramid.cc"
#include <hwy/foreach_target.h>
// After it:
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace carmap::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int kMaxLanes = 8;
constexpr int kBlock = 16;  // pixels that so many of the next level lie between
using Whole = hn::CappedTag<int32_t, kMaxLanes>;
using Bytes = hn::Repartition<uint8_t, Whole>;
using Halves = hn::Rebind<int16_t, Whole>;
using Words = hn::CappedTag<int16_t, 2 * kMaxLanes>;

/// For each pixel of a row (or column) the one before its place in the larger image, and the
/// weights of that and of the next, in 2048ths.
struct Interpolation {
  std::vector<int> first;
  std::vector<int16_t> first_weight, second_weight;

  Interpolation(int large_size, int small_size) {
    for (int i = 0; i < small_size; ++i) {
      const auto place = static_cast<float>(FullSizeFromLevel(i, kLevelScale));
      const int before = std::clamp(static_cast<int>(std::floor(place)), 0, large_size - 2);
      const float part = std::clamp(place - static_cast<float>(before), 0.0f, 1.0f);
      first.push_back(before);
      first_weight.push_back(static_cast<int16_t>(std::lrint((1 - part) * 2048)));
      second_weight.push_back(static_cast<int16_t>(std::lrint(part * 2048)));
    }
  }
};

/// Weighted means of neighbours along a row, in 128ths of a grey value. A vector of them lies
/// within one block of the larger row, out of which its pixels are picked.
class RowShrinker {
 public:
  RowShrinker(int large_columns, int small_columns) {
    const Interpolation columns(large_columns, small_columns);
    const int lanes = static_cast<int>(hn::Lanes(Whole()));
    for (int x = 0; x < small_columns; x += lanes) {
      const int begin = std::min(x, small_columns - lanes);
      Step& step = steps_.emplace_back();
      step.small_x = begin;
      step.large_x = std::min(columns.first[begin], large_columns - kBlock - 1);
      for (int i = 0; i < lanes; ++i) {
        step.pick[4 * i] = static_cast<uint8_t>(columns.first[begin + i] - step.large_x);
        step.first_weight[i] = columns.first_weight[begin + i];
        step.second_weight[i] = columns.second_weight[begin + i];
      }
    }
  }

  void Shrink(const uint8_t* large, int16_t* small) const {
    const Whole d;
    for (const Step& step : steps_) {
      const auto pick = hn::LoadU(Bytes(), step.pick.data());
      const auto picked = [&](const uint8_t* block) {
        return hn::BitCast(d, hn::TableLookupBytesOr0(hn::LoadDup128(Bytes(), block), pick));
      };
      const auto first =
          hn::Mul(picked(large + step.large_x), hn::LoadU(d, step.first_weight.data()));
      const auto second =
          hn::Mul(picked(large + step.large_x + 1), hn::LoadU(d, step.second_weight.data()));
      const auto mean = hn::ShiftRight<4>(hn::Add(first, second));
      hn::StoreU(hn::DemoteTo(Halves(), mean), Halves(), small + step.small_x);
    }
  }

 private:
  struct Step {
    Step() { pick.fill(0x80); }  // nothing, which widens the bytes that are picked

    int small_x, large_x;
    std::array<uint8_t, 4 * kMaxLanes> pick;
    std::array<int32_t, kMaxLanes> first_weight, second_weight;
  };
  std::vector<Step> steps_;
};

/// Weighted means of two rows of 128ths, rounded to whole grey values.
void MixRows(const int16_t* first, int16_t first_weight, const int16_t* second,
             int16_t second_weight, int columns, uint8_t* mixed) {
  const Words d;
  const hn::Rebind<uint8_t, Words> bytes;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int i = 0; i < columns; i += lanes) {
    const int x = std::min(i, columns - lanes);
    const auto fourths = hn::Add(hn::MulHigh(hn::LoadU(d, first + x), hn::Set(d, first_weight)),
                                 hn::MulHigh(hn::LoadU(d, second + x), hn::Set(d, second_weight)));
    const auto rounded = hn::ShiftRight<2>(hn::Add(fourths, hn::Set(d, int16_t{2})));
    hn::StoreU(hn::DemoteTo(bytes, rounded), bytes, mixed + x);
  }
}

void ShrinkImage(const cv::Mat& large, cv::Mat& small) {
  const RowShrinker shrinker(large.cols, small.cols);
  const Interpolation rows(large.rows, small.rows);
  std::vector<int16_t> first(small.cols), second(small.cols);
  int next_row = 0;  // of the larger image, to be shrunk
  for (int y = 0; y < small.rows; ++y) {
    for (; next_row <= rows.first[y] + 1; ++next_row) {
      std::swap(first, second);
      shrinker.Shrink(large.ptr<uint8_t>(next_row), second.data());
    }
    MixRows(first.data(), rows.first_weight[y], second.data(), rows.second_weight[y], small.cols,
            small.ptr<uint8_t>(y));
  }
}

/// As cv::resize does, in less time.
void ShrinkByOneLevel(const cv::Mat& large, cv::Mat& small) {
  const cv::Size size(cvRound(large.cols / kLevelScale), cvRound(large.rows / kLevelScale));
  if (size.width < 2 * kMaxLanes || large.cols <= kBlock || large.rows < 2) {
    cv::resize(large, small, {}, 1 / kLevelScale, 1 / kLevelScale, cv::INTER_LINEAR);
    return;
  }
  small.create(size, CV_8UC1);
  ShrinkImage(large, small);
}

}  // namespace
}  // namespace carmap::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace carmap {

HWY_EXPORT(ShrinkByOneLevel);

ImagePyramid BuildPyramid(const cv::Mat& image, ImagePyramid pyramid) {
  pyramid[0] = image;
  for (int level = 1; level < kLevelCount; ++level) {
    HWY_DYNAMIC_DISPATCH(ShrinkByOneLevel)(pyramid[level - 1], pyramid[level]);
  }
  return pyramid;
}

}  // namespace carmap
#endif  // HWY_ONCE
