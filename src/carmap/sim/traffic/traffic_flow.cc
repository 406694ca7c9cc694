#include "carmap/sim/traffic/traffic_flow.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "carmap/sim/traffic/car_following.h"

namespace carmap {
namespace {

constexpr double kStepS = EgoTrack::kStepS;
constexpr double kSideways = 2.6, kLengthways = 1.4;  // m/s² in and before curves
constexpr double kFarM = 1e9;

/// One on a line of travel, by where its middle is on it.
struct Motion {
  double along_m = 0, speed_mps = 0;

  void Advance(double acceleration) {
    const double before_mps = speed_mps;
    speed_mps = std::max(0.0, speed_mps + acceleration * kStepS);
    along_m += (before_mps + speed_mps) / 2 * kStepS;
  }
};

/// Of what is ahead: from middle to middle, less half of both.
double GapBetween(const Motion& behind, double half_length_m, const Motion& ahead,
                  double half_length_ahead_m) {
  return ahead.along_m - behind.along_m - half_length_m - half_length_ahead_m;
}

// --- Leaders ---

/// Time runs backwards in here: ego drives ahead, and a group follows it.
class LeaderSimulation {
 public:
  LeaderSimulation(const Route& route, const EgoTrack& ego, const Fleet& fleet,
                   const LeaderOptions& options, HashSequence random)
      : route_(route),
        ego_(ego),
        fleet_(fleet),
        options_(options),
        random_(random),
        limit_(route, kSideways, kLengthways),
        far_headway_s_(1.2 * options.sight_m / ego.cruise_mps()) {}

  std::vector<Course> Run() {
    size_t step = ego_.instants().size() - 1;
    BeginNear();
    headway_s_ = target_headway_s_;
    AddGroup(EgoAt(step), driver_.standing_gap_m + headway_s_ * EgoAt(step).speed_mps);
    Record();
    while (step-- > 0) {
      Advance(EgoAt(step + 1));
      ChangeHeadway(EgoAt(step));
      if (target_headway_s_ == far_headway_s_ && GapTo(EgoAt(step)) > options_.sight_m) {
        EndGroup(step + 1);
        BeginNear();
        headway_s_ = options_.sight_m / ego_.cruise_mps();
        AddGroup(EgoAt(step), options_.sight_m);
      }
      Record();
    }
    EndGroup(0);
    return std::move(courses_);
  }

 private:
  struct Member {
    Course course;
    Motion motion;  ///< on the way back: minus progress
    double half_length_m = 0, headway_s = 0;
  };
  static constexpr double kHalfEgoM = EgoTrack::kLengthM / 2;

  Motion EgoAt(size_t step) const {
    const EgoTrack::Instant& instant = ego_.instants()[step];
    return {-instant.progress_m, instant.speed_mps};
  }
  double GapTo(const Motion& ego) const {
    const Member& nearest = group_.front();
    return GapBetween(nearest.motion, nearest.half_length_m, ego, kHalfEgoM);
  }

  void BeginNear() {
    const double gap_m = random_.Between(options_.min_gap_m, options_.max_gap_m);
    target_headway_s_ = std::max(0.0, gap_m - driver_.standing_gap_m) / ego_.cruise_mps();
    hold_s_ = random_.Between(options_.min_near_s, options_.max_near_s);
  }

  /// Near for a while; then away, or further off for a little and near again.
  void ChangeHeadway(const Motion& ego) {
    constexpr double kRelativeMps = 5;
    const double change_s = kRelativeMps / ego_.cruise_mps() * kStepS;
    headway_s_ += std::clamp(target_headway_s_ - headway_s_, -change_s, change_s);
    const double wanted_gap_m = driver_.standing_gap_m + target_headway_s_ * ego.speed_mps;
    if (headway_s_ != target_headway_s_ || GapTo(ego) > 1.5 * wanted_gap_m + 5) return;
    if ((hold_s_ -= kStepS) > 0) return;
    if (is_further_off_) {
      BeginNear();
    } else if (random_.Chance(0.3)) {
      target_headway_s_ = far_headway_s_;
      hold_s_ = std::numeric_limits<double>::infinity();
    } else {
      target_headway_s_ += random_.Between(30, 60) / ego_.cruise_mps();
      hold_s_ = random_.Between(4, 12);
      is_further_off_ = true;
      return;
    }
    is_further_off_ = false;
  }

  void AddGroup(Motion ahead, double gap_m) {
    double half_length_ahead_m = kHalfEgoM;
    const uint32_t members = 1 + random_.Below(options_.max_members);
    for (uint32_t i = 0; i < members; ++i) {
      Member member;
      member.course.body = fleet_.Draw(i == 0 ? options_.first : options_.others, random_);
      member.half_length_m = fleet_.bodies()[member.course.body].length_m / 2;
      member.headway_s = random_.Between(0.8, 1.8);
      ahead.along_m -= half_length_ahead_m + gap_m + member.half_length_m;
      member.motion = ahead;
      half_length_ahead_m = member.half_length_m;
      gap_m = driver_.standing_gap_m + random_.Between(0.8, 1.8) * ahead.speed_mps;
      group_.push_back(std::move(member));
    }
  }

  void EndGroup(size_t first_step) {
    for (Member& member : group_) {
      Course& course = member.course;
      std::reverse(course.places.begin(), course.places.end());
      course.path = &route_;
      course.direction = ego_.direction();
      course.first_step = first_step;
      courses_.push_back(std::move(course));
    }
    group_.clear();
  }

  void Record() {
    for (Member& member : group_) {
      const double progress_m = -member.motion.along_m;
      member.course.places.push_back({ego_.direction() * progress_m, ego_.LeftAt(progress_m)});
    }
  }

  void Advance(const Motion& ego) {
    for (size_t i = group_.size(); i-- > 0;) {
      Member& member = group_[i];
      const Motion& ahead = i > 0 ? group_[i - 1].motion : ego;
      const double half_length_ahead_m = i > 0 ? group_[i - 1].half_length_m : kHalfEgoM;
      DriverModel driver = driver_;
      driver.headway_s = i > 0 ? member.headway_s : headway_s_;
      const double limit_mps = limit_.At(-ego_.direction() * member.motion.along_m);
      const double desired_mps = std::min(limit_mps, 1.5 * ego_.cruise_mps());
      const double gap_m =
          GapBetween(member.motion, member.half_length_m, ahead, half_length_ahead_m);
      member.motion.Advance(FollowingAcceleration(driver, member.motion.speed_mps, desired_mps,
                                                  {gap_m, ahead.speed_mps}));
    }
  }

  const Route& route_;
  const EgoTrack& ego_;
  const Fleet& fleet_;
  const LeaderOptions& options_;
  HashSequence random_;
  const SpeedLimit limit_;
  const double far_headway_s_;
  const DriverModel driver_{};

  std::vector<Member> group_;  ///< the nearest to ego first
  double headway_s_ = 0;       ///< of the nearest
  double target_headway_s_ = 0, hold_s_ = 0;
  bool is_further_off_ = false;
  std::vector<Course> courses_;
};

// --- Other lanes ---

/// All along the lane's path times the direction of travel, so that it grows.
class FlowSimulation {
 public:
  FlowSimulation(const LaneLine& lane, const NarrowPlaces& narrows, const EgoTrack& ego,
                 const Fleet& fleet, const FlowOptions& options, HashSequence random)
      : lane_(lane),
        narrows_(narrows),
        ego_(ego),
        fleet_(fleet),
        options_(options),
        random_(random),
        limit_(lane.path(), kSideways, kLengthways) {}

  std::vector<Course> Run() {
    for (step_ = 0; step_ < ego_.instants().size(); ++step_) {
      if (step_ > 0) Advance();
      const double ego_m =
          options_.direction * lane_.Beside(ego_.direction() * ego_.instants()[step_].progress_m);
      Remove(ego_m);
      step_ == 0 ? FillAll(ego_m) : FillEnds(ego_m);
      for (Driver& driver : drivers_) {
        driver.course.places.push_back({options_.direction * driver.motion.along_m, 0});
      }
    }
    for (Driver& driver : drivers_) courses_.push_back(std::move(driver.course));
    return std::move(courses_);
  }

 private:
  struct Driver {
    Course course;
    Motion motion;
    double half_length_m = 0, half_width_m = 0, factor = 1;
  };

  double BaseSpeed() const {
    return options_.with_ego ? ego_.instants()[step_].speed_mps : options_.base_mps;
  }
  double DesiredSpeed(const Driver& driver) const {
    return std::min(driver.factor * BaseSpeed(),
                    limit_.At(options_.direction * driver.motion.along_m));
  }
  /// From the front of the vehicle; negative where it stands in a narrow place.
  double ToNarrow(const Driver& driver) const {
    constexpr double kClearM = 0.1;
    const double rear_m = driver.motion.along_m - driver.half_length_m;
    return narrows_.DistanceFrom(options_.direction * rear_m, options_.direction,
                                 driver.half_width_m + kClearM) -
           2 * driver.half_length_m;
  }

  /// From middle to middle of neighbours that come in.
  double DrawSpacing() {
    constexpr double kLongestM = 13;
    const double least_m = kLongestM + 3 + 1.2 * BaseSpeed();
    return least_m -
           std::max(0.0, options_.mean_spacing_m - least_m) * std::log(1 - random_.Unit());
  }

  Driver NewDriver(double along_m) {
    Driver driver;
    driver.course = {.body = fleet_.Draw(options_.mix, random_),
                     .path = &lane_.path(),
                     .direction = options_.direction,
                     .first_step = step_};
    const Body& body = fleet_.bodies()[driver.course.body];
    driver.half_length_m = body.length_m / 2;
    driver.half_width_m = body.width_m / 2;
    driver.factor = random_.Between(options_.min_factor, options_.max_factor);
    driver.motion.along_m = along_m;
    driver.motion.speed_mps = DesiredSpeed(driver);
    return driver;
  }

  /// Slow enough to stop for what is ahead.
  void LimitSpeed(const Driver* ahead, Driver& driver) const {
    constexpr double kBraking = 1.5;
    const auto limit = [&](double way_m, double end_mps) {
      const double saved_mps = std::sqrt(2 * kBraking * std::max(0.0, way_m - 4));
      driver.motion.speed_mps = std::min(driver.motion.speed_mps, std::hypot(end_mps, saved_mps));
    };
    limit(ToNarrow(driver), 0);
    if (ahead == nullptr) return;
    limit(GapBetween(driver.motion, driver.half_length_m, ahead->motion, ahead->half_length_m),
          ahead->motion.speed_mps);
  }

  void AddInFront(double along_m) {
    Driver driver = NewDriver(along_m);
    spacing_in_front_m_ += DrawSpacing();
    if (ToNarrow(driver) < 0) return;
    LimitSpeed(nullptr, driver);
    drivers_.insert(drivers_.begin(), std::move(driver));
    spacing_in_front_m_ = DrawSpacing();
  }

  void AddBehind(double along_m) {
    Driver driver = NewDriver(along_m);
    spacing_behind_m_ += DrawSpacing();
    if (ToNarrow(driver) < 0) return;
    LimitSpeed(drivers_.empty() ? nullptr : &drivers_.back(), driver);
    drivers_.push_back(std::move(driver));
    spacing_behind_m_ = DrawSpacing();
  }

  bool IsPassedByEgo() const {
    return options_.direction == ego_.direction() &&
           options_.min_factor * BaseSpeed() < ego_.instants()[step_].speed_mps;
  }

  /// In the beginning all that ego sees, from the front to the rear.
  void FillAll(double ego_m) {
    const double front_end_m = ego_m + options_.sight_m, rear_end_m = ego_m - options_.sight_m;
    spacing_in_front_m_ = DrawSpacing();
    spacing_behind_m_ = spacing_in_front_m_ * random_.Unit();
    for (double rear_m = front_end_m; rear_m - spacing_behind_m_ > rear_end_m;) {
      AddBehind(rear_m - spacing_behind_m_);
      if (!drivers_.empty()) rear_m = drivers_.back().motion.along_m;
    }
  }

  /// Later at both ends, as room comes free there.
  void FillEnds(double ego_m) {
    const double front_end_m = ego_m + options_.sight_m, rear_end_m = ego_m - options_.sight_m;
    if (drivers_.empty()) {
      AddBehind(IsPassedByEgo() ? front_end_m : rear_end_m);
      return;
    }
    if (drivers_.back().motion.along_m - spacing_behind_m_ > rear_end_m) AddBehind(rear_end_m);
    if (drivers_.front().motion.along_m + spacing_in_front_m_ < front_end_m) {
      AddInFront(front_end_m);
    }
  }

  void Remove(double ego_m) {
    constexpr double kBeyondM = 30;
    const auto is_gone = [&](const Driver& driver) {
      return std::abs(driver.motion.along_m - ego_m) > options_.sight_m + kBeyondM;
    };
    for (Driver& driver : drivers_) {
      if (is_gone(driver)) courses_.push_back(std::move(driver.course));
    }
    drivers_.erase(std::remove_if(drivers_.begin(), drivers_.end(), is_gone), drivers_.end());
  }

  void Advance() {
    for (size_t i = drivers_.size(); i-- > 0;) {
      Driver& driver = drivers_[i];
      const double desired_mps = DesiredSpeed(driver), speed_mps = driver.motion.speed_mps;
      double acceleration = FollowingAcceleration({}, speed_mps, desired_mps, {ToNarrow(driver)});
      if (i > 0) {
        const Driver& ahead = drivers_[i - 1];
        const double gap_m =
            GapBetween(driver.motion, driver.half_length_m, ahead.motion, ahead.half_length_m);
        acceleration = std::min(
            acceleration,
            FollowingAcceleration({}, speed_mps, desired_mps, {gap_m, ahead.motion.speed_mps}));
      }
      driver.motion.Advance(acceleration);
    }
  }

  const LaneLine& lane_;
  const NarrowPlaces& narrows_;
  const EgoTrack& ego_;
  const Fleet& fleet_;
  const FlowOptions& options_;
  HashSequence random_;
  const SpeedLimit limit_;

  size_t step_ = 0;
  std::vector<Driver> drivers_;  ///< the foremost first
  double spacing_in_front_m_ = 0, spacing_behind_m_ = 0;
  std::vector<Course> courses_;
};

}  // namespace

GroundBox OutlineOf(const Body& body, const Route& path, const Course::Place& place,
                    int direction) {
  const double half_wheelbase_m = 0.3 * body.length_m;
  const Eigen::Vector2d front =
      path.At(place.along_m + direction * half_wheelbase_m, place.left_m).position_in_enu;
  const Eigen::Vector2d rear =
      path.At(place.along_m - direction * half_wheelbase_m, place.left_m).position_in_enu;
  const Eigen::Vector2d along = front - rear;
  return {(front + rear) / 2, std::atan2(along.y(), along.x()), body.length_m / 2,
          body.width_m / 2};
}

NarrowPlaces::NarrowPlaces(const Route& path, const ObstacleMap& obstacles)
    : lap_m_(path.closed() ? path.length_m() : 0) {
  constexpr double kStepM = 0.5, kWidestM = 1.6;
  for (double along_m = 0; along_m < path.length_m(); along_m += kStepM) {
    const RoutePoint point = path.At(along_m);
    const double free_m =
        obstacles.FreeHalfWidth(point.position_in_enu, point.heading_rad, kWidestM);
    if (free_m < kWidestM) narrows_.push_back({along_m, free_m});
  }
}

double NarrowPlaces::DistanceFrom(double along_m, int direction, double half_width_m) const {
  constexpr double kSightM = 150;
  const double lap = lap_m_ > 0 ? std::floor(along_m / lap_m_) : 0;
  const double start_m = along_m - lap * lap_m_;
  const auto count = static_cast<int64_t>(narrows_.size());
  const auto after =
      std::lower_bound(narrows_.begin(), narrows_.end(), start_m,
                       [](const Narrow& narrow, double along) { return narrow.along_m < along; });
  int64_t i = after - narrows_.begin() - (direction < 0 ? 1 : 0);
  for (int64_t visited = 0; visited < count; ++visited, i += direction) {
    if (lap_m_ == 0 && (i < 0 || i >= count)) break;
    const int64_t wrapped = ((i % count) + count) % count;
    const auto laps = static_cast<double>((i - wrapped) / count);
    const Narrow& narrow = narrows_[static_cast<size_t>(wrapped)];
    const double distance_m = direction * (narrow.along_m + laps * lap_m_ - start_m);
    if (distance_m > kSightM) break;
    if (narrow.half_width_m < half_width_m) return distance_m;
  }
  return kFarM;
}

std::vector<Course> SimulateLeaders(const Route& route, const EgoTrack& ego, const Fleet& fleet,
                                    const LeaderOptions& options, HashSequence random) {
  return LeaderSimulation(route, ego, fleet, options, random).Run();
}

std::vector<Course> SimulateFlow(const LaneLine& lane, const NarrowPlaces& narrows,
                                 const EgoTrack& ego, const Fleet& fleet,
                                 const FlowOptions& options, HashSequence random) {
  return FlowSimulation(lane, narrows, ego, fleet, options, random).Run();
}

}  // namespace carmap
