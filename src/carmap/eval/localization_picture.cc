#include "carmap/eval/localization_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

constexpr std::array<Rgb, 6> kColours = {kEstimateColour, kTruthColour,   kKeyframeColour,
                                         {0, 140, 110},   {150, 90, 170}, {120, 120, 120}};
constexpr double kTitlePx = 17, kNamePx = 11, kLabelPx = 9, kMarginPx = 30;

std::string MethodName(const std::string& method) { return method.empty() ? "CarMap" : method; }

/// Names with a colour each, in the order in which they were first asked for.
class Legend {
 public:
  Rgb ColourOf(const std::string& name) {
    const auto found = std::find(names_.begin(), names_.end(), name);
    const auto idx = static_cast<size_t>(found - names_.begin());
    if (found == names_.end()) names_.push_back(name);
    return kColours[idx % kColours.size()];
  }

  void Draw(Eigen::Vector2d at, Canvas& canvas) {
    for (const std::string& name : names_) {
      canvas.Line(at - Eigen::Vector2d(0, 5), at + Eigen::Vector2d(34, -5), ColourOf(name), 4);
      canvas.Text(name, at + Eigen::Vector2d(44, 0), kNamePx, kBlack, Anchor::kLeft);
      at.x() += 44 + Canvas::TextWidth(name, kNamePx) + 40;
    }
  }

 private:
  std::vector<std::string> names_;
};

// Error distributions.

constexpr size_t kColumns = 4;
constexpr double kPanelWidthPx = 300, kPanelHeightPx = 130, kGapPx = 46, kTopPx = 84,
                 kPanelTopPx = 26, kPanelBottomPx = 34;
constexpr double kLeastErrorM = 1e-3, kMostErrorM = 10;

/// Where (error, share) stands, with the error on a logarithmic axis.
Eigen::Vector2d At(Eigen::Vector2d origin_px, double error_m, double share) {
  const double place = std::log(std::clamp(error_m, kLeastErrorM, kMostErrorM) / kLeastErrorM) /
                       std::log(kMostErrorM / kLeastErrorM);
  return origin_px + Eigen::Vector2d(kPanelWidthPx * place, -kPanelHeightPx * share);
}

struct Distribution {
  std::vector<double> errors_m;
  size_t frames = 0;

  void Take(const std::vector<ReportedFrame>& of_drive) {
    constexpr size_t kFirstSecond = 10;
    for (size_t i = kFirstSecond; i < of_drive.size(); ++i) {
      ++frames;
      if (of_drive[i].known_by != KnownBy::kLost) errors_m.push_back(of_drive[i].position_error_m);
    }
  }
};

using Panel = std::map<std::string, Distribution>;  ///< by the curve's name

void DrawAxes(Eigen::Vector2d origin_px, Canvas& canvas) {
  for (double error_m = kLeastErrorM; error_m <= kMostErrorM * 1.001; error_m *= 10) {
    canvas.Line(At(origin_px, error_m, 0), At(origin_px, error_m, 1), kGridColour, 1);
    canvas.Text(fmt::format("{:g} m", error_m), At(origin_px, error_m, 0) + Eigen::Vector2d(0, 16),
                kLabelPx, kGrey, Anchor::kMiddle);
  }
  for (const double share : {0.0, 0.5, 1.0}) {
    canvas.Line(At(origin_px, kLeastErrorM, share), At(origin_px, kMostErrorM, share), kGridColour,
                1);
    canvas.Text(fmt::format("{:g}", share),
                At(origin_px, kLeastErrorM, share) + Eigen::Vector2d(-6, 4), kLabelPx, kGrey,
                Anchor::kRight);
  }
}

void DrawDistribution(Distribution distribution, Eigen::Vector2d origin_px, Rgb colour,
                      Canvas& canvas) {
  std::sort(distribution.errors_m.begin(), distribution.errors_m.end());
  std::vector<Eigen::Vector2d> steps = {At(origin_px, kLeastErrorM, 0)};
  double share = 0;
  for (const double error_m : distribution.errors_m) {
    steps.push_back(At(origin_px, error_m, share));
    share += 1 / static_cast<double>(distribution.frames);
    steps.push_back(At(origin_px, error_m, share));
  }
  steps.push_back(At(origin_px, kMostErrorM, share));
  canvas.Polyline(steps, colour, 1.5);
}

// Bars.

constexpr double kNamesPx = 330, kBarsPx = 330, kBarPx = 9, kRowGapPx = 7, kBarsGapPx = 60,
                 kBarsTopPx = 108;

/// Bars from left to right, from 0 to `max`.
struct BarAxis {
  std::string name;
  LocalizationFigure figure;
  double left_px, max;

  double At(double value) const { return left_px + kBarsPx * std::clamp(value / max, 0.0, 1.0); }

  void Draw(double top_px, double bottom_px, Canvas& canvas) const {
    canvas.Text(name, {left_px, top_px - 26}, kNamePx, kBlack, Anchor::kLeft);
    const double step = RoundStepAtLeast(max / 5);
    for (int i = 0; i * step <= max * 1.001; ++i) {
      canvas.Line({At(i * step), top_px}, {At(i * step), bottom_px}, kGridColour, 1);
      canvas.Text(fmt::format("{:g}", i * step), {At(i * step), top_px - 8}, kLabelPx, kGrey,
                  Anchor::kMiddle);
    }
  }

  void DrawBar(const LocalizationScore& score, double top_px, Rgb colour, Canvas& canvas) const {
    const Estimate& estimate = score[figure];
    if (std::isnan(estimate.value)) return;
    canvas.Box({left_px, top_px}, {At(estimate.value), top_px + kBarPx}, colour, colour);
    canvas.Line({At(estimate.low), top_px + kBarPx / 2}, {At(estimate.high), top_px + kBarPx / 2},
                kBlack, 1.5);
  }
};

double MaxOf(const std::vector<ScoredGroup>& groups, LocalizationFigure figure) {
  double max = 0;
  for (const ScoredGroup& group : groups) {
    for (const ScoredCell& cell : group.cells) {
      if (cell.score[figure].value > max) max = cell.score[figure].value;
    }
  }
  return max > 0 ? max : 1;
}

}  // namespace

cv::Mat RenderErrorDistributions(const std::string& title,
                                 const std::vector<LocalizationReport>& reports) {
  std::map<std::tuple<std::string, std::string, std::string>, Panel> panels;
  for (const LocalizationReport& report : reports) {
    const LocalizationCell& cell = report.cell;
    const std::string curve =
        fmt::format("{}, {}", MethodName(cell.method), cell.lane == 0 ? "same lane" : "other lane");
    panels[{cell.scene, cell.map_traffic, cell.traffic}][curve].Take(report.frames);
  }
  const size_t rows = (panels.size() + kColumns - 1) / kColumns;
  const double pitch_y = kPanelTopPx + kPanelHeightPx + kPanelBottomPx;
  Canvas canvas(static_cast<int>(2 * kMarginPx + kColumns * (kPanelWidthPx + kGapPx) - kGapPx),
                static_cast<int>(kTopPx + static_cast<double>(rows) * pitch_y));
  canvas.Text(title, {kMarginPx, 34}, kTitlePx, kBlack, Anchor::kLeft);
  Legend legend;
  size_t i = 0;
  for (const auto& [key, panel] : panels) {
    const auto& [scene, map_traffic, traffic] = key;
    const Eigen::Vector2d corner_px(
        kMarginPx + static_cast<double>(i % kColumns) * (kPanelWidthPx + kGapPx),
        kTopPx + static_cast<double>(i / kColumns) * pitch_y);
    const Eigen::Vector2d origin_px = corner_px + Eigen::Vector2d(0, kPanelTopPx + kPanelHeightPx);
    canvas.Text(fmt::format("{}: map {}, drive {}", scene, map_traffic, traffic),
                corner_px + Eigen::Vector2d(0, 14), kNamePx, kBlack, Anchor::kLeft);
    DrawAxes(origin_px, canvas);
    for (const auto& [curve, distribution] : panel) {
      DrawDistribution(distribution, origin_px, legend.ColourOf(curve), canvas);
    }
    ++i;
  }
  legend.Draw({kMarginPx, 62}, canvas);
  return canvas.Finish();
}

cv::Mat RenderCellBars(const std::string& title, const std::vector<ScoredGroup>& groups) {
  std::map<std::string, std::map<std::string, const LocalizationScore*>> rows;
  for (const ScoredGroup& group : groups) {
    for (const ScoredCell& cell : group.cells) {
      rows[ToText(cell.cell)][MethodName(group.method)] = &cell.score;
    }
  }
  const double row_px = static_cast<double>(groups.size()) * kBarPx + kRowGapPx,
               bottom_px = kBarsTopPx + static_cast<double>(rows.size()) * row_px;
  const std::array<BarAxis, 2> axes = {
      {{"share well known", kWellKnown, kMarginPx + kNamesPx, 1},
       {"median error (m)", kMedianErrorM, kMarginPx + kNamesPx + kBarsPx + kBarsGapPx,
        MaxOf(groups, kMedianErrorM)}}};
  Canvas canvas(static_cast<int>(axes[1].left_px + kBarsPx + kMarginPx),
                static_cast<int>(bottom_px + kMarginPx));
  canvas.Text(title, {kMarginPx, 34}, kTitlePx, kBlack, Anchor::kLeft);
  for (const BarAxis& axis : axes) axis.Draw(kBarsTopPx, bottom_px, canvas);
  Legend legend;
  double top_px = kBarsTopPx + kRowGapPx / 2;
  for (const auto& [name, scores] : rows) {
    canvas.Text(name, {kMarginPx, top_px + kBarPx}, kLabelPx, kBlack, Anchor::kLeft);
    double bar_px = top_px;
    for (const auto& [method, score] : scores) {
      for (const BarAxis& axis : axes) {
        axis.DrawBar(*score, bar_px, legend.ColourOf(method), canvas);
      }
      bar_px += kBarPx;
    }
    top_px += row_px;
  }
  legend.Draw({kMarginPx, 62}, canvas);
  return canvas.Finish();
}

}  // namespace carmap
