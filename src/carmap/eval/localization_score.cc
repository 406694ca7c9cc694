#include "carmap/eval/localization_score.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <span>
#include <utility>

#include "carmap/base/summary.h"
#include "carmap/eval/map_truth.h"

namespace carmap {
namespace {

constexpr size_t kFramesASecond = 10;
constexpr double kWrongM = 2, kWrongBesideGoodM = 1;
constexpr int kResamples = 500;
constexpr uint64_t kSeed = 1;

using Second = std::span<const ReportedFrame>;
using Figures = std::array<double, kLocalizationFigureCount>;

std::vector<Second> SecondsOf(const std::vector<LocalizationReport>& drives, DrivePart part) {
  std::vector<Second> seconds;
  for (const LocalizationReport& drive : drives) {
    const Second frames = drive.frames;
    const size_t begin = part == DrivePart::kFirstSecond ? 0 : kFramesASecond,
                 end = part == DrivePart::kFirstSecond ? kFramesASecond : frames.size();
    for (size_t at = begin; at < std::min(end, frames.size()); at += kFramesASecond) {
      seconds.push_back(frames.subspan(at, std::min(kFramesASecond, frames.size() - at)));
    }
  }
  return seconds;
}

bool IsKnown(const ReportedFrame& frame) {
  return frame.known_by == KnownBy::kMap ||
         (frame.known_by == KnownBy::kDeadReckoning && frame.dead_reckoned_m <= kMaxDeadReckonedM);
}

bool IsWellKnown(const ReportedFrame& frame) {
  return IsKnown(frame) && frame.position_error_m <= kMaxPositionErrorM &&
         frame.rotation_error_deg <= kMaxRotationErrorDeg;
}

double Share(size_t part, size_t whole) {
  return whole == 0 ? ReportedFrame::kNone : static_cast<double>(part) / static_cast<double>(whole);
}

Summary SummaryOf(const std::vector<double>& values) {
  if (!values.empty()) return Summarize(values);
  constexpr double kNone = ReportedFrame::kNone;
  return {kNone, kNone, kNone, kNone, kNone};
}

/// Of the frames that are known in one way.
struct Consistency {
  size_t frames = 0, within = 0;
  std::vector<double> sigmas_m;

  void Take(const ReportedFrame& frame) {
    if (std::isnan(frame.squared_mahalanobis) || std::isnan(frame.sigma_m)) return;
    ++frames;
    within += frame.squared_mahalanobis <= kChiSquare95Of3;
    sigmas_m.push_back(frame.sigma_m);
  }
};

Figures FiguresOf(const std::vector<Second>& seconds) {
  size_t frames = 0, well_known = 0, by_map = 0;
  std::vector<double> errors_m, map_errors_m;
  Consistency of_map, of_dead_reckoning;
  for (const Second& second : seconds) {
    for (const ReportedFrame& frame : second) {
      ++frames;
      well_known += IsWellKnown(frame);
      by_map += frame.known_by == KnownBy::kMap;
      if (frame.known_by == KnownBy::kMap) of_map.Take(frame);
      if (frame.known_by == KnownBy::kDeadReckoning) of_dead_reckoning.Take(frame);
      if (!IsKnown(frame)) continue;
      errors_m.push_back(frame.position_error_m);
      map_errors_m.push_back(frame.map_position_error_m);
    }
  }
  const Summary error_m = SummaryOf(errors_m), map_error_m = SummaryOf(map_errors_m);
  Figures figures{};
  figures[kWellKnown] = Share(well_known, frames);
  figures[kByMap] = Share(by_map, frames);
  figures[kMedianErrorM] = error_m.median;
  figures[kP95ErrorM] = error_m.p95;
  figures[kMedianMapErrorM] = map_error_m.median;
  figures[kP95MapErrorM] = map_error_m.p95;
  figures[kMapCoverage] = Share(of_map.within, of_map.frames);
  figures[kDeadReckoningCoverage] = Share(of_dead_reckoning.within, of_dead_reckoning.frames);
  figures[kMapSigmaM] = SummaryOf(of_map.sigmas_m).median;
  figures[kDeadReckoningSigmaM] = SummaryOf(of_dead_reckoning.sigmas_m).median;
  return figures;
}

/// What the same number of seconds, drawn with replacement, figure.
std::vector<Figures> Resample(const std::vector<Second>& seconds) {
  std::mt19937_64 generator(kSeed);
  std::vector<Figures> resamples;
  for (int i = 0; i < kResamples && !seconds.empty(); ++i) {
    std::vector<Second> drawn;
    for (size_t n = 0; n < seconds.size(); ++n) {
      drawn.push_back(seconds[generator() % seconds.size()]);
    }
    resamples.push_back(FiguresOf(drawn));
  }
  return resamples;
}

/// From the 2.5th to the 97.5th percentile of the resamples in which the figure could be taken.
Estimate WithInterval(double value, const std::vector<Figures>& resamples, size_t figure) {
  std::vector<double> values;
  for (const Figures& resample : resamples) {
    if (!std::isnan(resample[figure])) values.push_back(resample[figure]);
  }
  if (std::isnan(value) || values.empty()) return {value, value, value};
  std::sort(values.begin(), values.end());
  const auto at = [&](double part) {
    return values[static_cast<size_t>(part * static_cast<double>(values.size() - 1))];
  };
  return {value, at(0.025), at(0.975)};
}

size_t CountWrongPoses(const std::vector<ReportedFrame>& frames, size_t begin, size_t end) {
  const auto is_good = [&](size_t i) {
    return i < frames.size() && frames[i].known_by == KnownBy::kMap && IsWellKnown(frames[i]);
  };
  size_t count = 0;
  for (size_t i = begin; i < std::min(end, frames.size()); ++i) {
    if (frames[i].known_by != KnownBy::kMap) continue;
    const double error_m = frames[i].position_error_m;
    count += error_m > kWrongM ||
             (error_m > kWrongBesideGoodM && i > 0 && is_good(i - 1) && is_good(i + 1));
  }
  return count;
}

std::optional<double> MeanBytes(const std::vector<LocalizationReport>& drives) {
  double sum = 0;
  for (const LocalizationReport& drive : drives) {
    if (!drive.map_bytes) return std::nullopt;
    sum += *drive.map_bytes;
  }
  return sum / static_cast<double>(drives.size());
}

}  // namespace

LocalizationScore ScoreLocalization(const std::vector<LocalizationReport>& drives, DrivePart part) {
  const bool is_first = part == DrivePart::kFirstSecond;
  const std::vector<Second> seconds = SecondsOf(drives, part);
  LocalizationScore score;
  score.drives = drives.size();
  std::vector<double> times_ms;
  for (const Second& second : seconds) {
    score.frames += second.size();
    for (const ReportedFrame& frame : second) {
      if (!std::isnan(frame.ms)) times_ms.push_back(frame.ms);
    }
  }
  const Figures figures = FiguresOf(seconds);
  const std::vector<Figures> resamples = Resample(seconds);
  for (size_t i = 0; i < kLocalizationFigureCount; ++i) {
    score.figures[i] = WithInterval(figures[i], resamples, i);
  }
  for (const LocalizationReport& drive : drives) {
    score.wrong_poses += CountWrongPoses(drive.frames, is_first ? 0 : kFramesASecond,
                                         is_first ? kFramesASecond : drive.frames.size());
  }
  const Summary time_ms = SummaryOf(times_ms);
  score.median_ms = time_ms.median;
  score.p99_ms = time_ms.p99;
  score.map_bytes = MeanBytes(drives);
  return score;
}

std::vector<ScoredCell> ScoreCells(const std::vector<LocalizationReport>& reports) {
  std::map<LocalizationCell, std::vector<LocalizationReport>> drives_of;
  for (const LocalizationReport& report : reports) drives_of[report.cell].push_back(report);
  std::vector<ScoredCell> cells;
  for (const auto& [cell, drives] : drives_of) {
    cells.push_back({cell, ScoreLocalization(drives, DrivePart::kAfterIt),
                     ScoreLocalization(drives, DrivePart::kFirstSecond)});
  }
  return cells;
}

}  // namespace carmap
