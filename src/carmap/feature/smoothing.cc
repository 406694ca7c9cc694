#include "carmap/feature/smoothing.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

// What follows is compiled once for each kind of processor; the best of them runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "carmap/feature/smoothing.cc"
#include <hwy/foreach_target.h>
// After it:
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace carmap::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Words = hn::CappedTag<uint16_t, kMinSmoothedSide>;
using Bytes = hn::Rebind<uint8_t, Words>;
using Vector = hn::Vec<Words>;

constexpr int kRadius = 3;

/// Weighted sum of seven values of 8 bits, the Gaussian's weights in 256ths.
template <typename ValueAt>
Vector WeightedSum(const ValueAt& value_at) {
  const Words d;
  const auto weighted = [&](uint16_t weight, int distance) {
    return hn::Mul(hn::Set(d, weight), hn::Add(value_at(-distance), value_at(distance)));
  };
  const Vector outer = hn::Add(weighted(18, 3), weighted(34, 2));
  const Vector inner = hn::Add(weighted(48, 1), hn::Mul(hn::Set(d, uint16_t{56}), value_at(0)));
  return hn::Add(outer, inner);
}

/// Calls `visit(x)` for vectors of columns that cover all; the last one may overlap.
template <typename Visit>
void VisitColumns(int columns, const Visit& visit) {
  const int lanes = static_cast<int>(hn::Lanes(Words()));
  for (int x = 0; x < columns; x += lanes) visit(std::min(x, columns - lanes));
}

/// Down the columns: sums in 256ths of a grey value.
void SmoothDown(const std::array<const uint8_t*, 2 * kRadius + 1>& rows, int columns,
                uint16_t* sums) {
  const Words d;
  VisitColumns(columns, [&](int x) {
    const auto grey_at = [&](int dy) {
      return hn::PromoteTo(d, hn::LoadU(Bytes(), rows[kRadius + dy] + x));
    };
    hn::StoreU(WeightedSum(grey_at), d, sums + x);
  });
}

/// Along the row, rounded to whole grey values. The sum of products of 16 bits by 8 is that of the
/// upper bytes and that of the lower.
void SmoothAlong(const uint16_t* sums, int columns, uint8_t* smooth) {
  const Words d;
  const Vector low_byte = hn::Set(d, uint16_t{0xFF}), half = hn::Set(d, uint16_t{0x80});
  VisitColumns(columns, [&](int x) {
    const Vector upper =
        WeightedSum([&](int dx) { return hn::ShiftRight<8>(hn::LoadU(d, sums + x + dx)); });
    const Vector lower =
        WeightedSum([&](int dx) { return hn::And(hn::LoadU(d, sums + x + dx), low_byte); });
    const Vector rounded = hn::SaturatedAdd(upper, hn::Add(hn::ShiftRight<8>(lower), half));
    hn::StoreU(
        hn::DemoteTo(Bytes(), hn::BitCast(hn::RebindToSigned<Words>(), hn::ShiftRight<8>(rounded))),
        Bytes(), smooth + x);
  });
}

void SmoothImage(const cv::Mat& image, cv::Mat& smooth) {
  smooth.create(image.size(), CV_8UC1);
  std::vector<uint16_t> padded(image.cols + 2 * kRadius);
  uint16_t* sums = padded.data() + kRadius;
  for (int y = 0; y < image.rows; ++y) {
    std::array<const uint8_t*, 2 * kRadius + 1> rows;
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      const int row = std::abs(y + dy);  // mirrored at the top
      rows[kRadius + dy] = image.ptr<uint8_t>(std::min(row, 2 * (image.rows - 1) - row));
    }
    SmoothDown(rows, image.cols, sums);
    for (int i = 1; i <= kRadius; ++i) {
      sums[-i] = sums[i];
      sums[image.cols - 1 + i] = sums[image.cols - 1 - i];
    }
    SmoothAlong(sums, image.cols, smooth.ptr<uint8_t>(y));
  }
}

}  // namespace
}  // namespace carmap::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace carmap {

HWY_EXPORT(SmoothImage);

void SmoothImage(const cv::Mat& image, cv::Mat& smooth) {
  HWY_DYNAMIC_DISPATCH(SmoothImage)(image, smooth);
}

}  // namespace carmap
#endif  // HWY_ONCE
