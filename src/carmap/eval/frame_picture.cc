#include "carmap/eval/frame_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

constexpr int kTopMarginPx = 44, kBottomMarginPx = 40, kSideMarginPx = 10;
constexpr double kTextPx = 12, kTitlePx = 15;
constexpr double kNearPx = 60, kFarPx = 3;  // disparities at the ends of the colour scale
constexpr Rgb kNotFoundColour{250, 220, 90};

/// From blue (near) over grey to red, even to colour-blind eyes.
Rgb ColourOf(double disparity_px) {
  const double range = std::log(kNearPx / kFarPx);
  const double far = std::clamp(std::log(kNearPx / disparity_px) / range, 0.0, 1.0);
  const auto mix = [&](double near_value, double middle, double far_value) {
    return static_cast<uint8_t>(std::lround(far < 0.5 ? std::lerp(near_value, middle, 2 * far)
                                                      : std::lerp(middle, far_value, 2 * far - 1)));
  };
  return {mix(40, 235, 230), mix(120, 235, 60), mix(255, 235, 40)};
}

void DrawFeature(const Feature& feature, bool in_map, const Eigen::Vector2d& origin,
                 double px_per_px, Canvas& canvas) {
  const Eigen::Vector2d at =
      origin + px_per_px * Eigen::Vector2d(feature.x_px + 0.5, feature.y_px + 0.5);
  const double radius_px = 2.2 * ScaleOfLevel(feature.level);
  if (!in_map) return canvas.Circle(at, radius_px, kNotFoundColour, 1);
  canvas.Dot(at, radius_px, feature.has_disparity() ? ColourOf(feature.disparity_px) : kGrey);
  canvas.Circle(at, radius_px, kBlack, 1);
}

void DrawLegend(double y, const FramePicture& picture, Canvas& canvas) {
  const auto found = std::count(picture.in_map.begin(), picture.in_map.end(), true);
  double x = kSideMarginPx + 8;
  const auto entry = [&](Rgb colour, bool filled, const std::string& text) {
    filled ? canvas.Dot({x, y - 5}, 5, colour) : canvas.Circle({x, y - 5}, 5, colour, 1.5);
    canvas.Text(text, {x + 12, y}, kTextPx, kBlack, Anchor::kLeft);
    x += Canvas::TextWidth(text, kTextPx) + 40;
  };
  entry(ColourOf(kNearPx), true, "found in the map, near");
  entry(ColourOf(std::sqrt(kNearPx * kFarPx)), true, "middle");
  entry(ColourOf(kFarPx), true, "far");
  entry(kNotFoundColour, false, "not in the map");
  canvas.Text(fmt::format("{} of {} features found in the map", found, picture.features.size()),
              {x, y}, kTextPx, kBlack, Anchor::kLeft);
}

}  // namespace

cv::Mat RenderFramePicture(const FramePicture& picture) {
  constexpr double kWidthPx = 1300;
  const double scale = std::max(1.0, std::round(kWidthPx / picture.image.cols));
  const int width = static_cast<int>(scale * picture.image.cols);
  const int height = static_cast<int>(scale * picture.image.rows);
  Canvas canvas(width + 2 * kSideMarginPx, height + kTopMarginPx + kBottomMarginPx);
  const Eigen::Vector2d origin(kSideMarginPx, kTopMarginPx);
  canvas.Image(picture.image, origin, scale);
  for (const bool in_map : {false, true}) {
    for (size_t i = 0; i < picture.features.size(); ++i) {
      if (picture.in_map[i] != in_map) continue;
      DrawFeature(picture.features[i], in_map, origin, scale, canvas);
    }
  }
  canvas.Text(picture.title, {kSideMarginPx + width / 2.0, 29}, kTitlePx, kBlack, Anchor::kMiddle);
  DrawLegend(kTopMarginPx + height + 26, picture, canvas);
  return canvas.Finish();
}

}  // namespace carmap
