#include "carmap/slam/fix_judgement.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "carmap/base/summary.h"

namespace carmap {
namespace {

/// A vehicle that stands seems to move by less.
constexpr double kStandsWithinM = 0.5;
/// Fixes are heard once for so much driven: where it stands a vehicle would hear one error over and
/// over.
constexpr double kWitnessStepM = 1;
constexpr size_t kMinWitnesses = 5;
constexpr double kMaxSigmas = 3;  // of a fix that agrees

struct Row {
  PlacedFix placed;
  bool is_frozen = false;
};

/// Between the two frames around; at an end, the frame there. Nothing where the vehicle was lost.
std::optional<Rigid3> PoseAt(const Trajectory& map_from_camera, Timestamp time) {
  const auto after =
      std::lower_bound(map_from_camera.begin(), map_from_camera.end(), time,
                       [](const TimedPose& pose, Timestamp t) { return pose.timestamp < t; });
  if (after == map_from_camera.end()) return map_from_camera.back().world_from_camera;
  if (after == map_from_camera.begin()) return after->world_from_camera;
  const TimedPose& before = *(after - 1);
  if (!before.world_from_camera || !after->world_from_camera) return std::nullopt;
  const double fraction = static_cast<double>(time.ns - before.timestamp->ns) /
                          static_cast<double>(after->timestamp->ns - before.timestamp->ns);
  const Rigid3 &a = *before.world_from_camera, &b = *after->world_from_camera;
  return Rigid3{a.rotation.slerp(fraction, b.rotation),
                a.translation + fraction * (b.translation - a.translation)};
}

std::vector<Row> RowsAlong(const GpsLog& log, const Trajectory& map_from_camera) {
  std::vector<Row> rows;
  FreezeDetector detector;
  for (const auto& [time, fix] : log.fixes()) {
    if (!GpsLog::IsWithin(time, *map_from_camera.front().timestamp,
                          *map_from_camera.back().timestamp)) {
      continue;
    }
    const auto pose = PoseAt(map_from_camera, time);
    if (pose) rows.push_back({{*pose, fix}, detector.IsFrozen(fix, pose->translation)});
  }
  return rows;
}

/// Rows that are not frozen, evenly along the way.
std::vector<PlacedFix> WitnessesOf(const std::vector<Row>& rows) {
  std::vector<PlacedFix> witnesses;
  for (const auto& [placed, is_frozen] : rows) {
    if (is_frozen) continue;
    const bool is_first = witnesses.empty();
    if (is_first ||
        (placed.map_from_camera.translation - witnesses.back().map_from_camera.translation)
                .norm() >= kWitnessStepM) {
      witnesses.push_back(placed);
    }
  }
  return witnesses;
}

double ExtentM(const std::vector<Row>& rows) {
  double extent_m = 0;
  for (const Row& row : rows) {
    extent_m = std::max(extent_m, (row.placed.map_from_camera.translation -
                                   rows.front().placed.map_from_camera.translation)
                                      .norm());
  }
  return extent_m;
}

/// Horizontal distance of the fix from where the georeference puts the camera.
double ErrorM(const PlacedFix& placed, const LocalEnu& enu, const Georeference& georeference) {
  const Eigen::Vector3d p_in_enu = georeference.enu_from_map * placed.map_from_camera.translation;
  return (enu.FromGps(placed.fix) - p_in_enu).head<2>().norm();
}

// --- What the rows as a whole may be ---

/// Another way to read a row, and what the file must look like for that.
struct Reading {
  const char* cause_and_remedy;
  GpsFix (*read)(const GpsFix&);
};

constexpr double kDegPerRad = 180 / M_PI;
constexpr std::array<Reading, 5> kReadings = {{
    {"latitude and longitude are radians; write degrees",
     [](const GpsFix& fix) {
       return GpsFix{fix.latitude_deg * kDegPerRad, fix.longitude_deg * kDegPerRad, fix.altitude_m};
     }},
    {"latitude and longitude are swapped; write time, latitude, longitude, altitude",
     [](const GpsFix& fix) {
       return GpsFix{fix.longitude_deg, fix.latitude_deg, fix.altitude_m};
     }},
    {"latitude and longitude are swapped, and radians; write time, latitude, longitude, altitude, "
     "in degrees",
     [](const GpsFix& fix) {
       return GpsFix{fix.longitude_deg * kDegPerRad, fix.latitude_deg * kDegPerRad, fix.altitude_m};
     }},
    {"longitudes have the wrong sign; write west as negative",
     [](const GpsFix& fix) {
       return GpsFix{fix.latitude_deg, -fix.longitude_deg, fix.altitude_m};
     }},
    {"latitudes have the wrong sign; write south as negative",
     [](const GpsFix& fix) {
       return GpsFix{-fix.latitude_deg, fix.longitude_deg, fix.altitude_m};
     }},
}};

bool AgreeIfRead(const std::vector<PlacedFix>& fixes, const Reading& reading,
                 const GpsOptions& options) {
  std::vector<PlacedFix> read;
  for (const auto& [map_from_camera, fix] : fixes) {
    read.push_back({map_from_camera, reading.read(fix)});
    if (!IsValid(read.back().fix)) return false;
  }
  return GeoreferenceOf(read, options).has_value();
}

/// Nothing if the fixes agree with the way as they are, or read in no other way either.
const Reading* FindReading(const std::vector<PlacedFix>& fixes, const GpsOptions& options) {
  if (GeoreferenceOf(fixes, options)) return nullptr;
  const auto reading = std::find_if(kReadings.begin(), kReadings.end(), [&](const Reading& other) {
    return AgreeIfRead(fixes, other, options);
  });
  return reading == kReadings.end() ? nullptr : &*reading;
}

/// Without a georeference: empty if the rows are too few, or of too short a way, to contradict it.
std::string ContradictionOf(const std::vector<Row>& rows, const GpsOptions& options) {
  if (ExtentM(rows) < options.min_extent_m) return {};
  const auto frozen =
      std::count_if(rows.begin(), rows.end(), [](const Row& row) { return row.is_frozen; });
  if (2 * frozen > static_cast<std::ptrdiff_t>(rows.size())) {
    return "most of its rows repeat one place while the vehicle drives; see that the receiver "
           "works";
  }
  const std::vector<PlacedFix> witnesses = WitnessesOf(rows);
  if (witnesses.size() < kMinWitnesses || GeoreferenceOf(witnesses, options)) return {};
  if (const Reading* reading = FindReading(witnesses, options)) return reading->cause_and_remedy;
  return "most of its fixes do not lie along the way that the images show: it is of another drive, "
         "or its clock is off; give the file that was recorded with the images";
}

/// By a georeference that need not be of these rows.
std::string ContradictionOf(const std::vector<Row>& rows, const Georeference& georeference,
                            const GpsOptions& options) {
  const std::vector<PlacedFix> witnesses = WitnessesOf(rows);
  if (witnesses.size() < kMinWitnesses) return {};
  const LocalEnu enu(georeference.origin);
  std::vector<double> errors_m;
  for (const PlacedFix& witness : witnesses) errors_m.push_back(ErrorM(witness, enu, georeference));
  const double median_m = Summarize(errors_m).median;
  if (median_m <= kMaxSigmas * options.sigma_m) return {};
  if (const Reading* reading = FindReading(witnesses, options)) return reading->cause_and_remedy;
  return fmt::format(
      "its fixes lie {:.0f} m, in the median, from where the map has the vehicle; "
      "see that they are degrees, of this drive, and on the camera's clock",
      median_m);
}

}  // namespace

bool FreezeDetector::IsFrozen(const GpsFix& fix, const Eigen::Vector3d& p_in_map) {
  const bool is_repeated =
      fix_.latitude_deg == fix.latitude_deg && fix_.longitude_deg == fix.longitude_deg;
  if (!is_repeated) first_given_at_ = p_in_map;
  fix_ = fix;
  return is_repeated && (p_in_map - first_given_at_).norm() > kStandsWithinM;
}

GpsUse JudgeFixes(const GpsLog& log, const Trajectory& map_from_camera,
                  const std::optional<Georeference>& georeference, const GpsOptions& options) {
  if (map_from_camera.empty()) return {};
  GpsUse use = log.UseOf(*map_from_camera.front().timestamp, *map_from_camera.back().timestamp);
  if (use.clock == GpsClock::kOfAnotherDay) return use;
  const std::vector<Row> rows = RowsAlong(log, map_from_camera);
  std::optional<LocalEnu> enu;
  if (georeference) enu.emplace(georeference->origin);
  for (const auto& [placed, is_frozen] : rows) {
    if (is_frozen) {
      ++use.frozen;
    } else if (georeference) {
      const bool agrees = ErrorM(placed, *enu, *georeference) <= kMaxSigmas * options.sigma_m;
      ++(agrees ? use.used : use.outliers);
    }
  }
  if (use.contradiction.empty() && !rows.empty()) {
    use.contradiction = georeference ? ContradictionOf(rows, *georeference, options)
                                     : ContradictionOf(rows, options);
  }
  return use;
}

}  // namespace carmap
