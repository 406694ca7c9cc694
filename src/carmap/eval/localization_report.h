// What `carmap localize --report` tells of each frame, read back to be evaluated.
//
// The bytes are from outside: whatever they are, reading takes time and memory in proportion to
// them and ends in a report or an error. Pure functions, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <compare>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/vehicle/base_tracker.h"

namespace carmap {

/// The conditions under which a map was made and a drive localized in it.
struct LocalizationCell {
  std::string scene;
  int width_px = 0, height_px = 0;
  std::string map_traffic;  ///< while the map was made, in sunshine and lane 0
  int lane = 0;             ///< of the localized drive
  std::string traffic, light;
  std::string method;  ///< of matching; empty: CarMap's own

  auto operator<=>(const LocalizationCell&) const = default;
};

/// "suburb, map none, drive dense, lane 1, low-sun": all but size and method.
std::string ToText(const LocalizationCell& cell);

struct ReportedFrame {
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

  KnownBy known_by = KnownBy::kLost;
  double dead_reckoned_m = 0;
  /// Against the truth; NaN if the frame is lost.
  double position_error_m = kNone, rotation_error_deg = kNone;
  double map_position_error_m = kNone;  ///< against the map's own trajectory (MapTruth)
  /// Of the position against the map's own trajectory (NormalizedError), and the standard deviation
  /// that the localizer states.
  double squared_mahalanobis = kNone, sigma_m = kNone;
  double ms = kNone;
};

struct LocalizationReport {
  LocalizationCell cell;
  uint64_t seed = 0;  ///< of the scene
  std::vector<ReportedFrame> frames;
  std::optional<double> map_bytes;
};

/// `name` is that of the report's file, which tells its cell and seed:
/// SCENE-sSEED-WxH-map_TRAFFIC-to-laneN-TRAFFIC-LIGHT[-by_METHOD].json. Errors: InvalidArgument,
/// one line with `name`, if it has another form, or the report no frames or no errors.
absl::StatusOr<LocalizationReport> ParseLocalizationReport(std::string_view json,
                                                           const std::string& name);

}  // namespace carmap
