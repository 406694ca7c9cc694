#include "carmap/eval/segmentation_picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "carmap/eval/canvas.h"
#include "carmap/eval/segmentation_score.h"

namespace carmap {
namespace {

constexpr int kTopMarginPx = 44, kBottomMarginPx = 40, kSideMarginPx = 10, kCaptionPx = 26;
constexpr double kTextPx = 12, kTitlePx = 15;
constexpr Rgb kFoundColour = kEstimateColour, kMissedColour = kTruthColour,
              kWrongColour = kKeyframeColour;

void Tint(const cv::Mat& mask, Rgb colour, cv::Mat& image) {
  constexpr double kOpacity = 0.5;
  const cv::Mat ink(image.size(), CV_8UC3, cv::Scalar(colour.blue, colour.green, colour.red));
  cv::Mat tinted;
  cv::addWeighted(image, 1 - kOpacity, ink, kOpacity, 0, tinted);
  tinted.copyTo(image, mask);
}

cv::Mat Overlay(const cv::Mat& grey, const cv::Mat& truth, const cv::Mat& mobility) {
  const auto non_static = static_cast<double>(Mobility::kNonStatic);
  const cv::Mat is_so = truth == non_static,
                is_told = AtImageSize(mobility, grey.size()) == non_static;
  cv::Mat image;
  cv::cvtColor(grey, image, cv::COLOR_GRAY2BGR);
  Tint(is_so & is_told, kFoundColour, image);
  Tint(is_so & ~is_told, kMissedColour, image);
  Tint((truth == static_cast<double>(Mobility::kStatic)) & is_told, kWrongColour, image);
  return image;
}

void DrawLegend(double y, Canvas& canvas) {
  double x = kSideMarginPx + 8;
  for (const auto& [colour, text] : {std::pair(kFoundColour, "non-static, found"),
                                     std::pair(kMissedColour, "non-static, missed"),
                                     std::pair(kWrongColour, "static, called non-static")}) {
    canvas.Dot({x, y - 5}, 5, colour);
    canvas.Text(text, {x + 12, y}, kTextPx, kBlack, Anchor::kLeft);
    x += Canvas::TextWidth(text, kTextPx) + 40;
  }
}

}  // namespace

cv::Mat RenderSegmentationPicture(const SegmentationPicture& picture) {
  constexpr double kWidthPx = 1300;
  const double scale = std::max(1.0, std::round(kWidthPx / picture.image.cols));
  const int width = static_cast<int>(scale * picture.image.cols);
  const int panel_height = static_cast<int>(scale * picture.image.rows) + kCaptionPx;
  const int panels_height = panel_height * static_cast<int>(picture.told.size());
  Canvas canvas(width + 2 * kSideMarginPx, kTopMarginPx + panels_height + kBottomMarginPx);
  canvas.Text(picture.title, {kSideMarginPx + width / 2.0, 29}, kTitlePx, kBlack, Anchor::kMiddle);
  double y = kTopMarginPx;
  for (const auto& [segmenter, mobility] : picture.told) {
    canvas.Text(segmenter, {kSideMarginPx, y + kCaptionPx - 8}, kTextPx, kBlack, Anchor::kLeft);
    canvas.Image(Overlay(picture.image, picture.truth, mobility), {kSideMarginPx, y + kCaptionPx},
                 scale);
    y += panel_height;
  }
  DrawLegend(y + 26, canvas);
  return canvas.Finish();
}

}  // namespace carmap
