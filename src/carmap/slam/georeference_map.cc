#include "carmap/slam/georeference_map.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "carmap/geometry/median_place.h"
#include "carmap/solve/georeference.h"

namespace carmap {
namespace {

Eigen::Vector3d SigmaOf(const GpsOptions& options) {
  return options.sigma_m * Eigen::Vector3d(1, 1, options.vertical_factor);
}

/// Fixes within the time in which their errors hardly change, this one included.
size_t CountTogether(const std::vector<double>& times_s, double time_s, double correlation_s) {
  const auto begin = std::lower_bound(times_s.begin(), times_s.end(), time_s - correlation_s / 2);
  const auto end = std::upper_bound(times_s.begin(), times_s.end(), time_s + correlation_s / 2);
  return static_cast<size_t>(std::max<std::ptrdiff_t>(end - begin, 1));
}

/// Farther from where all of them put the vehicle no error of a receiver and no drift of the map
/// takes a fix. However robust the loss, it would pull while that is still wide.
double MaxErrorM(const Map& map, const GpsOptions& options) {
  constexpr double kSigmas = 10, kMaxDriftRatio = 0.02;
  double length_m = 0;
  std::optional<Eigen::Vector3d> previous;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Eigen::Vector3d& position = keyframe.map_from_camera.translation;
    if (previous) length_m += (position - *previous).norm();
    previous = position;
  }
  return kSigmas * options.vertical_factor * std::hypot(options.sigma_m, kMaxDriftRatio * length_m);
}

}  // namespace

std::optional<Georeference> GeoreferenceOf(const std::vector<PlacedFix>& fixes,
                                           const GpsOptions& options) {
  if (fixes.empty()) return std::nullopt;
  std::vector<GpsFix> places;
  for (const PlacedFix& placed : fixes) places.push_back(placed.fix);
  const GpsFix origin = MedianPlace(places);
  const LocalEnu enu(origin);
  std::vector<CameraFix> camera_fixes;
  for (const auto& [map_from_camera, fix] : fixes) {
    camera_fixes.push_back({map_from_camera, enu.FromGps(fix), SigmaOf(options)});
  }
  const auto enu_from_map = AlignToFixes(camera_fixes, options.min_extent_m);
  if (!enu_from_map) return std::nullopt;
  return Georeference{origin, *enu_from_map};
}

std::optional<Georeference> GeoreferenceOf(const Map& map, const GpsOptions& options) {
  std::vector<PlacedFix> fixes;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (keyframe.gps) fixes.push_back({keyframe.map_from_camera, *keyframe.gps});
  }
  return GeoreferenceOf(fixes, options);
}

std::optional<Georeference> GeoreferenceOf(const LeanMap& map, const GpsOptions& options) {
  std::vector<PlacedFix> fixes;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    if (keyframe.gps) fixes.push_back({keyframe.map_from_camera, *keyframe.gps});
  }
  return GeoreferenceOf(fixes, options);
}

std::optional<Georeference> SettledGeoreferenceOf(const LeanMap& map, const GpsOptions& options) {
  constexpr double kSettledM = 1;
  constexpr size_t kEnoughFixes = 256;  // evenly out of more
  std::vector<PlacedFix> fixes;
  for (size_t i = 0; i < map.keyframes.size(); i += 1 + map.keyframes.size() / kEnoughFixes) {
    const LeanKeyframe& keyframe = map.keyframes[i];
    if (keyframe.gps) fixes.push_back({keyframe.map_from_camera, *keyframe.gps});
  }
  const auto georeference = GeoreferenceOf(fixes, options);
  if (!georeference) return std::nullopt;
  const LocalEnu enu(georeference->origin);
  const auto settled = std::count_if(fixes.begin(), fixes.end(), [&](const PlacedFix& placed) {
    const Eigen::Vector3d p_in_enu =
        georeference->enu_from_map * placed.map_from_camera.translation;
    return (enu.FromGps(placed.fix) - p_in_enu).head<2>().norm() <= kSettledM;
  });
  if (10 * settled < 9 * static_cast<std::ptrdiff_t>(fixes.size())) return std::nullopt;
  return georeference;
}

std::vector<PositionPrior> FixesAsPriors(const Map& map, const GpsOptions& options) {
  const auto georeference = GeoreferenceOf(map, options);
  if (!georeference) return {};
  std::vector<double> times_s;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (keyframe.gps) times_s.push_back(keyframe.timestamp.seconds());
  }
  std::sort(times_s.begin(), times_s.end());

  const LocalEnu enu(georeference->origin);
  const Rigid3 map_from_enu = georeference->enu_from_map.Inverse();
  const Eigen::Matrix3d sqrt_information = SigmaOf(options).cwiseInverse().asDiagonal() *
                                           georeference->enu_from_map.rotation.toRotationMatrix();
  std::vector<PositionPrior> priors;
  uint32_t pose_idx = 0;
  const double max_error_m = MaxErrorM(map, options);
  for (const auto& [id, keyframe] : map.keyframes()) {
    const uint32_t idx = pose_idx++;
    if (!keyframe.gps) continue;
    const Eigen::Vector3d p_in_enu =
        georeference->enu_from_map * keyframe.map_from_camera.translation;
    if (!((enu.FromGps(*keyframe.gps) - p_in_enu).norm() <= max_error_m)) continue;
    const auto together = static_cast<double>(
        CountTogether(times_s, keyframe.timestamp.seconds(), options.correlation_s));
    priors.push_back({.pose_idx = idx,
                      .position_in_map = map_from_enu * enu.FromGps(*keyframe.gps),
                      .sqrt_information = sqrt_information,
                      .weight = 1 / together});
  }
  return priors;
}

std::vector<double> FixErrorsM(const Map& map, const Georeference& georeference) {
  const LocalEnu enu(georeference.origin);
  std::vector<double> errors_m;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (!keyframe.gps) continue;
    const Eigen::Vector3d p_in_enu =
        georeference.enu_from_map * keyframe.map_from_camera.translation;
    errors_m.push_back((enu.FromGps(*keyframe.gps) - p_in_enu).head<2>().norm());
  }
  return errors_m;
}

void ReplaceFixes(const Georeference& georeference, LeanMap& map) {
  const LocalEnu enu(georeference.origin);
  for (LeanKeyframe& keyframe : map.keyframes) {
    keyframe.gps = enu.ToGps(georeference.enu_from_map * keyframe.map_from_camera.translation);
  }
}

}  // namespace carmap
