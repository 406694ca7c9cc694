#include "carmap/eval/segmentation_score.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "carmap/base/summary.h"

namespace carmap {
namespace {

constexpr auto kStatic = Mobility::kStatic, kNonStatic = Mobility::kNonStatic;

double Divide(size_t numerator, size_t denominator) {
  if (denominator == 0) return std::numeric_limits<double>::quiet_NaN();
  return static_cast<double>(numerator) / static_cast<double>(denominator);
}

nlohmann::ordered_json OrNull(double value) {
  if (std::isnan(value)) return nullptr;
  return value;
}

std::string Percent(double share) {
  return std::isnan(share) ? "-" : fmt::format("{:.1f}", 100 * share);
}

}  // namespace

void MobilityConfusion::Add(Mobility truth, Mobility told, size_t count) {
  counts_[static_cast<size_t>(truth)][static_cast<size_t>(told)] += count;
}

size_t MobilityConfusion::count(Mobility truth) const {
  const auto& told = counts_[static_cast<size_t>(truth)];
  return std::accumulate(told.begin(), told.end(), size_t{0});
}

double MobilityConfusion::Accuracy() const {
  return Divide(count(kStatic, kStatic) + count(kNonStatic, kNonStatic),
                count(kStatic) + count(kNonStatic));
}

double MobilityConfusion::Share(Mobility truth, Mobility told) const {
  return Divide(count(truth, told), count(truth));
}

double MobilityConfusion::Iou(Mobility mobility) const {
  const Mobility other = mobility == kStatic ? kNonStatic : kStatic;
  return Divide(count(mobility, mobility), count(mobility) + count(other, mobility));
}

cv::Mat AtImageSize(const cv::Mat& told, cv::Size image) {
  cv::Mat resized;
  cv::resize(told, resized, image, 0, 0, cv::INTER_NEAREST_EXACT);
  return resized;
}

void SegmentationScore::TakePixels(const cv::Mat& truth, const cv::Mat& told) {
  for (int row = 0; row < truth.rows; ++row) {
    const auto *true_row = truth.ptr<uint8_t>(row), *told_row = told.ptr<uint8_t>(row);
    for (int column = 0; column < truth.cols; ++column) {
      pixels.Add(static_cast<Mobility>(true_row[column]), static_cast<Mobility>(told_row[column]));
    }
  }
}

void SegmentationScore::TakeFeatures(const std::vector<Mobility>& truth,
                                     const std::vector<Mobility>& told) {
  for (size_t i = 0; i < truth.size(); ++i) features.Add(truth[i], told[i]);
}

nlohmann::ordered_json ToJson(const SegmentationScore& score) {
  const Summary ms = Summarize(score.frame_ms);
  const MobilityConfusion &pixels = score.pixels, &features = score.features;
  return {{"frames", score.frame_ms.size()},
          {"pixels",
           {{"accuracy", OrNull(pixels.Accuracy())},
            {"static_iou", OrNull(pixels.Iou(kStatic))},
            {"non_static_iou", OrNull(pixels.Iou(kNonStatic))}}},
          {"features",
           {{"static", features.count(kStatic)},
            {"non_static", features.count(kNonStatic)},
            {"accuracy", OrNull(features.Accuracy())},
            {"non_static_found", OrNull(features.Share(kNonStatic, kNonStatic))},
            {"static_called_non_static", OrNull(features.Share(kStatic, kNonStatic))}}},
          {"frame_ms",
           {{"median", ms.median},
            {"mean", ms.mean},
            {"p95", ms.p95},
            {"p99", ms.p99},
            {"max", ms.max}}},
          {"frames_per_second", ms.mean > 0 ? nlohmann::ordered_json(1e3 / ms.mean) : nullptr}};
}

std::string ToText(const std::vector<NamedSegmentationScore>& scores) {
  constexpr const char* kRow = "{:<32} {:>8} {:>10} {:>10} {:>10} {:>10} {:>10} {:>8} {:>8}\n";
  std::string text = fmt::format("{:<32} {:^30} {:^32}\n", "", "pixels %", "features %") +
                     fmt::format(kRow, "segmenter", "right", "IoU static", "non-static", "right",
                                 "non-static", "static", "ms a", "frames") +
                     fmt::format(kRow, "", "", "", "", "", "found", "lost", "frame", "a second");
  for (const auto& [name, score] : scores) {
    const double ms = Summarize(score.frame_ms).mean;
    fmt::format_to(std::back_inserter(text), kRow, name, Percent(score.pixels.Accuracy()),
                   Percent(score.pixels.Iou(kStatic)), Percent(score.pixels.Iou(kNonStatic)),
                   Percent(score.features.Accuracy()),
                   Percent(score.features.Share(kNonStatic, kNonStatic)),
                   Percent(score.features.Share(kStatic, kNonStatic)), fmt::format("{:.0f}", ms),
                   ms > 0 ? fmt::format("{:.1f}", 1e3 / ms) : "-");
  }
  return text;
}

}  // namespace carmap
