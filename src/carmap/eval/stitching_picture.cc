#include "carmap/eval/stitching_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

constexpr double kLeftPx = 84, kRightPx = 28, kTopPx = 92, kGapPx = 110, kBottomPx = 70;
constexpr double kHeightPx = 220, kMinWidthPx = 620, kSegmentPx = 110;
constexpr double kLabelPx = 11, kNamePx = 12, kTitlePx = 17, kDotPx = 4.5;
constexpr std::array<Rgb, 4> kColours = {kEstimateColour, kTruthColour, kKeyframeColour,
                                         Rgb{0, 158, 115}};

using Value = double StitchingCurve::Point::*;

/// Powers of ten upwards; what failed stands above them.
struct Panel {
  Eigen::Vector2d origin_px;  ///< left lower corner
  double width_px = 0;
  size_t segments = 0;
  double low = 0, high = 1;  ///< exponents of ten

  double X(size_t segment) const {
    return origin_px.x() +
           width_px * (static_cast<double>(segment) + 0.5) / static_cast<double>(segments);
  }
  double Y(double value) const {
    return origin_px.y() - kHeightPx * (std::log10(value) - low) / (high - low);
  }
  double FailedY() const { return origin_px.y() - kHeightPx - 16; }
};

Panel PanelOf(const std::vector<StitchingCurve>& curves, Value value, Eigen::Vector2d origin_px,
              double width_px, size_t segments) {
  constexpr double kLeast = 1e-3;
  double low = 1e9, high = kLeast;
  for (const StitchingCurve& curve : curves) {
    for (const auto& point : curve.points) {
      if (!point) continue;
      low = std::min(low, std::max(kLeast, (*point).*value));
      high = std::max(high, (*point).*value);
    }
  }
  Panel panel{origin_px, width_px, segments};
  panel.low = std::floor(std::log10(std::min(low, high)));
  panel.high = std::max(panel.low + 1, std::ceil(std::log10(high)));
  return panel;
}

void DrawGrid(const Panel& panel, const std::string& name, Canvas& canvas) {
  const double left = panel.origin_px.x(), right = left + panel.width_px;
  for (double exponent = panel.low; exponent <= panel.high; ++exponent) {
    const double y = panel.Y(std::pow(10, exponent));
    canvas.Line({left, y}, {right, y}, kGridColour, 1);
    canvas.Text(fmt::format("{:g}", std::pow(10, exponent)), {left - 10, y + kLabelPx / 2},
                kLabelPx, kGrey, Anchor::kRight);
  }
  canvas.Line({left, panel.origin_px.y()}, {right, panel.origin_px.y()}, kFrameColour, 1);
  canvas.Text("failed", {left - 10, panel.FailedY() + kLabelPx / 2}, kLabelPx, kGrey,
              Anchor::kRight);
  canvas.Text(name, {left, panel.FailedY() - 16}, kNamePx, kBlack, Anchor::kLeft);
}

void DrawCurve(const Panel& panel, const StitchingCurve& curve, Value value, double shift_px,
               Rgb colour, Canvas& canvas) {
  std::vector<Eigen::Vector2d> line;
  const auto draw_line = [&] {
    if (line.size() > 1) canvas.Polyline(line, colour, 1.5);
    line.clear();
  };
  for (size_t i = 0; i < curve.points.size(); ++i) {
    const double x = panel.X(i) + shift_px;
    if (curve.points[i]) {
      const double drawn = std::max((*curve.points[i]).*value, std::pow(10, panel.low));
      line.emplace_back(x, panel.Y(drawn));
      canvas.Dot(line.back(), kDotPx, colour);
    } else {
      draw_line();
      canvas.Circle({x, panel.FailedY()}, kDotPx, colour, 1.5);
    }
  }
  draw_line();
}

void DrawLegend(const std::vector<StitchingCurve>& curves, Canvas& canvas) {
  double x = kLeftPx;
  for (size_t i = 0; i < curves.size(); ++i) {
    canvas.Dot({x, 48}, kDotPx, kColours[i % kColours.size()]);
    canvas.Text(curves[i].way, {x + 10, 52}, kNamePx, kBlack, Anchor::kLeft);
    x += 40 + Canvas::TextWidth(curves[i].way, kNamePx);
  }
}

}  // namespace

cv::Mat RenderStitching(const std::string& title, const std::vector<std::string>& segments,
                        const std::vector<StitchingCurve>& curves) {
  constexpr double kApartPx = 6;  // points of one segment beside each other
  const double width = std::max(kMinWidthPx, kSegmentPx * static_cast<double>(segments.size()));
  Canvas canvas(static_cast<int>(kLeftPx + width + kRightPx),
                static_cast<int>(kTopPx + 2 * kHeightPx + kGapPx + kBottomPx));
  canvas.Text(title, {kLeftPx + width / 2, 26}, kTitlePx, kBlack, Anchor::kMiddle);
  DrawLegend(curves, canvas);
  const struct {
    const char* name;
    Value value;
  } panels[] = {{"mapping error (m, mean)", &StitchingCurve::Point::error_m},
                {"stitching time (ms)", &StitchingCurve::Point::ms}};
  double bottom = kTopPx + kHeightPx + 24;
  for (const auto& [name, value] : panels) {
    const Panel panel = PanelOf(curves, value, {kLeftPx, bottom}, width, segments.size());
    DrawGrid(panel, name, canvas);
    for (size_t i = 0; i < curves.size(); ++i) {
      const double shift =
          kApartPx * (static_cast<double>(i) - (static_cast<double>(curves.size()) - 1) / 2);
      DrawCurve(panel, curves[i], value, shift, kColours[i % kColours.size()], canvas);
    }
    for (size_t i = 0; i < segments.size(); ++i) {
      canvas.Text(segments[i], {panel.X(i), bottom + 20}, kLabelPx, kGrey, Anchor::kMiddle);
    }
    bottom += kHeightPx + kGapPx;
  }
  return canvas.Finish();
}

}  // namespace carmap
