// The line that the world is built along and that vehicles follow, by arc length.
//
// Planar, in `enu`; the ground gives the height. It is the path of the vehicle in its own lane;
// other lanes are offsets to the left (positive). Immutable, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <vector>

#include "carmap/dataset/trajectory.h"

namespace carmap {

struct RoutePoint {
  Eigen::Vector2d position_in_enu = Eigen::Vector2d::Zero();
  double heading_rad = 0;      ///< from east towards north
  double curvature_per_m = 0;  ///< positive to the left
};

class Route {
 public:
  /// Through the points, which are at least 0.1 m apart, smoothed and resampled at 0.5 m. A closed
  /// route ends where it begins and goes on for ever.
  Route(const std::vector<Eigen::Vector2d>& points_in_enu, bool closed);

  double length_m() const { return length_m_; }
  bool closed() const { return closed_; }
  /// At `along_m` from the start, `left_m` to the left of it. Open routes go straight on beyond
  /// their ends.
  RoutePoint At(double along_m, double left_m = 0) const;
  const std::vector<Eigen::Vector2d>& points() const { return points_; }  ///< 0.5 m apart

 private:
  std::vector<Eigen::Vector2d> points_;
  std::vector<double> headings_;
  double length_m_ = 0, step_m_ = 0.5;
  bool closed_ = false;
};

}  // namespace carmap
