#include "carmap/feature/corner_detector.h"

#include <algorithm>
#include <array>
#include <bit>

// What follows is compiled once for each kind of processor; the best of them runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "carmap/feature/corner_detector.cc"
#include <hwy/foreach_target.h>
// After it:
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace carmap::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Bytes = hn::ScalableTag<uint8_t>;
using Vector = hn::Vec<Bytes>;

// The Bresenham circle of radius 3, in order.
constexpr std::array<std::array<int, 2>, 16> kCircle = {{{0, -3},
                                                         {1, -3},
                                                         {2, -2},
                                                         {3, -1},
                                                         {3, 0},
                                                         {3, 1},
                                                         {2, 2},
                                                         {1, 3},
                                                         {0, 3},
                                                         {-1, 3},
                                                         {-2, 2},
                                                         {-3, 1},
                                                         {-3, 0},
                                                         {-3, -1},
                                                         {-2, -2},
                                                         {-1, -3}}};

auto AtLeast(Vector a, Vector b) { return hn::Eq(hn::Max(a, b), a); }

/// Largest, over all arcs of nine neighbours on the circle, of the least value on the arc. Two arcs
/// share the eight in their middle.
Vector BestArc(const std::array<Vector, 16>& circle) {
  std::array<Vector, 16> pairs, quads;  // from odd places on
  for (int i = 1; i < 16; i += 2) pairs[i] = hn::Min(circle[i], circle[(i + 1) % 16]);
  for (int i = 1; i < 16; i += 2) quads[i] = hn::Min(pairs[i], pairs[(i + 2) % 16]);
  Vector best = hn::Zero(Bytes());
  for (int i = 1; i < 16; i += 2) {
    const Vector eight = hn::Min(quads[i], quads[(i + 4) % 16]);
    best = hn::Max(best, hn::Min(eight, hn::Max(circle[i - 1], circle[(i + 8) % 16])));
  }
  return best;
}

/// An arc of nine covers at least two neighbouring compass points, so both of a pair must differ.
bool MayHoldCorner(const uint8_t* center, const std::array<ptrdiff_t, 16>& offsets,
                   Vector threshold) {
  const Bytes d;
  const Vector c = hn::LoadU(d, center);
  std::array<Vector, 4> brighter, darker;
  for (int i = 0; i < 4; ++i) {
    const Vector p = hn::LoadU(d, center + offsets[4 * i]);
    brighter[i] = hn::SaturatedSub(p, c);
    darker[i] = hn::SaturatedSub(c, p);
  }
  Vector best = hn::Zero(d);
  for (int i = 0; i < 4; ++i) {
    best = hn::Max(best, hn::Min(brighter[i], brighter[(i + 1) % 4]));
    best = hn::Max(best, hn::Min(darker[i], darker[(i + 1) % 4]));
  }
  return !hn::AllFalse(d, AtLeast(best, threshold));
}

Vector Scores(const uint8_t* center, const std::array<ptrdiff_t, 16>& offsets) {
  const Bytes d;
  const Vector c = hn::LoadU(d, center);
  std::array<Vector, 16> brighter, darker;
  for (int i = 0; i < 16; ++i) {
    const Vector p = hn::LoadU(d, center + offsets[i]);
    brighter[i] = hn::SaturatedSub(p, c);
    darker[i] = hn::SaturatedSub(c, p);
  }
  return hn::Max(BestArc(brighter), BestArc(darker));
}

/// Scores of one row, zero where below the threshold and right of x_end. Works in whole vectors:
/// the last one is moved left to end at x_end if it can, so it may compute some pixels twice.
void ScoreRow(const cv::Mat& image, int y, int x_begin, int x_end, uint8_t threshold,
              uint8_t* scores) {
  const Bytes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  std::array<ptrdiff_t, 16> offsets;
  for (int i = 0; i < 16; ++i) {
    offsets[i] = kCircle[i][0] + kCircle[i][1] * static_cast<ptrdiff_t>(image.step[0]);
  }
  const uint8_t* row = image.ptr<uint8_t>(y);
  const Vector limit = hn::Set(d, threshold);
  for (int x = x_begin; x < x_end; x += lanes) {
    x = std::max(x_begin, std::min(x, x_end - lanes));
    Vector score = hn::Zero(d);
    if (MayHoldCorner(row + x, offsets, limit)) {
      score = Scores(row + x, offsets);
      score = hn::IfThenElseZero(AtLeast(score, limit), score);
    }
    hn::StoreU(score, d, scores + x);
  }
  std::fill(scores + x_end, scores + std::max(x_end, x_begin + lanes), uint8_t{0});
}

/// The image with as many more columns as whole vectors from x_begin on need. They do not matter.
cv::Mat WideEnough(const cv::Mat& image, int x_begin, int x_end, int lanes) {
  if (x_end - x_begin >= lanes) return image;
  cv::Mat wide = cv::Mat::zeros(image.rows, image.cols + lanes, CV_8UC1);
  image.copyTo(wide.colRange(0, image.cols));
  return wide;
}

/// Appends the pixels of the middle row that are local maxima. Of equal neighbours the first wins.
void CollectMaxima(const uint8_t* above, const uint8_t* middle, const uint8_t* below, int y,
                   int x_begin, int x_end, std::vector<Corner>& corners) {
  const Bytes d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int x = x_begin; x < x_end; x += lanes) {
    const Vector score = hn::LoadU(d, middle + x);
    if (hn::AllTrue(d, hn::Eq(score, hn::Zero(d)))) continue;
    const Vector before =
        hn::Max(hn::Max(hn::LoadU(d, above + x - 1), hn::LoadU(d, above + x)),
                hn::Max(hn::LoadU(d, above + x + 1), hn::LoadU(d, middle + x - 1)));
    const Vector after =
        hn::Max(hn::Max(hn::LoadU(d, below + x - 1), hn::LoadU(d, below + x)),
                hn::Max(hn::LoadU(d, below + x + 1), hn::LoadU(d, middle + x + 1)));
    const auto is_maximum = hn::And(hn::Gt(score, before), AtLeast(score, after));
    uint64_t bits = 0;  // a lane each
    hn::StoreMaskBits(d, is_maximum, reinterpret_cast<uint8_t*>(&bits));
    for (; bits != 0; bits &= bits - 1) {
      const int maximum_x = x + std::countr_zero(bits);
      if (maximum_x >= x_end) break;
      corners.push_back(
          {static_cast<int16_t>(maximum_x), static_cast<int16_t>(y), middle[maximum_x]});
    }
  }
}

std::vector<Corner> DetectCorners(const cv::Mat& image, int threshold, int margin) {
  std::vector<Corner> corners;
  const int lanes = static_cast<int>(hn::Lanes(Bytes()));
  const int x_begin = margin, x_end = image.cols - margin;
  if (x_end <= x_begin || image.rows <= 2 * margin) return corners;
  const cv::Mat wide_image = WideEnough(image, x_begin, x_end, lanes);

  // Scores of three neighbouring rows, with room for whole vectors around them.
  const int stride = image.cols + 2 * lanes;
  std::vector<uint8_t> buffer(3 * static_cast<size_t>(stride), 0);
  const auto scores_of = [&](int y) { return buffer.data() + (y % 3) * stride + lanes; };
  const auto fill = [&](int y) {
    if (y >= margin && y < image.rows - margin) {
      ScoreRow(wide_image, y, x_begin, x_end, static_cast<uint8_t>(threshold), scores_of(y));
    } else {
      std::fill_n(scores_of(y), image.cols, uint8_t{0});
    }
  };
  fill(margin - 1);
  fill(margin);
  for (int y = margin; y < image.rows - margin; ++y) {
    fill(y + 1);
    CollectMaxima(scores_of(y - 1), scores_of(y), scores_of(y + 1), y, x_begin, x_end, corners);
  }
  return corners;
}

}  // namespace
}  // namespace carmap::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace carmap {

HWY_EXPORT(DetectCorners);

std::vector<Corner> DetectCorners(const cv::Mat& image, int threshold, int margin) {
  return HWY_DYNAMIC_DISPATCH(DetectCorners)(image, threshold, margin);
}

}  // namespace carmap
#endif  // HWY_ONCE
