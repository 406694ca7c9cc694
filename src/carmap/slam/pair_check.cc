#include "carmap/slam/pair_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

namespace carmap {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
/// What real rigs stay well below, and the search for depth along rows bears.
constexpr double kMaxRowsPx = 1.2, kMaxBentRowsPx = 0.7, kMaxDistortion = 0.15;
/// Baselines by which the right camera seems to stand before the left one.
constexpr double kMaxBefore = 0.3, kMinBeforePx = 1.0, kSignificant = 5;
constexpr double kNearlyAll = 0.95, kMost = 0.5;
/// Of corners that no two cameras side by side can see so: more than mismatches, and the cameras
/// look apart.
constexpr double kMaxBackwardShare = 0.06;
/// Telling pairs in a row that show a fault which the rest of the drive does not.
constexpr size_t kFaultyInARow = 2;

bool IsTelling(const PairGeometry& geometry) { return geometry.agreeing >= kMinAgreeing; }

double MedianOf(const std::vector<CheckedPair>& pairs,
                const std::function<double(const CheckedPair&)>& value) {
  std::vector<double> values;
  for (const CheckedPair& pair : pairs) {
    if (IsTelling(pair.geometry)) values.push_back(value(pair));
  }
  if (values.empty()) return 0;
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

/// Frames that show one fault, and whether others do not.
struct FaultyPairs {
  std::vector<CheckedPair> pairs;
  size_t most_in_a_row = 0;

  uint32_t first() const { return pairs.front().index; }
  uint32_t last() const { return pairs.back().index; }
};

std::map<DriveFault, FaultyPairs> FaultsOf(const std::vector<CheckedPair>& telling) {
  std::map<DriveFault, FaultyPairs> faults;
  std::optional<DriveFault> previous;
  size_t in_a_row = 0;
  for (const CheckedPair& pair : telling) {
    const auto fault = FaultOf(pair.geometry);
    in_a_row = fault && fault == previous ? in_a_row + 1 : 1;
    previous = fault;
    if (!fault) continue;
    FaultyPairs& faulty = faults[*fault];
    faulty.pairs.push_back(pair);
    faulty.most_in_a_row = std::max(faulty.most_in_a_row, in_a_row);
  }
  return faults;
}

std::string SharePercent(const FaultyPairs& faulty, double PairGeometry::*share) {
  return fmt::format("{:.0f} %", 100 * MedianOf(faulty.pairs, [&](const CheckedPair& pair) {
                                   return pair.geometry.*share;
                                 }));
}

Suspicion Describe(DriveFault fault, const FaultyPairs& faulty, const StereoRig& rig) {
  Suspicion suspicion{fault, faulty.first(), faulty.last(), "", ""};
  const PairHealth health = Summarize(rig.camera, faulty.pairs);
  switch (fault) {
    case DriveFault::kOneCamera:
      suspicion.finding = "left and right images are the same";
      suspicion.remedy = "put the right camera's images into image_1";
      break;
    case DriveFault::kSidesSwapped:
      suspicion.finding = fmt::format(
          "left and right images are exchanged: {} of what both see lies right of where it may",
          SharePercent(faulty, &PairGeometry::backward_share));
      suspicion.remedy = "exchange image_0 and image_1";
      break;
    case DriveFault::kUpsideDown:
      suspicion.finding = "the images stand on their heads: what is near is above";
      suspicion.remedy = "turn all images by 180 degrees and exchange left and right";
      break;
    case DriveFault::kUnsynchronised:
      suspicion.finding = fmt::format(
          "left and right images are not of the same moment: the right camera seems {:.1f} m {} "
          "the left one",
          std::abs(health.before_baselines) * rig.baseline_m,
          health.before_baselines > 0 ? "before" : "behind");
      suspicion.remedy =
          "pair the images by their times: image_0 or image_1 lacks one just before these frames, "
          "or one camera is triggered later";
      break;
    case DriveFault::kMisaligned:
      suspicion.finding = fmt::format(
          "rows of the right image do not meet those of the left one: {:.1f} px lower in the "
          "middle, {:.1f} px more from border to border{}",
          health.row_offset_px, health.row_slope_px,
          MedianOf(faulty.pairs,
                   [](const CheckedPair& pair) { return pair.geometry.backward_share; }) >
                  kMaxBackwardShare
              ? ", and the cameras look apart"
              : "");
      suspicion.remedy = "calibrate the cameras anew and rectify the images by it";
      break;
    case DriveFault::kDistorted:
      suspicion.finding = fmt::format("the images are bent by the lens: radial distortion {:.2f}",
                                      health.distortion);
      suspicion.remedy = "rectify the images (OpenCV: stereoRectify, remap)";
      break;
    case DriveFault::kImplausibleRig:
    case DriveFault::kImpossibleMotion:
      break;  // not to be seen in a pair
  }
  return suspicion;
}

std::optional<Suspicion> JudgeBaseline(const StereoRig& rig) {
  constexpr double kMinBaselineM = 0.02, kMaxBaselineM = 4;
  if (rig.baseline_m >= kMinBaselineM && rig.baseline_m <= kMaxBaselineM) return std::nullopt;
  return Suspicion{
      DriveFault::kImplausibleRig, 0, 0,
      fmt::format("the baseline is {:.3g} m, which no vehicle's stereo camera has", rig.baseline_m),
      "the fourth number of P1 in calib.txt is -fx times the baseline in metres"};
}

}  // namespace

bool CanBeginLater(DriveFault fault) {
  return fault == DriveFault::kUnsynchronised || fault == DriveFault::kOneCamera;
}

std::optional<DriveFault> FaultOf(const PairGeometry& geometry) {
  if (!IsTelling(geometry)) return std::nullopt;
  if (geometry.same_place_share > kNearlyAll) return DriveFault::kOneCamera;
  if (geometry.backward_share > kMost) {
    return geometry.near_below < 0 ? DriveFault::kUpsideDown : DriveFault::kSidesSwapped;
  }
  if (std::abs(geometry.before) > std::max(kMaxBefore, kSignificant * geometry.before_sigma) &&
      std::min(geometry.place_px, geometry.rows_px) > kMinBeforePx)
    return DriveFault::kUnsynchronised;
  const double least_distortion =
      std::max(kMaxDistortion, kSignificant * geometry.distortion_sigma);
  if (std::abs(geometry.distortion) > least_distortion && geometry.rows_px > kMaxBentRowsPx &&
      geometry.distortion_px > geometry.turn_px)
    return DriveFault::kDistorted;
  if (std::min(geometry.turn_px, geometry.rows_px) > kMaxRowsPx ||
      geometry.backward_share > kMaxBackwardShare)
    return DriveFault::kMisaligned;
  return std::nullopt;
}

PairHealth Summarize(const PinholeCamera& camera, const std::vector<CheckedPair>& pairs) {
  PairHealth health{.pairs = pairs.size()};
  for (const CheckedPair& pair : pairs) health.telling_pairs += IsTelling(pair.geometry);
  if (health.telling_pairs == 0) return health;
  const auto median_of = [&](double (*value)(const PairGeometry&)) {
    return MedianOf(pairs, [&](const CheckedPair& pair) { return value(pair.geometry); });
  };
  health.row_offset_px =
      camera.fy * median_of([](const PairGeometry& pair) { return pair.turn_rad.x(); });
  // A corner at column u is lower by -turn_z (u - cx).
  health.row_slope_px =
      -camera.width * median_of([](const PairGeometry& pair) { return pair.turn_rad.z(); });
  health.before_baselines = median_of([](const PairGeometry& pair) { return pair.before; });
  health.distortion = median_of([](const PairGeometry& pair) { return pair.distortion; });
  health.brightness_ratio =
      MedianOf(pairs, [](const CheckedPair& pair) { return pair.brightness_ratio; });
  return health;
}

std::vector<Suspicion> JudgePairs(const StereoRig& rig, const std::vector<CheckedPair>& pairs) {
  std::vector<Suspicion> suspicions;
  if (auto baseline = JudgeBaseline(rig)) suspicions.push_back(*std::move(baseline));
  std::vector<CheckedPair> telling;
  for (const CheckedPair& pair : pairs) {
    if (IsTelling(pair.geometry)) telling.push_back(pair);
  }
  for (const auto& [fault, faulty] : FaultsOf(telling)) {
    const bool is_in_most = faulty.pairs.size() > kMost * static_cast<double>(telling.size());
    if (is_in_most || (CanBeginLater(fault) && faulty.most_in_a_row >= kFaultyInARow)) {
      suspicions.push_back(Describe(fault, faulty, rig));
    }
  }
  return suspicions;
}

std::optional<RowMisalignment> CorrectableMisalignment(const std::vector<CheckedPair>& pairs) {
  constexpr double kMaxTurnRad = 0.7 * kDegree;
  size_t telling = 0, misaligned = 0;
  for (const CheckedPair& pair : pairs) {
    telling += IsTelling(pair.geometry);
    misaligned += FaultOf(pair.geometry) == DriveFault::kMisaligned &&
                  pair.geometry.backward_share <= kMaxBackwardShare;
  }
  if (static_cast<double>(misaligned) <= kMost * static_cast<double>(telling)) return std::nullopt;
  const auto median_of = [&](int axis) {
    return MedianOf(pairs, [&](const CheckedPair& pair) { return pair.geometry.turn_rad[axis]; });
  };
  const RowMisalignment misalignment{median_of(0), median_of(2)};
  if (std::max(std::abs(misalignment.down), std::abs(misalignment.turn)) > kMaxTurnRad)
    return std::nullopt;
  return misalignment;
}

}  // namespace carmap
