#include "carmap/eval/map_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "carmap/eval/canvas.h"

namespace carmap {
namespace {

// Lengths named _px are of the finished picture.
constexpr double kLongSidePx = 1600, kMinPlotWidthPx = 1000;
constexpr int kLeftMarginPx = 84, kRightMarginPx = 28, kTopMarginPx = 66, kBottomMarginPx = 74;
constexpr Rgb kLandmarkColour{88, 110, 117};

using Points = std::vector<Eigen::Vector3d>;

/// A stretch of the ground, in metres.
struct View {
  Eigen::Vector2d min, max;  ///< (x, z)
  Eigen::Vector2d size() const { return max - min; }
};

bool IsDrawable(const Eigen::Vector3d& p) {
  constexpr double kMaxM = 1e9;
  return p.allFinite() && p.cwiseAbs().maxCoeff() <= kMaxM;
}

std::optional<View> BoundingBox(const std::vector<PicturePath>& paths) {
  std::optional<View> box;
  for (const PicturePath& path : paths) {
    for (const Eigen::Vector3d& p : path.positions_in_map) {
      if (!IsDrawable(p)) continue;
      const Eigen::Vector2d ground(p.x(), p.z());
      if (!box) box = View{ground, ground};
      box->min = box->min.cwiseMin(ground);
      box->max = box->max.cwiseMax(ground);
    }
  }
  return box;
}

/// The middle 90 % in x and in z.
std::optional<View> MiddleOf(const Points& landmarks) {
  std::vector<double> xs, zs;
  for (const Eigen::Vector3d& p : landmarks) {
    if (!IsDrawable(p)) continue;
    xs.push_back(p.x());
    zs.push_back(p.z());
  }
  if (xs.empty()) return std::nullopt;
  std::sort(xs.begin(), xs.end());
  std::sort(zs.begin(), zs.end());
  const size_t low = xs.size() / 20, high = xs.size() - 1 - low;
  return View{{xs[low], zs[low]}, {xs[high], zs[high]}};
}

/// The part of a view in which there are landmarks, with some room around it; all of `content`
/// stays.
View ShrinkToLandmarks(const View& view, const View& content, const Points& landmarks) {
  constexpr double kRoomM = 5;
  View shrunk = content;
  for (const Eigen::Vector3d& p : landmarks) {
    const Eigen::Vector2d ground(p.x(), p.z());
    if ((ground.array() < view.min.array()).any() || (ground.array() > view.max.array()).any() ||
        !ground.allFinite()) {
      continue;
    }
    shrunk.min = shrunk.min.cwiseMin(ground);
    shrunk.max = shrunk.max.cwiseMax(ground);
  }
  const Eigen::Vector2d room = Eigen::Vector2d::Constant(kRoomM);
  return {(shrunk.min - room).cwiseMax(view.min), (shrunk.max + room).cwiseMin(view.max)};
}

View ChooseView(const MapPicture& picture) {
  constexpr double kMarginM = 40, kMinAspect = kMinPlotWidthPx / kLongSidePx, kMaxAspect = 2;
  std::optional<View> content = BoundingBox(picture.paths);
  if (!content) content = MiddleOf(picture.landmarks_in_map);
  if (!content) content = View{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  const Eigen::Vector2d margin = Eigen::Vector2d::Constant(kMarginM);
  const View box = ShrinkToLandmarks({content->min - margin, content->max + margin}, *content,
                                     picture.landmarks_in_map);
  Eigen::Vector2d size = box.size();
  size.x() = std::max(size.x(), kMinAspect * size.y());
  size.y() = std::max(size.y(), size.x() / kMaxAspect);
  const Eigen::Vector2d center = (box.min + box.max) / 2;
  return {center - size / 2, center + size / 2};
}

/// Where a view stands in the picture.
class Plot {
 public:
  explicit Plot(const View& view) : view_(view), px_per_m_(kLongSidePx / view.size().maxCoeff()) {}

  const View& view() const { return view_; }
  double px_per_m() const { return px_per_m_; }
  Eigen::Vector2d size_px() const { return px_per_m_ * view_.size(); }
  Eigen::Vector2d min_px() const { return {kLeftMarginPx, kTopMarginPx}; }
  Eigen::Vector2d max_px() const { return min_px() + size_px(); }
  /// z goes up where the picture's rows go down.
  Eigen::Vector2d ToPicture(double x, double z) const {
    return min_px() + px_per_m_ * Eigen::Vector2d(x - view_.min.x(), view_.max.y() - z);
  }

 private:
  View view_;
  double px_per_m_;
};

void DrawGrid(const Plot& plot, Canvas& canvas) {
  constexpr double kSpacingPx = 110, kLabelPx = 11, kNamePx = 12;
  const double step_m = RoundStepAtLeast(kSpacingPx / plot.px_per_m());
  const View& view = plot.view();
  const auto first = [&](double min) { return std::ceil(min / step_m); };
  // Adding 0 turns -0 into 0.
  const auto label = [&](double i) { return fmt::format("{:g}", i * step_m + 0.0); };
  for (double i = first(view.min.x()); i * step_m <= view.max.x(); ++i) {
    const double x = plot.ToPicture(i * step_m, 0).x();
    canvas.Line({x, plot.min_px().y()}, {x, plot.max_px().y()}, kGridColour, 1);
    canvas.Text(label(i), {x, plot.max_px().y() + 24}, kLabelPx, kGrey, Anchor::kMiddle);
  }
  for (double i = first(view.min.y()); i * step_m <= view.max.y(); ++i) {
    const double y = plot.ToPicture(0, i * step_m).y();
    canvas.Line({plot.min_px().x(), y}, {plot.max_px().x(), y}, kGridColour, 1);
    canvas.Text(label(i), {plot.min_px().x() - 10, y + kLabelPx / 2}, kLabelPx, kGrey,
                Anchor::kRight);
  }
  const double middle = (plot.min_px().x() + plot.max_px().x()) / 2;
  canvas.Text("x, to the right (m)", {middle, plot.max_px().y() + 54}, kNamePx, kBlack,
              Anchor::kMiddle);
  canvas.Text("z, forward (m)", {14, plot.min_px().y() - 16}, kNamePx, kBlack, Anchor::kLeft);
}

void DrawFrame(const Plot& plot, Canvas& canvas) {
  const Eigen::Vector2d a = plot.min_px(), b = plot.max_px();
  canvas.Polyline({a, {b.x(), a.y()}, b, {a.x(), b.y()}, a}, kFrameColour, 1);
}

void DrawLandmarks(const Plot& plot, const Points& landmarks, Canvas& canvas) {
  std::vector<Eigen::Vector2d> centers;
  const View& view = plot.view();
  for (const Eigen::Vector3d& p : landmarks) {
    const bool is_inside = p.x() > view.min.x() && p.x() < view.max.x() && p.z() > view.min.y() &&
                           p.z() < view.max.y();
    if (is_inside) centers.push_back(plot.ToPicture(p.x(), p.z()));
  }
  canvas.Cloud(centers, plot.min_px(), plot.max_px(), kLandmarkColour);
}

constexpr double kDotRadiusPx = 3.5;

/// Lines further below are wider, so that they show where they coincide.
double LineWidthPx(const std::vector<PicturePath>& paths, size_t path_idx) {
  constexpr double kTopPx = 2, kWidestPx = 7, kStepPx = 2.5;
  const auto lines_above =
      std::count_if(paths.begin() + static_cast<std::ptrdiff_t>(path_idx) + 1, paths.end(),
                    [](const PicturePath& path) { return !path.as_dots; });
  return std::min(kWidestPx, kTopPx + kStepPx * static_cast<double>(lines_above));
}

void DrawPath(const Plot& plot, const PicturePath& path, double width_px, Canvas& canvas) {
  std::vector<Eigen::Vector2d> line;
  const auto draw_line = [&] {
    if (line.size() > 1) canvas.Polyline(line, path.colour, width_px);
    line.clear();
  };
  for (const Eigen::Vector3d& p : path.positions_in_map) {
    if (!IsDrawable(p)) {
      draw_line();  // a gap where the frame was lost
    } else if (path.as_dots) {
      canvas.Dot(plot.ToPicture(p.x(), p.z()), kDotRadiusPx, path.colour);
    } else {
      line.push_back(plot.ToPicture(p.x(), p.z()));
    }
  }
  draw_line();
}

void DrawLegend(const Plot& plot, const MapPicture& picture, Canvas& canvas) {
  constexpr double kRowPx = 28, kTextPx = 12, kPaddingPx = 14, kSamplePx = 34, kInsetPx = 16;
  const std::string landmarks = fmt::format("{} landmarks", picture.landmarks_in_map.size());
  double text_width_px = Canvas::TextWidth(landmarks, kTextPx);
  for (const PicturePath& path : picture.paths) {
    text_width_px = std::max(text_width_px, Canvas::TextWidth(path.name, kTextPx));
  }
  const auto named = std::count_if(picture.paths.begin(), picture.paths.end(),
                                   [](const PicturePath& path) { return !path.name.empty(); });
  const auto rows = static_cast<double>(named + 1);
  const Eigen::Vector2d size(kSamplePx + text_width_px + 3 * kPaddingPx,
                             rows * kRowPx + kPaddingPx);
  const Eigen::Vector2d min(plot.max_px().x() - kInsetPx - size.x(), plot.min_px().y() + kInsetPx);
  canvas.Box(min, min + size, {255, 255, 255}, kFrameColour);

  Eigen::Vector2d sample = min + Eigen::Vector2d(kPaddingPx, kPaddingPx / 2 + kRowPx / 2);
  const auto write_row = [&](const std::string& text) {
    canvas.Text(text, sample + Eigen::Vector2d(kSamplePx + kPaddingPx, kTextPx / 2), kTextPx,
                kBlack, Anchor::kLeft);
    sample.y() += kRowPx;
  };
  for (size_t i = 0; i < picture.paths.size(); ++i) {
    const PicturePath& path = picture.paths[i];
    if (path.name.empty()) continue;
    const Eigen::Vector2d half(kSamplePx / 2, 0);
    if (path.as_dots) {
      canvas.Dot(sample + half, kDotRadiusPx, path.colour);
    } else {
      canvas.Line(sample, sample + 2 * half, path.colour, LineWidthPx(picture.paths, i));
    }
    write_row(path.name);
  }
  for (const auto& [dx, dy] : {std::pair{6, 3}, {15, -4}, {22, 4}, {30, -2}}) {
    canvas.Dot(sample + Eigen::Vector2d(dx, dy), 1.5, kLandmarkColour);
  }
  write_row(landmarks);
}

void DrawScaleBar(const Plot& plot, Canvas& canvas) {
  constexpr double kMinLengthPx = 120, kInsetPx = 30, kTextPx = 12, kTickPx = 6, kHeightPx = 52;
  const double length_m = RoundStepAtLeast(kMinLengthPx / plot.px_per_m());
  const double length_px = length_m * plot.px_per_m();
  const Eigen::Vector2d a(plot.min_px().x() + kInsetPx, plot.max_px().y() - kInsetPx);
  const Eigen::Vector2d b = a + Eigen::Vector2d(length_px, 0), tick(0, kTickPx);
  canvas.Box(a - Eigen::Vector2d(14, kHeightPx - 14), b + Eigen::Vector2d(14, 14), {255, 255, 255},
             kFrameColour);
  canvas.Line(a, b, kBlack, 2);
  canvas.Line(a - tick, a + tick, kBlack, 2);
  canvas.Line(b - tick, b + tick, kBlack, 2);
  canvas.Text(fmt::format("{:g} m", length_m), (a + b) / 2 - Eigen::Vector2d(0, 14), kTextPx,
              kBlack, Anchor::kMiddle);
}

void DrawTitle(const Plot& plot, const std::string& title, Canvas& canvas) {
  constexpr double kMaxTextPx = 18, kRoomForAxisPx = 110;
  const double room_px = plot.size_px().x() - 2 * kRoomForAxisPx;
  const double width_px = std::max(Canvas::TextWidth(title, kMaxTextPx), 1.0);
  const double middle = (plot.min_px().x() + plot.max_px().x()) / 2;
  canvas.Text(title, {middle, 40}, kMaxTextPx * std::min(1.0, room_px / width_px), kBlack,
              Anchor::kMiddle);
}

}  // namespace

cv::Mat RenderMapPicture(const MapPicture& picture) {
  const Plot plot(ChooseView(picture));
  const Eigen::Vector2i size = (plot.max_px() + Eigen::Vector2d(kRightMarginPx, kBottomMarginPx))
                                   .array()
                                   .ceil()
                                   .matrix()
                                   .cast<int>();
  Canvas canvas(size.x(), size.y());
  DrawGrid(plot, canvas);
  DrawLandmarks(plot, picture.landmarks_in_map, canvas);
  for (size_t i = 0; i < picture.paths.size(); ++i) {
    DrawPath(plot, picture.paths[i], LineWidthPx(picture.paths, i), canvas);
  }
  DrawFrame(plot, canvas);
  DrawLegend(plot, picture, canvas);
  DrawScaleBar(plot, canvas);
  DrawTitle(plot, picture.title, canvas);
  return canvas.Finish();
}

absl::Status WriteMapPicture(const std::filesystem::path& path, const MapPicture& picture) {
  return WritePng(path, RenderMapPicture(picture));
}

}  // namespace carmap
