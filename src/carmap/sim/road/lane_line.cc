#include "carmap/sim/road/lane_line.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2d>;

double StepOf(const Route& route) {
  return route.length_m() / static_cast<double>(route.points().size() - 1);
}

/// Offset lines fold back where the route turns sharper than the offset; a folded point comes
/// nearer to the route than that.
bool IsFolded(const Route& route, size_t i, const Eigen::Vector2d& point, double left_m) {
  const auto count = static_cast<int64_t>(route.points().size());
  const auto reach = static_cast<int64_t>(std::ceil(2 * std::abs(left_m) / StepOf(route))) + 4;
  const double nearest = std::max(0.0, std::abs(left_m) - 0.2);
  for (int64_t k = -reach; k <= reach; ++k) {
    const int64_t neighbour = static_cast<int64_t>(i) + k;
    if (!route.closed() && (neighbour < 0 || neighbour >= count)) continue;
    const int64_t period = count - 1;
    const auto wrapped =
        static_cast<size_t>(route.closed() ? ((neighbour % period) + period) % period : neighbour);
    if ((route.points()[wrapped] - point).squaredNorm() < nearest * nearest) return true;
  }
  return false;
}

/// The line's points, and how far along it each of the route's points has come.
std::pair<Points, std::vector<double>> Offset(const Route& route, double left_m) {
  Points points;
  std::vector<double> along;
  double length_m = 0;
  for (size_t i = 0; i < route.points().size(); ++i) {
    const Eigen::Vector2d point =
        route.At(static_cast<double>(i) * StepOf(route), left_m).position_in_enu;
    const double step_m = points.empty() ? 0 : (point - points.back()).norm();
    const bool too_near = !points.empty() && step_m < 0.1;
    if (!too_near && !IsFolded(route, i, point, left_m)) {
      length_m += step_m;
      points.push_back(point);
    }
    along.push_back(length_m);
  }
  if (route.closed()) length_m += (points.front() - points.back()).norm();
  for (double& a : along) a /= length_m;
  return {std::move(points), std::move(along)};
}

}  // namespace

LaneLine::LaneLine(const Route& route, double left_m)
    : route_length_m_(route.length_m()), route_step_m_(StepOf(route)), path_(route) {
  auto [points, along] = Offset(route, left_m);
  path_ = Route(points, route.closed());
  along_of_route_point_ = std::move(along);
  for (double& a : along_of_route_point_) a *= path_.length_m();
  if (route.closed()) along_of_route_point_.back() = path_.length_m();
}

double LaneLine::Beside(double along_route_m) const {
  const double laps = path_.closed() ? std::floor(along_route_m / route_length_m_) : 0;
  const double wrapped = along_route_m - laps * route_length_m_;
  const double inside = std::clamp(wrapped, 0.0, route_length_m_);
  const auto i =
      std::min(static_cast<size_t>(inside / route_step_m_), along_of_route_point_.size() - 2);
  const double t = inside / route_step_m_ - static_cast<double>(i);
  return laps * path_.length_m() + (wrapped - inside) +
         std::lerp(along_of_route_point_[i], along_of_route_point_[i + 1], t);
}

SpeedLimit::SpeedLimit(const Route& path, double sideways, double lengthways)
    : length_m_(path.length_m()), step_m_(StepOf(path)), closed_(path.closed()) {
  constexpr double kStraight = 1e-6;
  for (size_t i = 0; i < path.points().size(); ++i) {
    const double curvature =
        std::abs(path.At(static_cast<double>(i) * step_m_).curvature_per_m) + kStraight;
    limits_.push_back(std::sqrt(sideways / curvature));
  }
  const auto bound = [&](size_t i, size_t neighbour) {
    limits_[i] =
        std::min(limits_[i], std::hypot(limits_[neighbour], std::sqrt(2 * lengthways * step_m_)));
  };
  for (int round = 0; round < (closed_ ? 2 : 1); ++round) {
    for (size_t i = 1; i < limits_.size(); ++i) bound(i, i - 1);
    for (size_t i = limits_.size() - 1; i-- > 0;) bound(i, i + 1);
    if (closed_) limits_.front() = limits_.back() = std::min(limits_.front(), limits_.back());
  }
}

double SpeedLimit::At(double along_m) const {
  const double wrapped = closed_ ? along_m - length_m_ * std::floor(along_m / length_m_) : along_m;
  const double inside = std::clamp(wrapped, 0.0, length_m_);
  const auto i = std::min(static_cast<size_t>(inside / step_m_), limits_.size() - 2);
  return std::lerp(limits_[i], limits_[i + 1], inside / step_m_ - static_cast<double>(i));
}

}  // namespace carmap
