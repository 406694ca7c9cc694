#include "carmap/feature/stereo_matcher.h"

#include <hwy/highway.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "carmap/feature/feature_grid.h"

namespace carmap {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr int kRadius = 5;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kLoadBytes = 16;  // of which kSide count

using Bytes = hn::FixedTag<uint8_t, kLoadBytes>;
using PatchRows = std::array<hn::Vec<Bytes>, kSide>;

hn::Vec<Bytes> LoadRow(const uint8_t* pixels) {
  const Bytes d;
  return hn::IfThenElseZero(hn::FirstN(d, kSide), hn::LoadU(d, pixels));
}

hn::Vec<Bytes> AbsoluteDifference(hn::Vec<Bytes> a, hn::Vec<Bytes> b) {
  return hn::Or(hn::SaturatedSub(a, b), hn::SaturatedSub(b, a));
}

PatchRows LoadPatch(const cv::Mat& image, int x, int y) {
  PatchRows rows;
  for (int i = 0; i < kSide; ++i)
    rows[i] = LoadRow(image.ptr<uint8_t>(y - kRadius + i, x - kRadius));
  return rows;
}

/// Sum of absolute grey differences between a patch and the image around (x, y).
int Difference(const PatchRows& patch, const cv::Mat& image, int x, int y) {
  const hn::FixedTag<uint64_t, 2> sums;
  auto sum = hn::Zero(sums);
  const uint8_t* pixels = image.ptr<uint8_t>(y - kRadius, x - kRadius);
  for (int i = 0; i < kSide; ++i, pixels += image.step[0]) {
    sum = hn::Add(sum, hn::SumsOf8(AbsoluteDifference(patch[i], LoadRow(pixels))));
  }
  return static_cast<int>(hn::GetLane(hn::SumOfLanes(sums, sum)));
}

/// Best x along the row, unless another place is almost as good.
std::optional<int> SearchRow(const PatchRows& patch, const cv::Mat& right, int y, int x_first,
                             int x_last, const StereoOptions& options,
                             std::vector<int>& differences) {
  differences.resize(x_last - x_first + 1);
  for (int x = x_first; x <= x_last; ++x) differences[x - x_first] = Difference(patch, right, x, y);
  const auto best = std::min_element(differences.begin(), differences.end());
  if (*best > options.max_mean_difference * kSide * kSide) return std::nullopt;
  int second = std::numeric_limits<int>::max();
  for (auto other = differences.begin(); other != differences.end(); ++other) {
    if (std::abs(other - best) > 2) second = std::min(second, *other);
  }
  if (second <= options.uniqueness * *best) return std::nullopt;
  return x_first + static_cast<int>(best - differences.begin());
}

/// A value for each pixel of a patch, in rows of whole vectors: sums over it run lane by lane.
constexpr int kLanes = 16;
using PatchValues = std::array<std::array<float, kLanes>, kSide>;

float Sum(const std::array<float, kLanes>& lanes) {
  return std::accumulate(lanes.begin(), lanes.end(), 0.0f);
}

/// The middle counts most: what lies around a corner is often nearer or farther than it, and would
/// draw its disparity there. Zero beyond the patch.
struct PatchWeights {
  PatchWeights() {
    constexpr double kSigmaPx = 2.5;
    std::array<float, kLanes> sums{};
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

/// The patch around (x, y) of the left image with its gradients, made once and compared with
/// several places of the right image.
class PatchTemplate {
 public:
  PatchTemplate(const cv::Mat& image, int x, int y) : weights_(PatchWeights::Get()) {
    const auto step = static_cast<ptrdiff_t>(image.step[0]);
    std::array<std::array<float, kLanes>, 5> sums{};
    for (int row = 0; row < kSide; ++row) {
      const uint8_t* p = image.ptr<uint8_t>(y - kRadius + row, x - kRadius);
      for (int i = 0; i < kLanes; ++i) {
        const float weight = weights_.of_pixel[row][i];
        const float gx = 0.5f * static_cast<float>(p[i + 1] - p[i - 1]);
        const float gy = 0.5f * static_cast<float>(p[i + step] - p[i - step]);
        grey_[row][i] = p[i];
        weighted_gx_[row][i] = weight * gx;
        weighted_gy_[row][i] = weight * gy;
        sums[0][i] += weight * gx * gx;
        sums[1][i] += weight * gx * gy;
        sums[2][i] += weight * gy * gy;
        sums[3][i] += weight * gx;
        sums[4][i] += weight * gy;
      }
    }
    const float xx = Sum(sums[0]), xy = Sum(sums[1]), yy = Sum(sums[2]), x1 = Sum(sums[3]),
                y1 = Sum(sums[4]);
    Eigen::Matrix3f normal;
    normal << xx, xy, x1, xy, yy, y1, x1, y1, weights_.sum;
    inverse_ = (normal + 1e-3f * Eigen::Matrix3f::Identity()).inverse();
  }

  /// Gauss-Newton step from (x, y) of `image` towards the place that looks like the template. The
  /// third unknown, solved and dropped, is a difference in brightness between the cameras.
  Eigen::Vector2d StepTowards(const cv::Mat& image, double x, double y) const {
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
    const float w00 = (1 - fx) * (1 - fy), w01 = fx * (1 - fy), w10 = (1 - fx) * fy, w11 = fx * fy;
    std::array<std::array<float, kLanes>, 3> sums{};
    for (int row = 0; row < kSide; ++row) {
      const uint8_t* a = image.ptr<uint8_t>(y0 - kRadius + row, x0 - kRadius);
      const uint8_t* b = a + image.step[0];
      for (int i = 0; i < kLanes; ++i) {
        const float error =
            grey_[row][i] - (w00 * a[i] + w01 * a[i + 1] + w10 * b[i] + w11 * b[i + 1]);
        sums[0][i] += error * weighted_gx_[row][i];
        sums[1][i] += error * weighted_gy_[row][i];
        sums[2][i] += error * weights_.of_pixel[row][i];
      }
    }
    return (inverse_ * Eigen::Vector3f(Sum(sums[0]), Sum(sums[1]), Sum(sums[2])))
        .head<2>()
        .cast<double>();
  }

 private:
  const PatchWeights& weights_;
  PatchValues grey_, weighted_gx_, weighted_gy_;
  Eigen::Matrix3f inverse_;
};

/// Place in `right` whose surroundings look most like those of (x, y) in `left`, near `start`.
std::optional<Eigen::Vector2d> RefineMatch(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                           const Eigen::Vector2d& start, double max_row_offset_px) {
  const PatchTemplate patch(left, x, y);
  Eigen::Vector2d place = start;
  for (int iteration = 0; iteration < 6; ++iteration) {
    if (place.x() < kRadius + 1 || place.x() > right.cols - kLanes + kRadius - 2 ||
        place.y() < kRadius + 1 || place.y() > right.rows - kRadius - 3) {
      return std::nullopt;
    }
    const Eigen::Vector2d step = patch.StepTowards(right, place.x(), place.y());
    place += step;
    if (!((place - start).cwiseAbs().maxCoeff() < std::max(1.5, max_row_offset_px)))
      return std::nullopt;
    if (step.squaredNorm() < 1e-4) break;
  }
  if (std::abs(place.y() - y) > max_row_offset_px) return std::nullopt;
  return place;
}

float FindDisparity(const Feature& feature, const ImagePyramid& left, const ImagePyramid& right,
                    const StereoRig& rig, const StereoOptions& options, std::vector<int>& scratch) {
  const double scale = ScaleOfLevel(feature.level);
  const cv::Mat& left_image = left[feature.level];
  const cv::Mat& right_image = right[feature.level];
  const int x = static_cast<int>(std::lround(LevelFromFullSize(feature.x_px, scale)));
  const int y = static_cast<int>(std::lround(LevelFromFullSize(feature.y_px, scale)));
  const double max_disparity = rig.DisparityAt(options.min_depth_m) / scale;
  const int x_first = std::max(kRadius + 1, static_cast<int>(x - max_disparity));
  const int x_last = std::min(x + 1, right_image.cols - kLoadBytes + kRadius - 1);
  const bool patch_is_inside = x >= kRadius + 1 && x <= left_image.cols - kLanes + kRadius - 1 &&
                               y >= kRadius + 1 && y < left_image.rows - kRadius - 1;
  if (!patch_is_inside || x_last < x_first) return Feature::kNoDisparity;

  const std::optional<int> best =
      SearchRow(LoadPatch(left_image, x, y), right_image, y, x_first, x_last, options, scratch);
  if (!best) return Feature::kNoDisparity;
  const auto place =
      RefineMatch(left_image, x, y, right_image, {*best, y}, options.max_row_offset_px);
  if (!place) return Feature::kNoDisparity;
  const double disparity = (x - place->x()) * scale;
  return disparity >= options.min_disparity_px ? static_cast<float>(disparity)
                                               : Feature::kNoDisparity;
}

/// Whether the patch of a feature with depth holds one of quite another depth.
bool IsAtEdge(const Feature& feature, const FeatureGrid& grid, const StereoOptions& options) {
  const double scale = ScaleOfLevel(feature.level);
  const double max_difference_px =
      std::max(options.max_edge_ratio * feature.disparity_px, options.max_edge_px * scale);
  bool is_at_edge = false;
  grid.VisitNear(feature.x_px, feature.y_px, options.edge_radius_px * scale, [&](uint32_t idx) {
    const Feature& other = grid.features()[idx];
    is_at_edge |= other.has_disparity() &&
                  std::abs(other.disparity_px - feature.disparity_px) > max_difference_px;
  });
  return is_at_edge;
}

/// A patch that shows what is nearer or farther too measures something between.
void ForgetDepthsAtEdges(const cv::Size& size, const StereoOptions& options,
                         std::vector<Feature>& features) {
  const FeatureGrid grid(features, size.width, size.height);
  std::vector<uint32_t> at_edge;
  size_t clear = 0;
  for (uint32_t i = 0; i < features.size(); ++i) {
    if (!features[i].has_disparity()) continue;
    if (IsAtEdge(features[i], grid, options)) {
      at_edge.push_back(i);
    } else {
      ++clear;
    }
  }
  if (clear < options.min_depths) return;
  for (const uint32_t i : at_edge) features[i].disparity_px = Feature::kNoDisparity;
}

}  // namespace

void MatchStereo(const ImagePyramid& left, const ImagePyramid& right, const StereoRig& rig,
                 const StereoOptions& options, std::vector<Feature>& features) {
  tbb::parallel_for(tbb::blocked_range<size_t>(0, features.size(), 64), [&](const auto& range) {
    std::vector<int> scratch;
    for (size_t i = range.begin(); i != range.end(); ++i) {
      features[i].disparity_px = FindDisparity(features[i], left, right, rig, options, scratch);
    }
  });
  ForgetDepthsAtEdges(left[0].size(), options, features);
}

}  // namespace carmap
