#include "carmap/feature/patch_alignment.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

// What follows is compiled once for each kind of processor; the best of them runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "carmap/feature/patch_alignment.cc"
#include <hwy/foreach_target.h>
// After it:
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace carmap::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int kRadius = kAlignmentRadius;
constexpr int kSide = 2 * kRadius + 1;

/// A value for each pixel of a patch, in rows of whole vectors: sums over it run lane by lane.
constexpr int kLanes = kAlignmentRadius + kAlignmentRightPx;
using PatchRow = std::array<float, kLanes>;
using PatchValues = std::array<PatchRow, kSide>;

float Sum(const PatchRow& lanes) { return std::accumulate(lanes.begin(), lanes.end(), 0.0f); }

/// The middle counts most: what lies around a corner is often nearer or farther than it, and would
/// draw its disparity there. Zero beyond the patch.
struct PatchWeights {
  PatchWeights() {
    constexpr double kSigmaPx = 2.5;
    PatchRow sums{};
    for (int row = 0; row < kSide; ++row) {
      for (int i = 0; i < kSide; ++i) {
        const double square_px = std::pow(row - kRadius, 2) + std::pow(i - kRadius, 2);
        of_pixel[row][i] = static_cast<float>(std::exp(-square_px / (2 * kSigmaPx * kSigmaPx)));
        sums[i] += of_pixel[row][i];
      }
    }
    sum = Sum(sums);
  }
  static const PatchWeights& Get() {
    static const PatchWeights weights;
    return weights;
  }

  PatchValues of_pixel{};
  float sum = 0;
};

/// The patch of the left image with its gradients, made once and compared with several places of
/// the right image.
struct PatchTemplate {
  PatchValues grey, weighted_gx, weighted_gy;
  Eigen::Matrix3f inverse;  ///< of the normal equations in x, y and brightness
};

using Floats = hn::CappedTag<float, kLanes>;

hn::Vec<Floats> LoadGreys(const uint8_t* pixels) {
  const Floats f;
  const hn::Rebind<uint8_t, Floats> bytes;
  const hn::Rebind<int32_t, Floats> whole;
  return hn::ConvertTo(f, hn::PromoteTo(whole, hn::LoadU(bytes, pixels)));
}

// Products and sums one by one, never fused: not all processors could.
PatchTemplate MakeTemplate(const cv::Mat& image, int x, int y) {
  const Floats f;
  const auto step = static_cast<ptrdiff_t>(image.step[0]);
  const auto half = hn::Set(f, 0.5f);
  const PatchWeights& weights = PatchWeights::Get();
  PatchTemplate patch;
  std::array<PatchRow, 5> sums;
  for (size_t i = 0; i < kLanes; i += hn::Lanes(f)) {
    auto xx = hn::Zero(f), xy = xx, yy = xx, x1 = xx, y1 = xx;
    for (int row = 0; row < kSide; ++row) {
      const uint8_t* p = image.ptr<uint8_t>(y - kRadius + row, x - kRadius) + i;
      const auto weight = hn::LoadU(f, &weights.of_pixel[row][i]);
      const auto gx = hn::Mul(half, hn::Sub(LoadGreys(p + 1), LoadGreys(p - 1)));
      const auto gy = hn::Mul(half, hn::Sub(LoadGreys(p + step), LoadGreys(p - step)));
      const auto weighted_gx = hn::Mul(weight, gx), weighted_gy = hn::Mul(weight, gy);
      hn::StoreU(LoadGreys(p), f, &patch.grey[row][i]);
      hn::StoreU(weighted_gx, f, &patch.weighted_gx[row][i]);
      hn::StoreU(weighted_gy, f, &patch.weighted_gy[row][i]);
      xx = hn::Add(xx, hn::Mul(weighted_gx, gx));
      xy = hn::Add(xy, hn::Mul(weighted_gx, gy));
      yy = hn::Add(yy, hn::Mul(weighted_gy, gy));
      x1 = hn::Add(x1, weighted_gx);
      y1 = hn::Add(y1, weighted_gy);
    }
    hn::StoreU(xx, f, &sums[0][i]);
    hn::StoreU(xy, f, &sums[1][i]);
    hn::StoreU(yy, f, &sums[2][i]);
    hn::StoreU(x1, f, &sums[3][i]);
    hn::StoreU(y1, f, &sums[4][i]);
  }
  const float xx = Sum(sums[0]), xy = Sum(sums[1]), yy = Sum(sums[2]), x1 = Sum(sums[3]),
              y1 = Sum(sums[4]);
  Eigen::Matrix3f normal;
  normal << xx, xy, x1, xy, yy, y1, x1, y1, weights.sum;
  patch.inverse = (normal + 1e-3f * Eigen::Matrix3f::Identity()).inverse();
  return patch;
}

/// Gauss-Newton step from (x, y) of `image` towards the place that looks like the template. The
/// third unknown, solved and dropped, is a difference in brightness between the cameras.
Eigen::Vector2d StepTowards(const PatchTemplate& patch, const cv::Mat& image, double x, double y) {
  const Floats f;
  const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
  const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  const auto w00 = hn::Set(f, (1 - fx) * (1 - fy)), w01 = hn::Set(f, fx * (1 - fy)),
             w10 = hn::Set(f, (1 - fx) * fy), w11 = hn::Set(f, fx * fy);
  const PatchWeights& weights = PatchWeights::Get();
  std::array<PatchRow, 3> sums;
  for (size_t i = 0; i < kLanes; i += hn::Lanes(f)) {
    const uint8_t* p = image.ptr<uint8_t>(y0 - kRadius, x0 - kRadius) + i;
    auto above = LoadGreys(p), above_right = LoadGreys(p + 1);
    auto sum_x = hn::Zero(f), sum_y = sum_x, sum_1 = sum_x;
    for (int row = 0; row < kSide; ++row) {
      p += image.step[0];
      const auto below = LoadGreys(p), below_right = LoadGreys(p + 1);
      auto grey = hn::Add(hn::Mul(w00, above), hn::Mul(w01, above_right));
      grey = hn::Add(grey, hn::Mul(w10, below));
      grey = hn::Add(grey, hn::Mul(w11, below_right));
      const auto error = hn::Sub(hn::LoadU(f, &patch.grey[row][i]), grey);
      sum_x = hn::Add(sum_x, hn::Mul(error, hn::LoadU(f, &patch.weighted_gx[row][i])));
      sum_y = hn::Add(sum_y, hn::Mul(error, hn::LoadU(f, &patch.weighted_gy[row][i])));
      sum_1 = hn::Add(sum_1, hn::Mul(error, hn::LoadU(f, &weights.of_pixel[row][i])));
      above = below;
      above_right = below_right;
    }
    hn::StoreU(sum_x, f, &sums[0][i]);
    hn::StoreU(sum_y, f, &sums[1][i]);
    hn::StoreU(sum_1, f, &sums[2][i]);
  }
  return (patch.inverse * Eigen::Vector3f(Sum(sums[0]), Sum(sums[1]), Sum(sums[2])))
      .head<2>()
      .cast<double>();
}

std::optional<Eigen::Vector2d> AlignPatch(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                          const Eigen::Vector2d& start, double max_offset_px) {
  const PatchTemplate patch = MakeTemplate(left, x, y);
  Eigen::Vector2d place = start;
  for (int iteration = 0; iteration < 6; ++iteration) {
    if (place.x() < kRadius + 1 || place.x() > right.cols - kAlignmentRightPx - 2 ||
        place.y() < kRadius + 1 || place.y() > right.rows - kRadius - 3) {
      return std::nullopt;
    }
    const Eigen::Vector2d step = StepTowards(patch, right, place.x(), place.y());
    place += step;
    if (!((place - start).cwiseAbs().maxCoeff() < std::max(1.5, max_offset_px)))
      return std::nullopt;
    if (step.squaredNorm() < 1e-4) break;
  }
  if (std::abs(place.y() - y) > max_offset_px) return std::nullopt;
  return place;
}

}  // namespace
}  // namespace carmap::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace carmap {

HWY_EXPORT(AlignPatch);

bool CanAlign(const cv::Mat& image, int x, int y) {
  return x >= kAlignmentRadius + 1 && x < image.cols - kAlignmentRightPx &&
         y >= kAlignmentRadius + 1 && y < image.rows - kAlignmentRadius - 1;
}

std::optional<Eigen::Vector2d> AlignPatch(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                          const Eigen::Vector2d& start, double max_offset_px) {
  return HWY_DYNAMIC_DISPATCH(AlignPatch)(left, x, y, right, start, max_offset_px);
}

}  // namespace carmap
#endif  // HWY_ONCE
