// How well drives are localized, cell by cell of conditions, pooled over the seeds of a scene.
//
// The first second of each drive, in which a vehicle does not know its motion yet, is scored apart.
// Pure functions, thread-safe, deterministic.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/eval/localization_report.h"

namespace carmap {

/// A frame counts as known by the map, or by dead reckoning no farther than this ...
inline constexpr double kMaxDeadReckonedM = 20;
/// ... and as well known so near the truth.
inline constexpr double kMaxPositionErrorM = 0.5, kMaxRotationErrorDeg = 1;

/// What is measured of a set of frames. Shares are of all frames.
enum LocalizationFigure : size_t {
  kWellKnown,     ///< share of the frames that are known, and well
  kByMap,         ///< share of the frames that are known by the map
  kMedianErrorM,  ///< of the known frames, against the truth
  kP95ErrorM,
  kMedianMapErrorM,  ///< of the known frames, against the map's own trajectory
  kP95MapErrorM,
  kMapCoverage,            ///< share of those known by the map that are within their 95 % bound
  kDeadReckoningCoverage,  ///< the same of those known by dead reckoning
  kMapSigmaM,              ///< median standard deviation stated, of those known by the map
  kDeadReckoningSigmaM,    ///< the same of those known by dead reckoning
  kLocalizationFigureCount
};

/// A value and the interval in which it lies with 95 %; NaN where nothing could be measured.
struct Estimate {
  double value = 0, low = 0, high = 0;
};

struct LocalizationScore {
  size_t drives = 0, frames = 0;
  std::array<Estimate, kLocalizationFigureCount> figures;
  /// Frames known by the map that are more than 2 m off, or more than 1 m between two that are well
  /// known by it.
  size_t wrong_poses = 0;
  double median_ms = 0, p99_ms = 0;
  std::optional<double> map_bytes;  ///< mean over the drives

  const Estimate& operator[](LocalizationFigure figure) const { return figures[figure]; }
};

struct ScoredCell {
  LocalizationCell cell;
  LocalizationScore score, first_second;
};

/// What to score of each drive.
enum class DrivePart { kFirstSecond, kAfterIt };

/// Intervals by the bootstrap over seconds of the drives: frames of one second resemble each other
/// too much to count singly.
LocalizationScore ScoreLocalization(const std::vector<LocalizationReport>& drives, DrivePart part);

/// Cells in ascending order, each of all drives of it.
std::vector<ScoredCell> ScoreCells(const std::vector<LocalizationReport>& reports);

}  // namespace carmap
