#include "carmap/sim/town/occupancy.h"

#include <absl/functional/function_ref.h>

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

constexpr double kCellM = 8;

/// Until `visit` says no.
bool ForEachCell(const GroundBox& box, absl::FunctionRef<bool(uint64_t key)> visit) {
  const Eigen::Vector2d forward = box.Forward().cwiseAbs();
  const Eigen::Vector2d reach =
      box.half_length_m * forward + box.half_width_m * Eigen::Vector2d(forward.y(), forward.x());
  const Eigen::Vector2d low = ((box.centre_in_enu - reach) / kCellM).array().floor();
  const Eigen::Vector2d high = ((box.centre_in_enu + reach) / kCellM).array().floor();
  for (double x = low.x(); x <= high.x(); ++x) {
    for (double y = low.y(); y <= high.y(); ++y) {
      const uint64_t key = (static_cast<uint64_t>(static_cast<int64_t>(x)) << 32) ^
                           (static_cast<uint64_t>(static_cast<int64_t>(y)) & 0xffffffffu);
      if (!visit(key)) return false;
    }
  }
  return true;
}

/// True when no axis of `a` separates the two.
bool OverlapAlongAxesOf(const GroundBox& a, const GroundBox& b) {
  const Eigen::Vector2d forward = a.Forward(), left(-forward.y(), forward.x());
  const Eigen::Vector2d v = b.centre_in_enu - a.centre_in_enu;
  const double cosine = std::abs(forward.dot(b.Forward()));
  const double sine = std::abs(left.dot(b.Forward()));
  return std::abs(v.dot(forward)) <
             a.half_length_m + b.half_length_m * cosine + b.half_width_m * sine &&
         std::abs(v.dot(left)) < a.half_width_m + b.half_length_m * sine + b.half_width_m * cosine;
}

}  // namespace

Eigen::Vector2d GroundBox::Forward() const {
  return {std::cos(heading_rad), std::sin(heading_rad)};
}

Eigen::Vector2d GroundBox::At(double forward, double left) const {
  const Eigen::Vector2d axis = Forward();
  return centre_in_enu + forward * half_length_m * axis +
         left * half_width_m * Eigen::Vector2d(-axis.y(), axis.x());
}

GroundBox GroundBox::Grown(double ahead_and_behind_m, double aside_m) const {
  return {centre_in_enu, heading_rad, half_length_m + ahead_and_behind_m, half_width_m + aside_m};
}

bool Overlap(const GroundBox& a, const GroundBox& b) {
  const double reach_m = a.half_length_m + a.half_width_m + b.half_length_m + b.half_width_m;
  if ((b.centre_in_enu - a.centre_in_enu).squaredNorm() > reach_m * reach_m) return false;
  return OverlapAlongAxesOf(a, b) && OverlapAlongAxesOf(b, a);
}

void Occupancy::Add(const GroundBox& box) {
  const auto idx = static_cast<uint32_t>(boxes_.size());
  boxes_.push_back(box);
  ForEachCell(box, [&](uint64_t key) {
    cells_[key].push_back(idx);
    return true;
  });
}

bool Occupancy::IsFree(const GroundBox& box) const {
  return ForEachCell(box, [&](uint64_t key) {
    const auto cell = cells_.find(key);
    return cell == cells_.end() ||
           std::none_of(cell->second.begin(), cell->second.end(),
                        [&](uint32_t idx) { return Overlap(boxes_[idx], box); });
  });
}

}  // namespace carmap
