#include "carmap/sim/road/road_network.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "carmap/base/random.h"

namespace carmap {
namespace {

constexpr double kCellM = 8;
constexpr double kSameStretchM = 40;
constexpr double kHalfVehicleM = 0.9;
constexpr double kFar = 1e6;

Eigen::Vector2d Direction(double heading_rad) {
  return {std::cos(heading_rad), std::sin(heading_rad)};
}

Eigen::Vector2d LeftOf(const Eigen::Vector2d& forward) { return {-forward.y(), forward.x()}; }

double StepOf(const Route& path) {
  return path.length_m() / static_cast<double>(path.points().size() - 1);
}

/// From the centre line to the middle of the route's lane, to the right.
double RouteOffset(Scene scene, const RoadSection& section) {
  const double lanes_from_median = scene == Scene::kFreeway ? 2.5 : 0.5;
  return section.median_half_m + lanes_from_median * section.lane_width_m;
}

/// The route moved to the left, without the folds where it turns sharper than that.
std::vector<Eigen::Vector2d> OffsetToLeft(const std::vector<RoutePoint>& stretch, double left_m) {
  constexpr int kReach = 160;
  std::vector<Eigen::Vector2d> points;
  const int count = static_cast<int>(stretch.size());
  for (int i = 0; i < count; ++i) {
    const RoutePoint& at = stretch[static_cast<size_t>(i)];
    const Eigen::Vector2d p = at.position_in_enu + left_m * LeftOf(Direction(at.heading_rad));
    bool folded = false;
    for (int k = std::max(0, i - kReach); k < std::min(count, i + kReach) && !folded; ++k) {
      const double d = (stretch[static_cast<size_t>(k)].position_in_enu - p).squaredNorm();
      folded = d < (left_m - 0.2) * (left_m - 0.2);
    }
    if (folded || (!points.empty() && (points.back() - p).norm() < 0.1)) continue;
    points.push_back(p);
  }
  return points;
}

}  // namespace

bool CentreLine::InJunction(double along_m, double margin_m) const {
  return std::any_of(junctions.begin(), junctions.end(), [&](const Junction& junction) {
    return along_m > junction.begin_m - margin_m && along_m < junction.end_m + margin_m;
  });
}

double CentreLine::ToJunctionAhead(double along_m) const {
  double distance = kFar;
  for (const Junction& junction : junctions) {
    if (along_m <= junction.end_m) distance = std::min(distance, junction.begin_m - along_m);
  }
  return std::max(distance, 0.0);
}

double CentreLine::ToJunctionBehind(double along_m) const {
  double distance = kFar;
  for (const Junction& junction : junctions) {
    if (along_m >= junction.begin_m) distance = std::min(distance, along_m - junction.end_m);
  }
  return std::max(distance, 0.0);
}

RoadHit HitAt(const CentreLine& line, uint32_t line_idx, size_t point, const Eigen::Vector2d& p) {
  const std::vector<Eigen::Vector2d>& points = line.path.points();
  const size_t last = points.size() - 1;
  const bool closed = line.path.closed();
  const double step_m = StepOf(line.path);
  RoadHit hit{.line = line_idx};
  double nearest = std::numeric_limits<double>::infinity();
  const auto try_segment = [&](size_t begin) {
    const Eigen::Vector2d segment = points[begin + 1] - points[begin], v = p - points[begin];
    const double t = v.dot(segment) / segment.squaredNorm();
    const bool before = !closed && begin == 0 && t < 0;
    const bool beyond = !closed && begin + 1 == last && t > 1;
    const double inside = before || beyond ? t : std::clamp(t, 0.0, 1.0);
    const double distance = (v - inside * segment).norm();
    if (distance >= nearest) return;
    nearest = distance;
    hit.along_m = (static_cast<double>(begin) + inside) * step_m;
    hit.left_m = std::copysign(distance, segment.x() * v.y() - segment.y() * v.x());
    hit.heading_rad = std::atan2(segment.y(), segment.x());
  };
  if (point > 0) try_segment(point - 1);
  if (point < last) try_segment(point);
  if (closed && (point == 0 || point == last)) try_segment(point == 0 ? last - 1 : 0);

  const double from_centre_m = std::abs(hit.left_m);
  const double aside = std::max(from_centre_m - line.section.Edge(hit.left_m > 0 ? 1 : -1),
                                line.section.MedianStripHalf() - from_centre_m);
  const double beyond = closed ? -kFar : std::max(-hit.along_m, hit.along_m - line.path.length_m());
  hit.edge_m = aside > 0 && beyond > 0 ? std::hypot(aside, beyond) : std::max(aside, beyond);
  return hit;
}

bool SameStretch(const CentreLine& line, const RoadHit& a, const RoadHit& b) {
  if (a.line != b.line) return false;
  const double apart = std::abs(a.along_m - b.along_m);
  return apart < kSameStretchM ||
         (line.path.closed() && line.path.length_m() - apart < kSameStretchM);
}

uint64_t RoadNetwork::CellKey(int64_t x, int64_t y) {
  return (static_cast<uint64_t>(x) << 32) ^ (static_cast<uint64_t>(y) & 0xffffffffu);
}

std::vector<RoadHit> RoadNetwork::Near(const Eigen::Vector2d& p, double reach_m) const {
  struct Candidate {
    double distance;
    Entry entry;
  };
  std::vector<Candidate> candidates;
  const Eigen::Vector2d low = (p.array() - reach_m) / kCellM, high = (p.array() + reach_m) / kCellM;
  for (auto x = static_cast<int64_t>(std::floor(low.x())); x <= std::floor(high.x()); ++x) {
    for (auto y = static_cast<int64_t>(std::floor(low.y())); y <= std::floor(high.y()); ++y) {
      const auto cell = cells_.find(CellKey(x, y));
      if (cell == cells_.end()) continue;
      for (const Entry& entry : cell->second) {
        const double distance = (lines_[entry.line].path.points()[entry.point] - p).norm();
        if (distance <= reach_m) candidates.push_back({distance, entry});
      }
    }
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return std::tie(a.distance, a.entry.line, a.entry.point) <
           std::tie(b.distance, b.entry.line, b.entry.point);
  });
  std::vector<RoadHit> hits;
  for (const auto& [distance, entry] : candidates) {
    const CentreLine& line = lines_[entry.line];
    const RoadHit rough{.line = entry.line, .along_m = entry.point * StepOf(line.path)};
    const bool known = std::any_of(hits.begin(), hits.end(), [&](const RoadHit& hit) {
      return SameStretch(line, hit, rough);
    });
    if (!known) hits.push_back(HitAt(line, entry.line, entry.point, p));
  }
  return hits;
}

double RoadNetwork::EdgeDistance(const Eigen::Vector2d& p, double reach_m) const {
  double nearest = reach_m;
  for (const RoadHit& hit : Near(p, reach_m)) nearest = std::min(nearest, hit.edge_m);
  return nearest;
}

std::vector<Eigen::Vector2d> RoadNetwork::Points() const {
  std::vector<Eigen::Vector2d> points;
  for (const CentreLine& line : lines_) {
    for (size_t i = 0; i < line.path.points().size(); i += 8) {
      points.push_back(line.path.points()[i]);
    }
  }
  return points;
}

RoadSection RoadNetwork::DrawSection(uint64_t line_seed) const {
  const double lane_width_m = ProfileOf(scene_).lane_width_m;
  HashSequence draw(line_seed, 0x736563);
  switch (scene_) {
    case Scene::kSuburb: {
      const double strip = draw.Unit();  // on both sides, or on one
      return {.lane_width_m = lane_width_m,
              .shoulder_m = 0.3,
              .left_parking_m = strip < 0.7 ? 2.1 : 0,
              .right_parking_m = strip > 0.3 ? 2.1 : 0,
              .sidewalk_m = draw.Between(1.7, 2.3)};
    }
    case Scene::kDowntown:
      return {.lane_width_m = lane_width_m,
              .left_parking_m = 2.2,
              .right_parking_m = 2.2,
              .sidewalk_m = draw.Between(2.6, 3.6)};
    case Scene::kFreeway:
      return {.lane_width_m = lane_width_m,
              .lanes = 4,
              .median_half_m = lane_width_m / 2,
              .shoulder_m = 2.75};
  }
  return {};
}

void RoadNetwork::AddLine(CentreLine::Kind kind, const Route& path, const RoadSection& section) {
  const auto idx = static_cast<uint32_t>(lines_.size());
  lines_.push_back({kind, path, section, {}, HashKeys(seed_, 0x6c696e + idx)});
  const std::vector<Eigen::Vector2d>& points = path.points();
  for (uint32_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d cell = (points[i] / kCellM).array().floor();
    cells_[CellKey(static_cast<int64_t>(cell.x()), static_cast<int64_t>(cell.y()))].push_back(
        {idx, i});
  }
}

/// `begin` and `end` number points of the route, `end` not included.
struct RoadNetwork::Run {
  size_t begin, end;
  bool on_earlier_road;
};

namespace {

/// What the route has driven so far, to find when it comes by again.
class Trace {
 public:
  Trace(double offset_m, double half_m, bool closed, size_t count)
      : offset_m_(offset_m), half_m_(half_m), closed_(closed), count_(count) {}

  void Add(const RoutePoint& at, size_t idx) {
    const Eigen::Vector2d forward = Direction(at.heading_rad);
    const Eigen::Vector2d centre = at.position_in_enu + offset_m_ * LeftOf(forward);
    cells_[Key(centre)].push_back({centre, forward, idx});
  }

  /// True where the vehicle is on the lanes of an earlier road and goes along it. It has to leave
  /// them by more than it has to come in, so that the answer does not flicker.
  bool OnEarlierRoad(const RoutePoint& at, size_t idx, bool was_on) const {
    const Eigen::Vector2d forward = Direction(at.heading_rad);
    const double max_left = half_m_ - (was_on ? 0.5 : 1.0) * kHalfVehicleM;
    const double min_cosine = was_on ? 0.87 : 0.94;
    const Eigen::Vector2d& p = at.position_in_enu;
    const int reach = static_cast<int>(std::ceil(half_m_ / kTraceCellM));
    for (int x = -reach; x <= reach; ++x) {
      for (int y = -reach; y <= reach; ++y) {
        const auto cell = cells_.find(Key(p + kTraceCellM * Eigen::Vector2d(x, y)));
        if (cell == cells_.end()) continue;
        for (const Sample& sample : cell->second) {
          const Eigen::Vector2d v = p - sample.centre;
          if (IsRecent(sample.idx, idx) || std::abs(v.dot(sample.forward)) > 0.6) continue;
          if (std::abs(sample.forward.dot(forward)) < min_cosine) continue;
          if (std::abs(LeftOf(sample.forward).dot(v)) <= max_left) return true;
        }
      }
    }
    return false;
  }

 private:
  static constexpr double kTraceCellM = 4;
  static constexpr size_t kRecent = 120;  // 60 m

  struct Sample {
    Eigen::Vector2d centre, forward;
    size_t idx;
  };

  bool IsRecent(size_t earlier, size_t now) const {
    return now - earlier < kRecent || (closed_ && count_ - (now - earlier) < kRecent);
  }
  static uint64_t Key(const Eigen::Vector2d& p) {
    return (static_cast<uint64_t>(static_cast<int64_t>(std::floor(p.x() / kTraceCellM))) << 32) ^
           (static_cast<uint64_t>(static_cast<int64_t>(std::floor(p.y() / kTraceCellM))) &
            0xffffffffu);
  }

  double offset_m_, half_m_;
  bool closed_;
  size_t count_;
  std::unordered_map<uint64_t, std::vector<Sample>> cells_;
};

/// The route's points, and beyond the ends of an open one, so that no vehicle sees the road end.
std::vector<RoutePoint> SampleBeyondEnds(const Route& route) {
  constexpr double kBeyondM = 160, kStepM = 0.5;
  const double beyond_m = route.closed() ? 0 : kBeyondM;
  const auto steps = static_cast<size_t>(std::lround((route.length_m() + 2 * beyond_m) / kStepM));
  const double step_m = (route.length_m() + 2 * beyond_m) / static_cast<double>(steps);
  std::vector<RoutePoint> samples;
  for (size_t i = 0; i <= steps; ++i) {
    samples.push_back(route.At(-beyond_m + static_cast<double>(i) * step_m));
  }
  return samples;
}

}  // namespace

std::vector<RoadNetwork::Run> RoadNetwork::SplitIntoRuns(const std::vector<RoutePoint>& route,
                                                         bool closed) const {
  const RoadSection section = DrawSection(seed_);
  Trace trace(RouteOffset(scene_, section), section.LanesHalf(), closed, route.size());
  std::vector<Run> runs;
  for (size_t i = 0; i < route.size(); ++i) {
    const bool was_on = !runs.empty() && runs.back().on_earlier_road;
    const bool on = trace.OnEarlierRoad(route[i], i, was_on);
    if (!on) trace.Add(route[i], i);
    if (runs.empty() || on != was_on) runs.push_back({i, i, on});
    runs.back().end = i + 1;
  }
  return runs;
}

/// New roads where the route is not on an earlier one; short ones between two roads are left to
/// AddConnectors.
void RoadNetwork::AddRoute(const std::vector<RoutePoint>& route, bool closed) {
  constexpr size_t kShort = 60, kIntoOldRoad = 4;  // 30 m, 2 m
  const std::vector<Run> runs = SplitIntoRuns(route, closed);
  for (size_t i = 0; i < runs.size(); ++i) {
    const Run& run = runs[i];
    const bool between = i > 0 && i + 1 < runs.size();
    if (run.on_earlier_road || (between && run.end - run.begin < kShort)) continue;
    const size_t begin = run.begin - std::min(run.begin, i > 0 ? kIntoOldRoad : 0);
    const size_t end = std::min(route.size(), run.end + (i + 1 < runs.size() ? kIntoOldRoad : 0));
    const RoadSection section = DrawSection(HashKeys(seed_, 0x6c696e + lines_.size()));
    const std::vector<Eigen::Vector2d> points =
        OffsetToLeft({route.begin() + static_cast<std::ptrdiff_t>(begin),
                      route.begin() + static_cast<std::ptrdiff_t>(end)},
                     RouteOffset(scene_, section));
    if (points.size() < 4) continue;
    AddLine(CentreLine::Kind::kMain, Route(points, closed && runs.size() == 1), section);
  }
}

/// Wherever a vehicle on the route would still leave the carriageways: in turns between two roads
/// that were there already, and where folds were cut off.
void RoadNetwork::AddConnectors(const std::vector<RoutePoint>& route) {
  constexpr double kMinInsideM = kHalfVehicleM + 0.3;
  constexpr size_t kBeyond = 8;  // 4 m
  const RoadSection one_lane = {.lane_width_m = 2, .sidewalk_m = DrawSection(seed_).sidewalk_m};
  const double reach_m = DrawSection(seed_).Edge(1) + 3;
  std::vector<std::pair<size_t, size_t>> stretches;
  for (size_t i = 0; i < route.size(); ++i) {
    if (EdgeDistance(route[i].position_in_enu, reach_m) <= -kMinInsideM) continue;
    const size_t begin = i - std::min(i, kBeyond), end = std::min(route.size(), i + kBeyond + 1);
    if (stretches.empty() || stretches.back().second < begin) stretches.push_back({begin, end});
    stretches.back().second = end;
  }
  for (const auto& [begin, end] : stretches) {
    std::vector<Eigen::Vector2d> points;
    for (size_t i = begin; i < end; ++i) points.push_back(route[i].position_in_enu);
    AddLine(CentreLine::Kind::kConnector, Route(points, /*closed=*/false), one_lane);
  }
}

/// As far as it keeps away from other roads, or up to one that it meets at a large angle.
void RoadNetwork::AddSideStreet(uint32_t from_line, double along_m, double heading_rad,
                                double length_m) {
  constexpr double kBeginM = 1.5, kStepM = 3, kFreeM = 30, kClearM = 15, kMinLengthM = 38;
  const Eigen::Vector2d start = lines_[from_line].path.At(along_m).position_in_enu;
  const RoadHit origin{.line = from_line, .along_m = along_m};
  const double bend = (UnitHash(seed_, HashKeys(from_line, static_cast<uint64_t>(along_m))) - 0.5) *
                      2e-3;  // 1/m, half the curvature
  const auto point_at = [&](double s) -> Eigen::Vector2d {
    const Eigen::Vector2d forward = Direction(heading_rad);
    return start + s * forward + bend * s * s * LeftOf(forward);
  };
  double end_m = 0;
  for (double s = kStepM; s <= length_m && end_m == 0; s += kStepM) {
    for (const RoadHit& hit : Near(point_at(s), kClearM + 8)) {
      const bool own = SameStretch(lines_[from_line], hit, origin);
      if (hit.edge_m > kClearM || (own && s < kFreeM)) continue;
      const double sine = std::abs(std::sin(hit.heading_rad - heading_rad));
      const bool meets = !own && s > kMinLengthM && sine > 0.7;
      // To its centre line, or well before its gardens.
      end_m = meets ? s + std::abs(hit.left_m) / sine : s - 8;
      break;
    }
  }
  if (end_m == 0) end_m = length_m;
  if (end_m < kMinLengthM) return;
  std::vector<Eigen::Vector2d> points;
  // It begins on the near side of the road, whose far edge is to stay straight.
  for (double s = kBeginM; s <= end_m; s += 1) points.push_back(point_at(s));
  AddLine(CentreLine::Kind::kSide, Route(points, /*closed=*/false),
          DrawSection(HashKeys(seed_, 0x6c696e + lines_.size())));
}

/// At intervals, to one side or both; and straight on where the road turns.
void RoadNetwork::AddSideStreets() {
  const auto main_lines = static_cast<uint32_t>(lines_.size());
  for (uint32_t idx = 0; idx < main_lines; ++idx) {
    if (lines_[idx].kind != CentreLine::Kind::kMain) continue;
    const Route path = lines_[idx].path;
    HashSequence draw(lines_[idx].seed, 0x736964);
    const double min_gap_m = scene_ == Scene::kDowntown ? 65 : 75;
    const auto heading_at = [&](double s) { return path.At(s).heading_rad; };
    const auto turn_at = [&](double s) {
      return std::abs(std::remainder(heading_at(s + 12) - heading_at(s - 12), 2 * M_PI));
    };
    const double length_m = path.length_m();
    double next_m = draw.Between(20, min_gap_m);
    for (double s = 15; s < length_m - 15; s += 1) {
      if (turn_at(s) > 1.1 && turn_at(s) >= turn_at(s + 1) && turn_at(s) > turn_at(s - 1)) {
        AddSideStreet(idx, s - 13, heading_at(s - 13), draw.Between(60, 110));
        if (draw.Chance(0.6)) {
          AddSideStreet(idx, s + 13, heading_at(s + 13) + M_PI, draw.Between(60, 110));
        }
        next_m = std::max(next_m, s + 50);
      }
      if (s < next_m || turn_at(s) > 0.4 || turn_at(s + 20) > 0.6) continue;
      next_m = s + draw.Between(min_gap_m, 2 * min_gap_m);
      if (Near(path.At(s).position_in_enu, 35).size() > 1) continue;
      const double side = draw.Chance(0.5) ? 1 : -1, skew = draw.Between(-0.2, 0.2);
      AddSideStreet(idx, s, heading_at(s) + side * M_PI / 2 + skew, draw.Between(60, 120));
      if (draw.Chance(0.4)) {
        AddSideStreet(idx, s, heading_at(s) - side * M_PI / 2 + skew, draw.Between(60, 120));
      }
    }
  }
}

void RoadNetwork::FindJunctions() {
  constexpr double kStepM = 1;
  for (uint32_t idx = 0; idx < lines_.size(); ++idx) {
    CentreLine& line = lines_[idx];
    const double left = line.section.Edge(1), right = line.section.Edge(-1);
    for (double s = 0; s <= line.path.length_m(); s += kStepM) {
      const RoadHit here{.line = idx, .along_m = s};
      bool reached = false;
      for (const double across : {-right, -right / 2, 0.0, left / 2, left}) {
        const Eigen::Vector2d p = line.path.At(s, across).position_in_enu;
        const std::vector<RoadHit> hits = Near(p, widest_m_ + 1);
        reached |= std::any_of(hits.begin(), hits.end(), [&](const RoadHit& hit) {
          return hit.edge_m < 0 && !SameStretch(line, hit, here);
        });
      }
      if (!reached) continue;
      auto& junctions = line.junctions;
      if (junctions.empty() || junctions.back().end_m < s - 8) junctions.push_back({s, s});
      junctions.back().end_m = s;
    }
  }
}

RoadNetwork::RoadNetwork(Scene scene, const Route& route, uint64_t seed)
    : scene_(scene), seed_(seed) {
  const std::vector<RoutePoint> samples = SampleBeyondEnds(route);
  AddRoute(samples, route.closed());
  AddConnectors(samples);
  if (scene != Scene::kFreeway) AddSideStreets();
  for (const CentreLine& line : lines_) {
    widest_m_ = std::max({widest_m_, line.section.Edge(1), line.section.Edge(-1)});
  }
  FindJunctions();
}

}  // namespace carmap
