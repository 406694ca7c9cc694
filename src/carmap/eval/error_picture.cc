#include "carmap/eval/error_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "carmap/base/summary.h"
#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

constexpr double kLeftPx = 84, kRightPx = 28, kTopPx = 74, kGapPx = 56, kBottomPx = 66;
constexpr double kWidthPx = 1100, kHeightPx = 220, kLabelPx = 11, kNamePx = 12, kTitlePx = 17;

std::vector<double> FiniteErrors(const ErrorCurve& curve) {
  std::vector<double> errors;
  for (const Eigen::Vector2d& value : curve.values) {
    if (value.allFinite()) errors.push_back(value.y());
  }
  return errors;
}

/// Where values stand in the picture.
struct Axes {
  Eigen::Vector2d origin_px;  ///< left lower corner
  double max_x = 1, max_y = 1;

  Eigen::Vector2d At(double x, double y) const {
    return origin_px + Eigen::Vector2d(kWidthPx * x / max_x, -kHeightPx * y / max_y);
  }
};

void DrawGrid(const Axes& axes, bool label_distance, Canvas& canvas) {
  const double step_x = RoundStepAtLeast(axes.max_x / 10),
               step_y = RoundStepAtLeast(axes.max_y / 5);
  for (double x = 0; x <= axes.max_x; x += step_x) {
    canvas.Line(axes.At(x, 0), axes.At(x, axes.max_y), kGridColour, 1);
    if (!label_distance) continue;
    canvas.Text(fmt::format("{:g}", x), axes.At(x, 0) + Eigen::Vector2d(0, 22), kLabelPx, kGrey,
                Anchor::kMiddle);
  }
  for (int i = 0; i * step_y <= axes.max_y; ++i) {
    canvas.Line(axes.At(0, i * step_y), axes.At(axes.max_x, i * step_y), kGridColour, 1);
    canvas.Text(fmt::format("{:g}", i * step_y),
                axes.At(0, i * step_y) + Eigen::Vector2d(-10, kLabelPx / 2), kLabelPx, kGrey,
                Anchor::kRight);
  }
  canvas.Polyline({axes.At(0, axes.max_y), axes.At(0, 0), axes.At(axes.max_x, 0)}, kFrameColour, 1);
}

void DrawCurve(const Axes& axes, const ErrorCurve& curve, Canvas& canvas) {
  std::vector<Eigen::Vector2d> line;
  const auto draw_line = [&] {
    if (line.size() > 1) canvas.Polyline(line, kEstimateColour, 2);
    if (line.size() == 1) canvas.Dot(line.front(), 2, kEstimateColour);
    line.clear();
  };
  for (const Eigen::Vector2d& value : curve.values) {
    if (value.allFinite()) {
      line.push_back(axes.At(value.x(), value.y()));
    } else {
      draw_line();
    }
  }
  draw_line();
}

}  // namespace

cv::Mat RenderErrorPicture(const std::string& title, const std::vector<ErrorCurve>& curves) {
  const double plots = static_cast<double>(curves.size());
  Canvas canvas(static_cast<int>(kLeftPx + kWidthPx + kRightPx),
                static_cast<int>(kTopPx + plots * (kHeightPx + kGapPx) + kBottomPx - kGapPx / 2));
  canvas.Text(title, {kLeftPx + kWidthPx / 2, 28}, kTitlePx, kBlack, Anchor::kMiddle);
  double top = kTopPx;
  for (const ErrorCurve& curve : curves) {
    const std::vector<double> errors = FiniteErrors(curve);
    const Summary summary = Summarize(errors);
    Axes axes{{kLeftPx, top + kHeightPx}};
    for (const Eigen::Vector2d& value : curve.values) {
      if (value.allFinite()) axes.max_x = std::max(axes.max_x, value.x());
    }
    if (summary.max > 0) axes.max_y = 1.08 * summary.max;
    DrawGrid(axes, &curve == &curves.back(), canvas);
    canvas.Line(axes.At(0, summary.median), axes.At(axes.max_x, summary.median), kKeyframeColour,
                1.5);
    DrawCurve(axes, curve, canvas);
    canvas.Text(
        fmt::format("{}: median {:.3g}, at most {:.3g}", curve.name, summary.median, summary.max),
        {kLeftPx, top - 10}, kNamePx, kBlack, Anchor::kLeft);
    top += kHeightPx + kGapPx;
  }
  canvas.Text("distance driven (m)", {kLeftPx + kWidthPx / 2, top - kGapPx + 46}, kNamePx, kBlack,
              Anchor::kMiddle);
  return canvas.Finish();
}

}  // namespace carmap
