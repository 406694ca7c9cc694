#include "carmap/sim/walkers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace carmap {
namespace {

constexpr KindWeight kPedestrian[] = {{"pedestrian", 1}};
constexpr double kHalfPersonM = 0.35;

/// Across the road, outwards from the middle of the route's lane.
struct Strip {
  double inner_m = 0, outer_m = 0;
};

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
      const std::optional<Strip> strip = StripAt(along_m, run.strips);
      const bool goes_on = strip && !run.strips.empty() &&
                           std::abs(strip->inner_m - run.strips.back().inner_m) < kKinkM;
      if (!goes_on) EndRun(run, sidewalks);
      if (!strip) continue;
      if (run.strips.empty()) run.begin_m = along_m;
      run.end_m = along_m;
      run.strips.push_back(*strip);
      run.middle.push_back(
          route_.At(along_m, side_ * (strip->inner_m + strip->outer_m) / 2).position_in_enu);
    }
    EndRun(run, sidewalks);
  }

 private:
  struct Run {
    double begin_m = 0, end_m = 0;
    std::vector<Strip> strips;
    std::vector<Eigen::Vector2d> middle;
  };

  bool IsSidewalk(double along_m, double outwards_m) const {
    const Eigen::Vector2d p = route_.At(along_m, side_ * outwards_m).position_in_enu;
    return ground_.CoverAt(p.cast<float>(), {0.05f, 0.05f}).label == SemanticClass::kSidewalk;
  }

  /// Looks first near where it was last.
  std::optional<Strip> StripAt(double along_m, const std::vector<Strip>& before) const {
    constexpr double kReachM = 7, kWidestM = 5, kStepM = 0.25, kAroundM = 0.5;
    Strip strip;
    strip.inner_m = before.empty() ? lanes_m_ : before.back().inner_m - kAroundM;
    while (!IsSidewalk(along_m, strip.inner_m)) {
      strip.inner_m += kStepM;
      if (strip.inner_m > lanes_m_ + kReachM) return std::nullopt;
    }
    strip.outer_m = strip.inner_m;
    while (strip.outer_m < strip.inner_m + kWidestM &&
           IsSidewalk(along_m, strip.outer_m + kStepM)) {
      strip.outer_m += kStepM;
    }
    if (strip.outer_m - strip.inner_m < 2 * kHalfPersonM) return std::nullopt;
    return strip;
  }

  static void EndRun(Run& run, std::vector<Sidewalk>& sidewalks) {
    constexpr size_t kMinStrips = 4;
    if (run.strips.size() >= kMinStrips) {
      double width_m = run.strips.front().outer_m - run.strips.front().inner_m;
      for (const Strip& s : run.strips) width_m = std::min(width_m, s.outer_m - s.inner_m);
      sidewalks.push_back({std::make_unique<const Route>(run.middle, /*closed=*/false), run.begin_m,
                           run.end_m, width_m});
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

  /// The line across the sidewalk that is free the furthest.
  std::optional<Walk> FindWalk(const Sidewalk& sidewalk, double along_m) {
    constexpr double kFurthestM = 60, kStepM = 0.2;
    constexpr int kTries = 4;
    const double room_m = sidewalk.width_m / 2 - kHalfPersonM;
    std::optional<Walk> best;
    for (int i = 0; i < kTries; ++i) {
      const double left_m = random_.Between(-room_m, room_m);
      const auto reach = [&](int direction) {
        double way_m = 0;
        while (way_m < kFurthestM && along_m + direction * way_m >= 0 &&
               along_m + direction * way_m <= sidewalk.middle->length_m() &&
               IsFree(*sidewalk.middle, along_m + direction * way_m, left_m)) {
          way_m += kStepM;
        }
        return way_m - kStepM;
      };
      const Walk walk{left_m, along_m - reach(-1), along_m + reach(1)};
      const bool is_free = walk.low_m <= along_m && walk.high_m >= along_m;
      if (is_free && (!best || walk.high_m - walk.low_m > best->high_m - best->low_m)) best = walk;
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
    const double aside_m = walk->left_m > 0 ? -0.75 : 0.75;
    if (std::abs(walk->left_m + aside_m) > sidewalk.width_m / 2 - kHalfPersonM) return;
    Walk beside = *walk;
    beside.left_m += aside_m;
    AddPerson(sidewalk, beside, along_m, progress_m, direction, speed_mps);
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
