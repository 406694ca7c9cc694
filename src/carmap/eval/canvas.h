// Drawing with lines, dots and text, for pictures of results.
//
// Coordinates and lengths are pixels of the finished picture. Everything is drawn at twice the size
// and then reduced: text and thin lines come out smooth. Not thread-safe.
#pragma once

#include <absl/status/status.h>

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace carmap {

struct Rgb {
  uint8_t red = 0, green = 0, blue = 0;
};

/// Colours that can be told apart on white, also by most colour-blind people.
inline constexpr Rgb kEstimateColour{0, 90, 181}, kTruthColour{220, 50, 32},
    kKeyframeColour{230, 159, 0};
inline constexpr Rgb kBlack{30, 30, 30}, kGrey{110, 110, 110}, kGridColour{226, 229, 233},
    kFrameColour{150, 150, 150};

enum class Anchor { kLeft, kMiddle, kRight };

class Canvas {
 public:
  /// White.
  Canvas(int width_px, int height_px);

  void Line(Eigen::Vector2d a, Eigen::Vector2d b, Rgb colour, double thickness_px);
  void Polyline(const std::vector<Eigen::Vector2d>& points, Rgb colour, double thickness_px);
  void Dot(Eigen::Vector2d center, double radius_px, Rgb colour);
  void Circle(Eigen::Vector2d center, double radius_px, Rgb colour, double thickness_px);
  void Box(Eigen::Vector2d min, Eigen::Vector2d max, Rgb fill, Rgb border);
  /// 8-bit grey or BGR, its left upper corner at `at`, enlarged by `scale`.
  void Image(const cv::Mat& image, Eigen::Vector2d at, double scale);
  /// `at` is on the base line. Capitals are `height_px` high. What is not ASCII becomes '?'.
  void Text(const std::string& text, Eigen::Vector2d at, double height_px, Rgb colour,
            Anchor anchor);
  static double TextWidth(const std::string& text, double height_px);
  /// Half-transparent dots: where many lie close together it gets darker. Dots stay between `min`
  /// and `max`.
  void Cloud(const std::vector<Eigen::Vector2d>& centers, Eigen::Vector2d min, Eigen::Vector2d max,
             Rgb colour);

  /// 8-bit BGR.
  cv::Mat Finish() const;

 private:
  void Blend(const cv::Mat& transparency, Rgb colour);

  cv::Mat image_;
};

/// 1, 2 or 5 times a power of ten, the first that is not smaller: a step between grid lines.
double RoundStepAtLeast(double value);

/// Errors: as WriteFileAtomically.
absl::Status WritePng(const std::filesystem::path& path, const cv::Mat& image);

}  // namespace carmap
