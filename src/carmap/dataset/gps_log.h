// A drive's gps.txt, on the camera's clock: `time latitude longitude altitude …`, # comments.
//
// Times are seconds of the camera's clock. Where they do not meet the drive's they are taken for
// those of another time zone, if whole quarters of an hour bring them there, or else to be counted
// from the first row: receivers give absolute time where a camera's starts at 0. Two dates that
// have nothing in common are of different drives, and no frame takes a fix.
//
// Immutable, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/time.h"
#include "carmap/dataset/gps_use.h"
#include "carmap/geometry/geodesy.h"

namespace carmap {

struct TimedFix {
  Timestamp time;
  GpsFix fix;
};

class GpsLog {
 public:
  /// `frame_times` of all frames of the drive, ascending. Errors: as ReadFile; InvalidArgument for
  /// a row that is not numbers. A row that is no place on the Earth is one without a fix.
  static absl::StatusOr<GpsLog> Read(const std::filesystem::path& path,
                                     const std::vector<Timestamp>& frame_times);

  /// Between its two neighbours where both are within 0.15 s, else the near one, else none; the
  /// later one if the earlier one repeats the row before.
  std::optional<GpsFix> At(Timestamp time) const;

  /// The rows that have a fix, ascending in time.
  const std::vector<TimedFix>& fixes() const { return fixes_; }

  /// How reading went, and the rows that belong to frames from `first` to `last`, with and without
  /// a fix.
  GpsUse UseOf(Timestamp first, Timestamp last) const;
  /// Whether a row of this time belongs to these frames.
  static bool IsWithin(Timestamp time, Timestamp first, Timestamp last);

 private:
  void MatchClock(const std::vector<Timestamp>& frame_times);
  void Shift(int64_t offset_ns);

  std::vector<TimedFix> fixes_;
  std::vector<Timestamp> without_fix_;  ///< ascending
  GpsClock clock_ = GpsClock::kCamera;
  double clock_offset_s_ = 0;
  std::string contradiction_;
};

}  // namespace carmap
