#include "carmap/sim/road/route_shapes.h"

#include <absl/strings/str_format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "carmap/base/random.h"

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2d>;

constexpr double kStepM = 0.5;
constexpr double kCameraHeightM = 1.65;

/// Follows a heading, given by arc length, from the origin.
Points Follow(double length_m, const std::function<double(double)>& heading_at) {
  const auto steps = std::max<size_t>(2, static_cast<size_t>(std::lround(length_m / kStepM)));
  const double step_m = length_m / static_cast<double>(steps);
  Points points{Eigen::Vector2d::Zero()};
  for (size_t i = 0; i < steps; ++i) {
    const double heading = heading_at((static_cast<double>(i) + 0.5) * step_m);
    points.push_back(points.back() +
                     step_m * Eigen::Vector2d(std::cos(heading), std::sin(heading)));
  }
  return points;
}

Points Straight(double length_m, HashSequence draw) {
  const double heading = draw.Between(-M_PI, M_PI);
  const double phase_a = draw.Between(0, 2 * M_PI), phase_b = draw.Between(0, 2 * M_PI);
  return Follow(length_m, [=](double along_m) {
    return heading + 0.025 * std::sin(along_m / 60 + phase_a) +
           0.02 * std::sin(along_m / 23 + phase_b);
  });
}

/// A stretch of constant curvature; the curvature changes linearly from one to the next.
struct Arc {
  double begin_m, curvature_per_m;
};

/// Alternating straights and arcs whose heading stays within 60° of the general direction, so that
/// the line never comes back to itself.
std::vector<Arc> DrawArcs(double length_m, double min_radius_m, double max_radius_m,
                          HashSequence& draw) {
  std::vector<Arc> arcs;
  double along_m = 0, heading = 0;
  while (along_m < length_m) {
    arcs.push_back({along_m, 0});
    along_m += draw.Between(0.2, 1) * max_radius_m;
    const double target = draw.Between(0.25, 1.0) * (heading > 0 ? -1 : 1) * M_PI / 3;
    const double inverse = draw.Between(1 / max_radius_m, 1 / min_radius_m);
    arcs.push_back({along_m, std::copysign(inverse, target - heading)});
    along_m += std::abs(target - heading) / inverse;
    heading = target;
  }
  return arcs;
}

Points Curves(Scene scene, double length_m, HashSequence draw) {
  const double general = draw.Between(-M_PI, M_PI);
  const bool fast = scene == Scene::kFreeway;
  const std::vector<Arc> arcs = DrawArcs(length_m, fast ? 300 : 25, fast ? 900 : 120, draw);
  size_t arc = 0;
  double heading = general, at_m = 0;
  return Follow(length_m, [=](double along_m) mutable {
    while (arc + 1 < arcs.size() && arcs[arc + 1].begin_m <= along_m) ++arc;
    heading += arcs[arc].curvature_per_m * (along_m - at_m);
    at_m = along_m;
    return heading;
  });
}

/// Four streets round a block, to the left, with round corners.
Points Block(Scene scene, double length_m, HashSequence draw) {
  const double radius_m = std::min(scene == Scene::kFreeway ? 70.0 : 10.0, length_m / 12);
  const double straight_m = length_m - 2 * M_PI * radius_m;
  const double share = draw.Between(0.55, 0.65);
  const double general = draw.Between(-M_PI, M_PI);
  // Begins in the middle of a street, so that the start is not in a corner.
  const double sides[4] = {share * straight_m / 2, (1 - share) * straight_m / 2,
                           share * straight_m / 2, (1 - share) * straight_m / 2};
  const double corner_m = radius_m * M_PI / 2;
  return Follow(length_m, [=](double along_m) {
    double left_m = std::fmod(along_m + sides[0] / 2, length_m);
    const bool again = along_m + sides[0] / 2 >= length_m;
    double heading = general + (again ? 2 * M_PI : 0);
    for (const double side_m : sides) {
      if (left_m < side_m) break;
      left_m -= side_m;
      heading += std::min(left_m, corner_m) / radius_m;
      if (left_m < corner_m) break;
      left_m -= corner_m;
    }
    return heading;
  });
}

/// Integration leaves a gap of millimetres, which all points share.
void Close(Points& points) {
  const Eigen::Vector2d gap = points.back() - points.front();
  for (size_t i = 0; i < points.size(); ++i) {
    points[i] -= gap * static_cast<double>(i) / static_cast<double>(points.size() - 1);
  }
}

using Positions = std::vector<Eigen::Vector3d>;

/// Of the camera, in `enu`, where the vehicle has moved since the one before.
absl::StatusOr<Positions> MovingPositions(const Trajectory& poses) {
  constexpr double kMaxStepM = 5, kMinStepM = 0.3, kMaxLengthM = 50e3;
  Positions positions;
  std::optional<Eigen::Vector3d> last;
  double length_m = 0;
  size_t known = 0, frames_since = 0;
  for (size_t frame = 0; frame < poses.size(); ++frame) {
    ++frames_since;
    if (!poses[frame].world_from_camera) continue;
    const Eigen::Vector3d& p = poses[frame].world_from_camera->translation;
    const Eigen::Vector3d p_in_enu(p.x(), p.z(), -p.y());
    const double step_m = last ? (p_in_enu - *last).norm() : 0;
    if (!p.allFinite() || step_m > kMaxStepM * static_cast<double>(frames_since)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "pose %d lies %.3g m from the one before; a route needs neighbours within %g m", frame,
          step_m, kMaxStepM));
    }
    last = p_in_enu;
    frames_since = 0;
    ++known;
    length_m += step_m;
    if (length_m > kMaxLengthM) {
      return absl::InvalidArgumentError(
          absl::StrFormat("the poses go on for more than %g km; use a part of them", 50.0));
    }
    const bool moved =
        positions.empty() || (p_in_enu - positions.back()).head<2>().norm() >= kMinStepM;
    if (moved) positions.push_back(p_in_enu);
  }
  if (known < 2) return absl::InvalidArgumentError("a route needs at least two poses");
  if (positions.size() < 2) {
    return absl::InvalidArgumentError("the poses all lie within 0.3 m; a route needs a drive");
  }
  return positions;
}

/// Gaussian over arc length, which takes away what GPS adds; ends stay.
Positions SmoothAlong(const Positions& positions) {
  constexpr double kSigmaM = 2.5;
  std::vector<double> along{0};
  for (size_t i = 1; i < positions.size(); ++i) {
    along.push_back(along.back() + (positions[i] - positions[i - 1]).norm());
  }
  Positions smooth;
  for (size_t i = 0; i < positions.size(); ++i) {
    const double reach_m = std::min({3 * kSigmaM, along[i], along.back() - along[i]});
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double weights = 0;
    const auto add = [&](size_t k) {
      const double distance = (along[k] - along[i]) / kSigmaM;
      const double weight = std::exp(-0.5 * distance * distance);
      sum += weight * positions[k];
      weights += weight;
    };
    for (size_t k = i; k < positions.size() && along[k] - along[i] <= reach_m; ++k) add(k);
    for (size_t k = i; k-- > 0 && along[i] - along[k] <= reach_m;) add(k);
    smooth.push_back(sum / weights);
  }
  return smooth;
}

absl::Status CheckSlopes(const Positions& positions) {
  constexpr double kWindowM = 12, kMaxSlope = 0.35;
  size_t begin = 0;
  double run_m = 0;
  const auto step_m = [&](size_t i) { return (positions[i] - positions[i - 1]).head<2>().norm(); };
  for (size_t i = 1; i < positions.size(); ++i) {
    run_m += step_m(i);
    while (begin + 1 < i && run_m - step_m(begin + 1) >= kWindowM) run_m -= step_m(++begin);
    const double slope = std::abs(positions[i].z() - positions[begin].z()) / run_m;
    const bool whole_window = run_m >= kWindowM || i + 1 == positions.size();
    if (whole_window && slope > kMaxSlope) {
      return absl::InvalidArgumentError(
          absl::StrFormat("the path climbs %.0f %% after %.0f m; roads do up to %.0f %%: are these "
                          "poses in KITTI's "
                          "frame, y down and z forward?",
                          100 * slope, positions[i].head<2>().norm(), 100 * kMaxSlope));
    }
  }
  return absl::OkStatus();
}

/// Without points closer than Route takes.
Points Spaced(const Positions& positions) {
  Points points{positions.front().head<2>()};
  for (const Eigen::Vector3d& p : positions) {
    if ((p.head<2>() - points.back()).norm() >= 0.1) points.push_back(p.head<2>());
  }
  return points;
}

}  // namespace

Route MakeRoute(RouteShape shape, Scene scene, double length_m, uint64_t seed) {
  const HashSequence draw(seed, 0x707574);
  switch (shape) {
    case RouteShape::kStraight:
      return Route(Straight(length_m, draw), /*closed=*/false);
    case RouteShape::kCurves:
      return Route(Curves(scene, length_m, draw), /*closed=*/false);
    case RouteShape::kBlock:
      break;
  }
  Points points = Block(scene, length_m, draw);
  Close(points);
  return Route(points, /*closed=*/true);
}

absl::StatusOr<RecordedPath> RouteAlong(const Trajectory& poses) {
  const absl::StatusOr<Positions> positions = MovingPositions(poses);
  if (!positions.ok()) return positions.status();
  Positions smooth = SmoothAlong(*positions);
  if (const absl::Status status = CheckSlopes(smooth); !status.ok()) return status;
  const Points points = Spaced(smooth);
  if (points.size() < 2 ||
      (points.back() - points.front()).norm() + Route(points, false).length_m() < 1) {
    return absl::InvalidArgumentError("the poses span less than a metre; a route needs a drive");
  }
  for (Eigen::Vector3d& p : smooth) p.z() -= kCameraHeightM;
  return RecordedPath{Route(points, /*closed=*/false), std::move(smooth)};
}

}  // namespace carmap
