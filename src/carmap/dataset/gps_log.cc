#include "carmap/dataset/gps_log.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

constexpr uint64_t kMaxTextBytes = uint64_t{1} << 27;
constexpr int64_t kMaxFixDistanceNs = 150'000'000;

// Times from here on are dates, counted from 1970 or 1980.
constexpr int64_t kFirstDateNs = 100'000'000'000'000'000;
constexpr int64_t kQuarterHourNs = 900'000'000'000, kMaxTimeZonesNs = 104 * kQuarterHourNs;
// A recorder may have been started anew after so long a pause, with another clock.
constexpr int64_t kPauseNs = 60'000'000'000;
constexpr size_t kMaxStarts = 8;
// Parts of the frames that take a fix by the better reading of the clock, with which the simpler
// one is believed: single rows have any time.
constexpr double kMinShareAsWritten = 0.05, kMinShareOfTimeZone = 0.9;

struct Row {
  Timestamp time;
  GpsFix fix;
};

absl::StatusOr<std::vector<Row>> ReadRows(const std::filesystem::path& path) {
  constexpr size_t kMinColumns = 4;
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxTextBytes));
  std::vector<Row> rows;
  TextLines lines(text);
  rows.reserve(TextLines::MaxCount(text, kMinColumns));
  while (const TextLine* line = lines.Next()) {
    const std::optional<Timestamp> time = ParseSeconds(line->tokens.front());
    const std::optional<std::vector<double>> numbers = ParseNumbers(line->tokens);
    if (!time || !numbers || numbers->size() < kMinColumns) {
      return absl::InvalidArgumentError(fmt::format(
          "{}: line {} is not 'time latitude longitude altitude', the time within 3e9 s of 0; "
          "correct it",
          path.string(), line->number));
    }
    rows.push_back({*time, {(*numbers)[1], (*numbers)[2], (*numbers)[3]}});
  }
  // Receivers log late rows out of turn.
  std::stable_sort(rows.begin(), rows.end(),
                   [](const Row& a, const Row& b) { return a.time < b.time; });
  return rows;
}

/// Receivers without a fix write zeros, nan, or numbers beyond all places.
bool HasFix(const GpsFix& fix) {
  return IsValid(fix) && (fix.latitude_deg != 0 || fix.longitude_deg != 0);
}

bool IsNumberBeyondTheGlobe(const GpsFix& fix) {
  return std::isfinite(fix.latitude_deg + fix.longitude_deg + fix.altitude_m) && !IsValid(fix);
}

/// What most rows have in common that are no places; empty if most are, or tell nothing.
std::string WhyNoPlaces(const std::vector<Row>& rows) {
  const auto beyond = std::count_if(rows.begin(), rows.end(),
                                    [](const Row& row) { return IsNumberBeyondTheGlobe(row.fix); });
  if (2 * beyond <= static_cast<std::ptrdiff_t>(rows.size())) return {};
  const auto are_swapped = std::count_if(rows.begin(), rows.end(), [](const Row& row) {
    return IsNumberBeyondTheGlobe(row.fix) &&
           IsValid({row.fix.longitude_deg, row.fix.latitude_deg, row.fix.altitude_m});
  });
  return 2 * are_swapped > beyond
             ? "latitude and longitude are swapped: most latitudes are beyond 90 degrees; write "
               "time, latitude, longitude, altitude"
             : "most rows are no places on the globe; write degrees, degrees and metres";
}

bool AreOnePlace(const GpsFix& a, const GpsFix& b) {
  return a.latitude_deg == b.latitude_deg && a.longitude_deg == b.longitude_deg;
}

GpsFix Interpolate(const TimedFix& before, const TimedFix& after, Timestamp time) {
  const double fraction = static_cast<double>(time.ns - before.time.ns) /
                          static_cast<double>(after.time.ns - before.time.ns);
  // At the date line a mean of longitudes would lie on the other side of the Earth.
  if (std::abs(after.fix.longitude_deg - before.fix.longitude_deg) > 180) {
    return fraction < 0.5 ? before.fix : after.fix;
  }
  return {std::lerp(before.fix.latitude_deg, after.fix.latitude_deg, fraction),
          std::lerp(before.fix.longitude_deg, after.fix.longitude_deg, fraction),
          std::lerp(before.fix.altitude_m, after.fix.altitude_m, fraction)};
}

/// Frames with a fix nearby, if the offset is added to the times of the fixes.
size_t CountCovered(const std::vector<TimedFix>& fixes, const std::vector<Timestamp>& frame_times,
                    int64_t offset_ns) {
  size_t covered = 0;
  auto fix = fixes.begin();
  for (const Timestamp frame : frame_times) {
    const int64_t time_ns = frame.ns - offset_ns;
    while (fix != fixes.end() && fix->time.ns < time_ns - kMaxFixDistanceNs) ++fix;
    covered += fix != fixes.end() && fix->time.ns <= time_ns + kMaxFixDistanceNs;
  }
  return covered;
}

/// Times at which recording may have begun: that of the first row, and those after a pause.
std::vector<Timestamp> StartsOf(const std::vector<TimedFix>& fixes,
                                const std::vector<Timestamp>& without_fix) {
  std::vector<Timestamp> times = without_fix;
  for (const TimedFix& fix : fixes) times.push_back(fix.time);
  std::sort(times.begin(), times.end());
  std::vector<Timestamp> starts;
  for (size_t i = 0; i < times.size() && starts.size() < kMaxStarts; ++i) {
    if (i == 0 || times[i].ns - times[i - 1].ns > kPauseNs) starts.push_back(times[i]);
  }
  return starts;
}

std::string HoursText(double seconds) { return fmt::format("{:.2f} h", std::abs(seconds) / 3600); }

}  // namespace

absl::StatusOr<GpsLog> GpsLog::Read(const std::filesystem::path& path,
                                    const std::vector<Timestamp>& frame_times) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Row> rows, ReadRows(path));
  GpsLog log;
  log.contradiction_ = WhyNoPlaces(rows);
  for (const Row& row : rows) {
    if (HasFix(row.fix)) {
      log.fixes_.push_back({row.time, row.fix});
    } else {
      log.without_fix_.push_back(row.time);
    }
  }
  if (!frame_times.empty()) log.MatchClock(frame_times);
  return log;
}

/// By which reading of the rows' times most frames have a fix, the simpler reading first.
void GpsLog::MatchClock(const std::vector<Timestamp>& frame_times) {
  int64_t start_offset_ns = 0;
  size_t started = 0;
  for (const Timestamp start : StartsOf(fixes_, without_fix_)) {
    const int64_t offset_ns = frame_times.front().ns - start.ns;
    const size_t covered = CountCovered(fixes_, frame_times, offset_ns);
    if (covered <= started) continue;
    started = covered;
    start_offset_ns = offset_ns;
  }
  const auto as_written = static_cast<double>(CountCovered(fixes_, frame_times, 0));
  const auto best = static_cast<double>(started);
  if (started == 0 || (as_written > 0 && as_written >= kMinShareAsWritten * best)) return;

  const int64_t zone_ns = static_cast<int64_t>(std::llround(static_cast<double>(start_offset_ns) /
                                                            static_cast<double>(kQuarterHourNs))) *
                          kQuarterHourNs;
  const bool is_zone =
      zone_ns != 0 && std::abs(zone_ns) <= kMaxTimeZonesNs &&
      static_cast<double>(CountCovered(fixes_, frame_times, zone_ns)) >= kMinShareOfTimeZone * best;
  const bool are_dates = frame_times.front().ns >= kFirstDateNs &&
                         frame_times.front().ns - start_offset_ns >= kFirstDateNs;
  Shift(is_zone ? zone_ns : start_offset_ns);
  if (is_zone) {
    clock_ = GpsClock::kTimeZone;
    contradiction_ = fmt::format(
        "its clock is {} {} the camera's; taken for a time zone; write both times in one",
        HoursText(clock_offset_s_), zone_ns < 0 ? "ahead of" : "behind");
  } else if (are_dates) {
    clock_ = GpsClock::kOfAnotherDay;
    contradiction_ = fmt::format(
        "its clock is {} {} the camera's: it is of another drive, and no frame takes a fix; give "
        "the file that was recorded with the images",
        HoursText(clock_offset_s_), start_offset_ns < 0 ? "ahead of" : "behind");
  } else {
    clock_ = GpsClock::kStartTogether;
  }
}

void GpsLog::Shift(int64_t offset_ns) {
  for (TimedFix& fix : fixes_) fix.time.ns += offset_ns;
  for (Timestamp& time : without_fix_) time.ns += offset_ns;
  clock_offset_s_ = static_cast<double>(offset_ns) * 1e-9;
}

std::optional<GpsFix> GpsLog::At(Timestamp time) const {
  if (clock_ == GpsClock::kOfAnotherDay) return std::nullopt;
  const auto after =
      std::lower_bound(fixes_.begin(), fixes_.end(), time,
                       [](const TimedFix& fix, Timestamp t) { return fix.time < t; });
  const bool has_after = after != fixes_.end() && after->time.ns - time.ns <= kMaxFixDistanceNs;
  const bool has_before =
      after != fixes_.begin() && time.ns - (after - 1)->time.ns <= kMaxFixDistanceNs;
  if (has_before && has_after) {
    // A receiver that repeats itself between two measurements was there long before.
    const bool is_repeated =
        after - 1 != fixes_.begin() && AreOnePlace((after - 1)->fix, (after - 2)->fix);
    return is_repeated ? after->fix : Interpolate(*(after - 1), *after, time);
  }
  if (has_before) return (after - 1)->fix;
  if (has_after) return after->fix;
  return std::nullopt;
}

bool GpsLog::IsWithin(Timestamp time, Timestamp first, Timestamp last) {
  return first.ns - kMaxFixDistanceNs <= time.ns && time.ns <= last.ns + kMaxFixDistanceNs;
}

GpsUse GpsLog::UseOf(Timestamp first, Timestamp last) const {
  GpsUse use{.clock = clock_, .clock_offset_s = clock_offset_s_, .contradiction = contradiction_};
  if (fixes_.empty()) {  // by which no clock can be matched
    use.rows = use.without_fix = without_fix_.size();
    return use;
  }
  use.without_fix = static_cast<size_t>(
      std::count_if(without_fix_.begin(), without_fix_.end(),
                    [&](Timestamp time) { return IsWithin(time, first, last); }));
  use.rows = use.without_fix + static_cast<size_t>(std::count_if(
                                   fixes_.begin(), fixes_.end(), [&](const TimedFix& fix) {
                                     return IsWithin(fix.time, first, last);
                                   }));
  return use;
}

}  // namespace carmap
