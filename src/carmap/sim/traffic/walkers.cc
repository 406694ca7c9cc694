#include "carmap/sim/traffic/walkers.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace carmap {
namespace {

constexpr KindWeight kPedestrian[] = {{"pedestrian", 1}};
// Of a person: half across, half along; and from one to another side by side.
constexpr double kHalfPersonM = 0.35, kStrideM = 0.45, kAsideM = 0.75;

class SidewalkFinder {
 public:
  SidewalkFinder(const Route& route, const RoadProfile& profile, const GroundMap& ground, int side)
      : route_(route), ground_(ground), side_(side) {
    const int outer_lane = side > 0 ? std::max(profile.last_lane, profile.last_oncoming)
                                    : std::min(profile.first_lane, profile.first_oncoming);
    lanes_m_ = (side * outer_lane + 0.5) * profile.lane_width_m;
  }

  void Find(std::vector<Sidewalk>& sidewalks) const {
    constexpr double kStepM = 4, kKinkM = 0.6;
    Run run;
    for (double along_m = 0; along_m <= route_.length_m(); along_m += kStepM) {
      const std::optional<double> edge_m = EdgeAt(along_m);
      const bool goes_on = edge_m && !run.middle.empty() && std::abs(*edge_m - run.edge_m) < kKinkM;
      if (!goes_on) EndRun(run, sidewalks);
      if (!edge_m) continue;
      if (run.middle.empty()) run.begin_m = along_m;
      run.end_m = along_m;
      run.edge_m = *edge_m;
      run.middle.push_back(PointAt(along_m, *edge_m + (kInnerM + kOuterM) / 2));
    }
    EndRun(run, sidewalks);
  }

 private:
  static constexpr double kInnerM = 0.2, kOuterM = 1.7;  // beyond the carriageway's edge

  struct Run {
    double begin_m = 0, end_m = 0, edge_m = 0;
    std::vector<Eigen::Vector2d> middle;
  };

  Eigen::Vector2d PointAt(double along_m, double outwards_m) const {
    return route_.At(along_m, side_ * outwards_m).position_in_enu;
  }

  /// Of the carriageway, outwards from the route; none where another road comes in.
  std::optional<double> EdgeAt(double along_m) const {
    constexpr double kReachM = 7, kStepM = 0.25;
    for (double outwards_m = lanes_m_; outwards_m < lanes_m_ + kReachM;) {
      const double beyond_m = ground_.CarriagewayDistance(PointAt(along_m, outwards_m));
      if (beyond_m >= 0) {
        const double edge_m = outwards_m - beyond_m;
        const double room_m = ground_.CarriagewayDistance(PointAt(along_m, edge_m + kOuterM));
        if (room_m < 0.7 * kOuterM) return std::nullopt;
        return edge_m;
      }
      outwards_m += std::max(kStepM, -beyond_m);
    }
    return std::nullopt;
  }

  static void EndRun(Run& run, std::vector<Sidewalk>& sidewalks) {
    constexpr size_t kMinPoints = 4;
    if (run.middle.size() >= kMinPoints) {
      sidewalks.push_back({std::make_unique<const Route>(run.middle, /*closed=*/false), run.begin_m,
                           run.end_m, kOuterM - kInnerM});
    }
    run = {};
  }

  const Route& route_;
  const GroundMap& ground_;
  int side_;
  double lanes_m_ = 0;  ///< to the edge of the outermost lane
};

/// One person or two side by side.
class WalkerSimulation {
 public:
  WalkerSimulation(const Route& route, const ObstacleMap& obstacles, const EgoTrack& ego,
                   const Fleet& fleet, double spacing_m, HashSequence random)
      : route_(route),
        obstacles_(obstacles),
        ego_(ego),
        fleet_(fleet),
        spacing_m_(spacing_m),
        random_(random) {}

  std::vector<Course> Run(const std::vector<Sidewalk>& sidewalks) {
    for (const Sidewalk& sidewalk : sidewalks) {
      double along_m = random_.Unit() * spacing_m_;
      for (; along_m < sidewalk.middle->length_m(); along_m += DrawSpacing()) {
        const double along_route_m =
            std::lerp(sidewalk.begin_m, sidewalk.end_m, along_m / sidewalk.middle->length_m());
        for (const double progress_m : ProgressesAt(along_route_m)) {
          Add(sidewalk, along_m, progress_m);
        }
      }
    }
    return std::move(courses_);
  }

 private:
  struct Walk {
    double left_m = 0, low_m = 0, high_m = 0;  ///< of the sidewalk's middle; free along it
    double LengthM() const { return high_m - low_m; }
  };

  double DrawSpacing() { return spacing_m_ * random_.Between(0.3, 1.7); }

  /// Each time that ego comes by.
  std::vector<double> ProgressesAt(double along_route_m) const {
    constexpr double kBehindM = 15;
    const double first_m = ego_.instants().front().progress_m - kBehindM;
    const double last_m = ego_.instants().back().progress_m + kSightM;
    double progress_m = ego_.direction() * along_route_m;
    std::vector<double> progresses;
    const double lap_m = route_.length_m();
    if (route_.closed()) progress_m += lap_m * std::ceil((first_m - progress_m) / lap_m);
    for (; progress_m <= last_m; progress_m += lap_m) {
      if (progress_m >= first_m) progresses.push_back(progress_m);
      if (!route_.closed()) break;
    }
    return progresses;
  }

  bool IsFree(const Route& path, double along_m, double left_m) const {
    const RoutePoint point = path.At(along_m, left_m);
    return obstacles_.FreeHalfWidth(point.position_in_enu, point.heading_rad, kHalfPersonM) >=
           kHalfPersonM;
  }

  /// As far as nothing stands in the way on this line; none where something stands right there.
  std::optional<Walk> WalkOn(const Sidewalk& sidewalk, double along_m, double left_m) const {
    constexpr double kFurthestM = 60, kStepM = 0.2;
    const Route& path = *sidewalk.middle;
    if (!IsFree(path, along_m, left_m)) return std::nullopt;
    const auto end = [&](int direction) {
      double there_m = along_m;
      while (std::abs(there_m - along_m) < kFurthestM) {
        const double next_m = there_m + direction * kStepM;
        if (next_m < 0 || next_m > path.length_m() || !IsFree(path, next_m, left_m)) break;
        there_m = next_m;
      }
      return there_m;
    };
    const Walk walk{left_m, end(-1) + kStrideM, end(1) - kStrideM};
    if (walk.low_m > along_m || walk.high_m < along_m) return std::nullopt;
    return walk;
  }

  /// The line across the sidewalk that is free the furthest.
  std::optional<Walk> FindWalk(const Sidewalk& sidewalk, double along_m) {
    constexpr int kTries = 4;
    const double room_m = sidewalk.width_m / 2 - kHalfPersonM;
    std::optional<Walk> best;
    for (int i = 0; i < kTries; ++i) {
      const auto walk = WalkOn(sidewalk, along_m, random_.Between(-room_m, room_m));
      if (walk && (!best || walk->LengthM() > best->LengthM())) best = walk;
    }
    return best;
  }

  void Add(const Sidewalk& sidewalk, double along_m, double progress_m) {
    const std::optional<Walk> walk = FindWalk(sidewalk, along_m);
    if (!walk) return;
    const double speed_mps = random_.Chance(0.8) ? random_.Between(0.9, 1.7) : 0;
    const int direction = random_.Chance(0.5) ? 1 : -1;
    AddPerson(sidewalk, *walk, along_m, progress_m, direction, speed_mps);
    if (!random_.Chance(0.25)) return;
    const double left_m = walk->left_m > 0 ? walk->left_m - kAsideM : walk->left_m + kAsideM;
    std::optional<Walk> beside = WalkOn(sidewalk, along_m, left_m);
    if (!beside || std::abs(left_m) > sidewalk.width_m / 2) return;
    beside->low_m = std::max(beside->low_m, walk->low_m);
    beside->high_m = std::min(beside->high_m, walk->high_m);
    AddPerson(sidewalk, *beside, along_m, progress_m, direction, speed_mps);
  }

  /// Where it is when ego comes by, and before and after that as it walks.
  void AddPerson(const Sidewalk& sidewalk, const Walk& walk, double along_m, double progress_m,
                 int direction, double speed_mps) {
    const size_t first = ego_.StepNear(progress_m - kSightM);
    const size_t meets = ego_.StepNear(progress_m), last = ego_.StepNear(progress_m + kSightM);
    Course course{.body = fleet_.Draw(kPedestrian, random_),
                  .path = sidewalk.middle.get(),
                  .direction = direction,
                  .first_step = first};
    for (size_t step = first; step <= last; ++step) {
      const double since_s =
          (static_cast<double>(step) - static_cast<double>(meets)) * EgoTrack::kStepS;
      const double there_m = along_m + direction * speed_mps * since_s;
      course.places.push_back({std::clamp(there_m, walk.low_m, walk.high_m), walk.left_m});
    }
    courses_.push_back(std::move(course));
  }

  static constexpr double kSightM = 215;  ///< and walks up to 60 m of it
  const Route& route_;
  const ObstacleMap& obstacles_;
  const EgoTrack& ego_;
  const Fleet& fleet_;
  double spacing_m_;
  HashSequence random_;
  std::vector<Course> courses_;
};

}  // namespace

std::vector<Sidewalk> FindSidewalks(const Route& route, const RoadProfile& profile,
                                    const GroundMap& ground) {
  std::vector<Sidewalk> sidewalks;
  for (const int side : {-1, 1}) SidewalkFinder(route, profile, ground, side).Find(sidewalks);
  return sidewalks;
}

std::vector<Course> SimulateWalkers(const std::vector<Sidewalk>& sidewalks, const Route& route,
                                    const ObstacleMap& obstacles, const EgoTrack& ego,
                                    const Fleet& fleet, double spacing_m, HashSequence random) {
  return WalkerSimulation(route, obstacles, ego, fleet, spacing_m, random).Run(sidewalks);
}

}  // namespace carmap
