#include "carmap/eval/histogram_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "carmap/base/summary.h"
#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

constexpr size_t kColumns = 4;
constexpr double kPanelWidthPx = 340, kPanelHeightPx = 120, kMarginPx = 30, kGapPx = 34,
                 kTopPx = 84, kPanelTopPx = 42, kPanelBottomPx = 42, kNamePx = 11, kLabelPx = 9,
                 kTitlePx = 17;

/// Equal bins over a stretch of values.
struct Bins {
  double low = 0, width = 1;
  size_t count = 1;
  double min_grid_step = 0;
  double high() const { return low + width * static_cast<double>(count); }
};

struct Stretch {
  double low, high;
};

/// All but the lowest and the highest half percent. Needs samples.
Stretch MostOf(std::vector<double> samples) {
  const auto cut = static_cast<std::ptrdiff_t>(samples.size() / 200);
  const auto low = samples.begin() + cut, high = samples.end() - 1 - cut;
  std::nth_element(samples.begin(), low, samples.end());
  const double low_value = *low;
  std::nth_element(samples.begin(), high, samples.end());
  return {low_value, *high};
}

bool AreWhole(const std::vector<double>& samples) {
  return std::all_of(samples.begin(), samples.end(), [](double s) { return s == std::round(s); });
}

/// As many as the smaller series can fill (Rice's rule); whole numbers are never split.
std::optional<Bins> ChooseBins(const HistogramPanel& panel) {
  constexpr double kMaxBins = 40;
  if (panel.first.empty() || panel.second.empty()) return std::nullopt;
  const Stretch a = MostOf(panel.first), b = MostOf(panel.second);
  const double low = std::min(a.low, b.low), high = std::max(a.high, b.high);
  const auto fewer = static_cast<double>(std::min(panel.first.size(), panel.second.size()));
  const double wanted = std::min(kMaxBins, std::ceil(2 * std::cbrt(fewer)));
  if (AreWhole(panel.first) && AreWhole(panel.second)) {
    const double width = std::max(1.0, std::ceil((high - low + 1) / wanted));
    return Bins{low - 0.5, width, static_cast<size_t>(std::ceil((high - low + 1) / width)),
                /*min_grid_step=*/1};
  }
  const double span = std::max(high - low, 1e-9 * std::max(std::abs(high), 1.0));
  return Bins{low, span / wanted, static_cast<size_t>(wanted)};
}

/// Share of the samples in each bin; the last one holds its upper bound, too.
std::vector<double> SharesOf(const std::vector<double>& samples, const Bins& bins) {
  std::vector<double> shares(bins.count, 0);
  for (const double sample : samples) {
    const double place = (sample - bins.low) / bins.width;
    if (!(place >= 0 && place <= static_cast<double>(bins.count))) continue;
    const size_t bin = std::min(static_cast<size_t>(place), bins.count - 1);
    shares[bin] += 1 / static_cast<double>(samples.size());
  }
  return shares;
}

class Panel {
 public:
  Panel(const Bins& bins, double max_share, Eigen::Vector2d origin_px)
      : bins_(bins), max_share_(max_share), origin_px_(origin_px) {}

  void DrawGrid(Canvas& canvas) const {
    const double step =
        std::max(RoundStepAtLeast((bins_.high() - bins_.low) / 5), bins_.min_grid_step);
    for (double i = std::ceil(bins_.low / step); i * step <= bins_.high(); ++i) {
      const double value = i * step + 0.0;  // adding 0 turns -0 into 0
      canvas.Line(At(value, 0), At(value, max_share_), kGridColour, 1);
      canvas.Text(fmt::format("{:g}", value), At(value, 0) + Eigen::Vector2d(0, 18), kLabelPx,
                  kGrey, Anchor::kMiddle);
    }
    canvas.Line(At(bins_.low, 0), At(bins_.high(), 0), kFrameColour, 1);
  }

  void DrawShares(const std::vector<double>& shares, Rgb colour, Canvas& canvas) const {
    std::vector<Eigen::Vector2d> steps = {At(bins_.low, 0)};
    for (size_t i = 0; i < shares.size(); ++i) {
      const double left = bins_.low + bins_.width * static_cast<double>(i);
      steps.push_back(At(left, shares[i]));
      steps.push_back(At(left + bins_.width, shares[i]));
    }
    steps.push_back(At(bins_.high(), 0));
    canvas.Polyline(steps, colour, 1.5);
  }

  void DrawMedian(double median, Rgb colour, Canvas& canvas) const {
    const Eigen::Vector2d foot = At(std::clamp(median, bins_.low, bins_.high()), 0);
    canvas.Line(foot, foot + Eigen::Vector2d(0, 6), colour, 4);
  }

 private:
  Eigen::Vector2d At(double value, double share) const {
    return origin_px_ +
           Eigen::Vector2d(kPanelWidthPx * (value - bins_.low) / (bins_.high() - bins_.low),
                           -kPanelHeightPx * share / max_share_);
  }

  const Bins bins_;
  const double max_share_;
  const Eigen::Vector2d origin_px_;  ///< left lower corner
};

void DrawPanel(const HistogramPanel& panel, Eigen::Vector2d corner_px, Canvas& canvas) {
  const double median_of_first = Summarize(panel.first).median,
               median_of_second = Summarize(panel.second).median;
  canvas.Text(panel.name, corner_px + Eigen::Vector2d(0, 14), kNamePx, kBlack, Anchor::kLeft);
  const std::optional<Bins> bins = ChooseBins(panel);
  if (!bins) return;
  canvas.Text(fmt::format("{:.5g}", median_of_first), corner_px + Eigen::Vector2d(0, 32), kNamePx,
              kEstimateColour, Anchor::kLeft);
  canvas.Text(fmt::format("{:.5g}", median_of_second), corner_px + Eigen::Vector2d(90, 32), kNamePx,
              kTruthColour, Anchor::kLeft);

  const std::vector<double> first = SharesOf(panel.first, *bins),
                            second = SharesOf(panel.second, *bins);
  const double highest = std::max(*std::max_element(first.begin(), first.end()),
                                  *std::max_element(second.begin(), second.end()));
  const Panel drawn(*bins, std::max(highest, 1e-9),
                    corner_px + Eigen::Vector2d(0, kPanelTopPx + kPanelHeightPx));
  drawn.DrawGrid(canvas);
  drawn.DrawShares(second, kTruthColour, canvas);
  drawn.DrawShares(first, kEstimateColour, canvas);
  drawn.DrawMedian(median_of_second, kTruthColour, canvas);
  drawn.DrawMedian(median_of_first, kEstimateColour, canvas);
}

void DrawLegend(const std::string& first_name, const std::string& second_name, Canvas& canvas) {
  Eigen::Vector2d at(kMarginPx, 62);
  for (const auto& [name, colour] :
       {std::pair(&first_name, kEstimateColour), std::pair(&second_name, kTruthColour)}) {
    canvas.Line(at - Eigen::Vector2d(0, 5), at + Eigen::Vector2d(34, -5), colour, 4);
    canvas.Text(*name, at + Eigen::Vector2d(44, 0), kNamePx, kBlack, Anchor::kLeft);
    at.x() += 44 + Canvas::TextWidth(*name, kNamePx) + 40;
  }
  canvas.Text("numbers and ticks: medians", at, kNamePx, kGrey, Anchor::kLeft);
}

}  // namespace

cv::Mat RenderHistograms(const std::string& title, const std::string& first_name,
                         const std::string& second_name,
                         const std::vector<HistogramPanel>& panels) {
  const size_t rows = (panels.size() + kColumns - 1) / kColumns;
  const double pitch_x = kPanelWidthPx + kGapPx,
               pitch_y = kPanelTopPx + kPanelHeightPx + kPanelBottomPx;
  Canvas canvas(static_cast<int>(2 * kMarginPx + kColumns * pitch_x - kGapPx),
                static_cast<int>(kTopPx + static_cast<double>(rows) * pitch_y));
  canvas.Text(title, {kMarginPx, 34}, kTitlePx, kBlack, Anchor::kLeft);
  DrawLegend(first_name, second_name, canvas);
  for (size_t i = 0; i < panels.size(); ++i) {
    const size_t row = i / kColumns, column = i % kColumns;
    DrawPanel(panels[i],
              {kMarginPx + static_cast<double>(column) * pitch_x,
               kTopPx + static_cast<double>(row) * pitch_y},
              canvas);
  }
  return canvas.Finish();
}

}  // namespace carmap
