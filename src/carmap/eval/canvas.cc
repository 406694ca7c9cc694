#include "carmap/eval/canvas.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string_view>

#include "carmap/base/file.h"

namespace carmap {
namespace {

constexpr int kOversampling = 2;
constexpr int kFont = cv::FONT_HERSHEY_DUPLEX;
constexpr int kShift = 4;  // OpenCV draws at fractions of a pixel in this fixed point
constexpr int kTextThickness = kOversampling;

cv::Scalar ToScalar(Rgb colour) {
  return {1.0 * colour.blue, 1.0 * colour.green, 1.0 * colour.red};
}

/// OpenCV's fonts have ASCII alone.
std::string ToAscii(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

int ToFixed(double px) { return static_cast<int>(std::lround(px * kOversampling * (1 << kShift))); }

cv::Point ToFixed(const Eigen::Vector2d& point) { return {ToFixed(point.x()), ToFixed(point.y())}; }

cv::Point Whole(const Eigen::Vector2d& point) {
  return {static_cast<int>(std::lround(point.x() * kOversampling)),
          static_cast<int>(std::lround(point.y() * kOversampling))};
}

int Thickness(double thickness_px) {
  return std::max(1, static_cast<int>(std::lround(thickness_px * kOversampling)));
}

double FontScale(double height_px) {
  constexpr double kCapitalHeight = 21;  // of OpenCV's fonts at scale 1
  return height_px * kOversampling / kCapitalHeight;
}

}  // namespace

Canvas::Canvas(int width_px, int height_px)
    : image_(height_px * kOversampling, width_px * kOversampling, CV_8UC3, cv::Scalar::all(255)) {}

void Canvas::Line(Eigen::Vector2d a, Eigen::Vector2d b, Rgb colour, double thickness_px) {
  cv::line(image_, ToFixed(a), ToFixed(b), ToScalar(colour), Thickness(thickness_px), cv::LINE_AA,
           kShift);
}

void Canvas::Polyline(const std::vector<Eigen::Vector2d>& points, Rgb colour, double thickness_px) {
  std::vector<cv::Point> fixed;
  for (const Eigen::Vector2d& point : points) fixed.push_back(ToFixed(point));
  cv::polylines(image_, fixed, false, ToScalar(colour), Thickness(thickness_px), cv::LINE_AA,
                kShift);
}

void Canvas::Dot(Eigen::Vector2d center, double radius_px, Rgb colour) {
  cv::circle(image_, ToFixed(center), ToFixed(radius_px), ToScalar(colour), cv::FILLED, cv::LINE_AA,
             kShift);
}

void Canvas::Circle(Eigen::Vector2d center, double radius_px, Rgb colour, double thickness_px) {
  cv::circle(image_, ToFixed(center), ToFixed(radius_px), ToScalar(colour), Thickness(thickness_px),
             cv::LINE_AA, kShift);
}

void Canvas::Box(Eigen::Vector2d min, Eigen::Vector2d max, Rgb fill, Rgb border) {
  const cv::Rect rect(Whole(min), Whole(max));
  cv::rectangle(image_, rect, ToScalar(fill), cv::FILLED);
  cv::rectangle(image_, rect, ToScalar(border), kOversampling);
}

void Canvas::Image(const cv::Mat& image, Eigen::Vector2d at, double scale) {
  cv::Mat enlarged;
  cv::resize(image, enlarged, {}, scale * kOversampling, scale * kOversampling, cv::INTER_CUBIC);
  if (enlarged.channels() == 1) cv::cvtColor(enlarged, enlarged, cv::COLOR_GRAY2BGR);
  const cv::Rect place =
      cv::Rect(Whole(at), enlarged.size()) & cv::Rect(cv::Point(0, 0), image_.size());
  enlarged(cv::Rect(place.tl() - Whole(at), place.size())).copyTo(image_(place));
}

void Canvas::Text(const std::string& text, Eigen::Vector2d at, double height_px, Rgb colour,
                  Anchor anchor) {
  const std::string ascii = ToAscii(text);
  const double width_px = TextWidth(ascii, height_px);
  if (anchor == Anchor::kMiddle) at.x() -= width_px / 2;
  if (anchor == Anchor::kRight) at.x() -= width_px;
  cv::putText(image_, ascii, Whole(at), kFont, FontScale(height_px), ToScalar(colour),
              kTextThickness, cv::LINE_AA);
}

double Canvas::TextWidth(const std::string& text, double height_px) {
  int base_line = 0;
  const cv::Size size =
      cv::getTextSize(ToAscii(text), kFont, FontScale(height_px), kTextThickness, &base_line);
  return static_cast<double>(size.width) / kOversampling;
}

void Canvas::Cloud(const std::vector<Eigen::Vector2d>& centers, Eigen::Vector2d min,
                   Eigen::Vector2d max, Rgb colour) {
  constexpr double kRadiusPx = 1.5;
  constexpr double kCrowd = 20000;  // more dots than this would merge into one dark area
  const double opacity =
      0.45 * std::sqrt(std::min(1.0, kCrowd / std::max<double>(1, centers.size())));
  const auto dot_transparency = static_cast<float>(1 - opacity);
  const cv::Rect frame(Whole(min), Whole(max));
  cv::Mat transparency(image_.size(), CV_32FC1, cv::Scalar(1));
  const int reach = static_cast<int>(kRadiusPx * kOversampling);
  for (const Eigen::Vector2d& center : centers) {
    const cv::Point middle = Whole(center);
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        const cv::Point pixel(middle.x + dx, middle.y + dy);
        if (dx * dx + dy * dy > reach * reach || !frame.contains(pixel)) continue;
        transparency.at<float>(pixel) *= dot_transparency;
      }
    }
  }
  Blend(transparency, colour);
}

cv::Mat Canvas::Finish() const {
  cv::Mat finished;
  cv::resize(image_, finished, image_.size() / kOversampling, 0, 0, cv::INTER_AREA);
  return finished;
}

void Canvas::Blend(const cv::Mat& transparency, Rgb colour) {
  const cv::Scalar ink = ToScalar(colour);
  for (int y = 0; y < image_.rows; ++y) {
    for (int x = 0; x < image_.cols; ++x) {
      const float share = transparency.at<float>(y, x);
      if (share == 1) continue;
      cv::Vec3b& pixel = image_.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c) {
        pixel[c] = cv::saturate_cast<uint8_t>(share * pixel[c] + (1 - share) * ink[c]);
      }
    }
  }
}

double RoundStepAtLeast(double value) {
  const double power = std::pow(10, std::floor(std::log10(value)));
  for (const double factor : {1, 2, 5}) {
    if (factor * power >= value * (1 - 1e-9)) return factor * power;
  }
  return 10 * power;
}

absl::Status WritePng(const std::filesystem::path& path, const cv::Mat& image) {
  std::vector<uchar> png;
  cv::imencode(".png", image, png);
  return WriteFileAtomically(
      path, std::string_view(reinterpret_cast<const char*>(png.data()), png.size()));
}

}  // namespace carmap
