#include "carmap/sim/render/sensor.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "carmap/base/random.h"

namespace carmap {
namespace {

constexpr float kVeil = 0.025f;  ///< share of the mean light that lens and housing scatter

/// Each pixel the mean along the way that its point takes while the shutter is open.
cv::Mat MotionBlurred(const RenderedView& view, double exposure_s) {
  constexpr int kMostLooks = 12;
  const cv::Mat& radiance = view.radiance;
  cv::Mat blurred(radiance.size(), CV_32F);
  const auto exposure = static_cast<float>(exposure_s);
  tbb::parallel_for(0, radiance.rows, [&](int y) {
    const auto* motion = view.motion_px.ptr<cv::Vec2f>(y);
    auto* out = blurred.ptr<float>(y);
    for (int x = 0; x < radiance.cols; ++x) {
      const cv::Vec2f way = motion[x] * exposure;
      const float length = std::sqrt(way.dot(way));
      if (length < 0.1f) {
        out[x] = radiance.at<float>(y, x);
        continue;
      }
      const int looks = std::min(2 + static_cast<int>(length), kMostLooks);
      float sum = 0;
      for (int k = 0; k < looks; ++k) {
        const float share = (static_cast<float>(k) + 0.5f) / static_cast<float>(looks) - 0.5f;
        const float u = std::clamp(static_cast<float>(x) + share * way[0], 0.f,
                                   static_cast<float>(radiance.cols - 1) - 1e-3f);
        const float v = std::clamp(static_cast<float>(y) + share * way[1], 0.f,
                                   static_cast<float>(radiance.rows - 1) - 1e-3f);
        const int i = static_cast<int>(u), j = static_cast<int>(v);
        const float tx = u - static_cast<float>(i), ty = v - static_cast<float>(j);
        const float* above = radiance.ptr<float>(j) + i;
        const float* below = radiance.ptr<float>(j + 1) + i;
        const float a = above[0] + tx * (above[1] - above[0]);
        const float b = below[0] + tx * (below[1] - below[0]);
        sum += a + ty * (b - a);
      }
      out[x] = sum / static_cast<float>(looks);
    }
  });
  return blurred;
}

/// About normal, with standard deviation 1: the sum of four even numbers.
float NoiseOf(uint64_t bits) {
  const auto sum = static_cast<int>((bits & 0xffff) + (bits >> 16 & 0xffff) +
                                    (bits >> 32 & 0xffff) + (bits >> 48));
  return static_cast<float>(sum - 2 * 0xffff) * (1.7320508f / 0x10000);
}

}  // namespace

cv::Mat Expose(const RenderedView& view, const SensorOptions& options, double gain, uint32_t frame,
               uint32_t camera) {
  cv::Mat light = MotionBlurred(view, options.exposure_s);
  if (options.blur_sigma_px > 0) {
    cv::GaussianBlur(light, light, {5, 5}, options.blur_sigma_px, 0, cv::BORDER_REPLICATE);
  }
  const auto veil = static_cast<float>(cv::mean(light)[0]) * kVeil;
  const auto scale = static_cast<float>(255 * gain * options.sensitivity);
  const auto read = static_cast<float>(options.read_noise * options.read_noise);
  const auto shot = static_cast<float>(options.shot_noise * options.shot_noise);
  const auto black = static_cast<float>(options.black_level);
  const auto dark = static_cast<float>(options.vignetting);
  const float center_x = 0.5f * static_cast<float>(light.cols - 1);
  const float center_y = 0.5f * static_cast<float>(light.rows - 1);
  const float corner = std::hypot(center_x, center_y);
  const uint64_t key = HashKeys(HashKeys(options.seed, frame), camera);
  cv::Mat grey(light.size(), CV_8U);
  tbb::parallel_for(0, light.rows, [&](int y) {
    const auto* in = light.ptr<float>(y);
    auto* out = grey.ptr<uint8_t>(y);
    const float dy = (static_cast<float>(y) - center_y) / corner, dy2 = dy * dy;
    for (int x = 0; x < light.cols; ++x) {
      const float dx = (static_cast<float>(x) - center_x) / corner, dx2 = dx * dx;
      const float value = black + scale * (1 - dark * (dx2 + dy2)) * (in[x] + veil);
      const float deviation = std::sqrt(read + shot * std::max(value, 0.f));
      const uint64_t bits = HashKeys(key, uint64_t(y) << 32 | uint64_t(x));
      const float noisy = value + deviation * NoiseOf(bits);
      out[x] = static_cast<uint8_t>(std::clamp(noisy + 0.5f, 0.f, 255.f));
    }
  });
  return grey;
}

double AutomaticGain(const cv::Mat& radiance) {
  std::vector<float> values;
  for (int y = 2; y < radiance.rows; y += 4) {
    for (int x = 2; x < radiance.cols; x += 4) values.push_back(radiance.at<float>(y, x));
  }
  if (values.empty()) return 1;
  const auto quantile = [&](double share) {
    const auto nth = values.begin() + static_cast<ptrdiff_t>(share * (values.size() - 1));
    std::nth_element(values.begin(), nth, values.end());
    return std::max(double{*nth}, 1e-6);
  };
  constexpr double kDarkest = 0.18, kBrightest = 0.45;  ///< median, of white
  const double median = quantile(0.5);
  return std::clamp(1 / quantile(0.96), kDarkest / median, kBrightest / median);
}

}  // namespace carmap
