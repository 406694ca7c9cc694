#include "carmap/sim/road/route.h"

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2d>;

constexpr double kStepM = 0.5, kSmoothingSigmaM = 2;

/// Equidistant, with the distance nearest to kStepM that divides the whole.
Points Resample(const Points& points) {
  std::vector<double> along{0};
  for (size_t i = 1; i < points.size(); ++i) {
    along.push_back(along.back() + (points[i] - points[i - 1]).norm());
  }
  const auto steps = std::max<size_t>(1, static_cast<size_t>(std::lround(along.back() / kStepM)));
  Points resampled;
  for (size_t i = 0, segment = 0; i <= steps; ++i) {
    const double s = along.back() * static_cast<double>(i) / static_cast<double>(steps);
    while (segment + 2 < points.size() && along[segment + 1] < s) ++segment;
    const double t = (s - along[segment]) / (along[segment + 1] - along[segment]);
    resampled.push_back(points[segment] +
                        std::clamp(t, 0.0, 1.0) * (points[segment + 1] - points[segment]));
  }
  return resampled;
}

/// Gaussian along the line; a window that shrinks towards open ends keeps them where they are.
Points Smooth(const Points& points, bool closed) {
  const int count = static_cast<int>(points.size()), period = count - 1;
  const int radius = static_cast<int>(std::lround(3 * kSmoothingSigmaM / kStepM));
  Points smooth;
  for (int i = 0; i < count; ++i) {
    const int window = closed ? std::min(radius, period / 2) : std::min({radius, i, count - 1 - i});
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double weights = 0;
    for (int k = -window; k <= window; ++k) {
      const double distance = k * kStepM / kSmoothingSigmaM;
      const double weight = std::exp(-0.5 * distance * distance);
      sum += weight * points[static_cast<size_t>(closed ? (i + k + period) % period : i + k)];
      weights += weight;
    }
    smooth.push_back(sum / weights);
  }
  return smooth;
}

double Between(double angle_a, double angle_b) {
  return std::remainder(angle_b - angle_a, 2 * M_PI);
}

}  // namespace

Route::Route(const std::vector<Eigen::Vector2d>& points_in_enu, bool closed) : closed_(closed) {
  Points points = points_in_enu;
  if (closed && (points.front() - points.back()).norm() > 1e-6) points.push_back(points.front());
  points_ = Resample(Smooth(Resample(points), closed));
  const size_t last = points_.size() - 1;
  step_m_ = (points_[1] - points_[0]).norm();
  length_m_ = step_m_ * static_cast<double>(last);
  for (size_t i = 0; i <= last; ++i) {
    const size_t before = i > 0 ? i - 1 : (closed ? last - 1 : 0);
    const size_t after = i < last ? i + 1 : (closed ? 1 : last);
    const Eigen::Vector2d along = points_[after] - points_[before];
    headings_.push_back(std::atan2(along.y(), along.x()));
  }
}

RoutePoint Route::At(double along_m, double left_m) const {
  const double wrapped = closed_ ? along_m - length_m_ * std::floor(along_m / length_m_) : along_m;
  const double inside = std::clamp(wrapped, 0.0, length_m_);
  const auto i = std::min(static_cast<size_t>(inside / step_m_), points_.size() - 2);
  const double t = inside / step_m_ - static_cast<double>(i);
  const double turn = Between(headings_[i], headings_[i + 1]);
  RoutePoint point;
  point.heading_rad = headings_[i] + t * turn;
  point.curvature_per_m = turn / step_m_;
  const Eigen::Vector2d forward(std::cos(point.heading_rad), std::sin(point.heading_rad));
  point.position_in_enu = points_[i] + t * (points_[i + 1] - points_[i]) +
                          (wrapped - inside) * forward +
                          left_m * Eigen::Vector2d(-forward.y(), forward.x());
  return point;
}

}  // namespace carmap
