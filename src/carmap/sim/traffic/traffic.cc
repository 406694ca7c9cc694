#include "carmap/sim/traffic/traffic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>
#include <optional>
#include <utility>

#include "carmap/base/random.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/lane_line.h"
#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/traffic/ego_track.h"
#include "carmap/sim/traffic/fleet.h"
#include "carmap/sim/traffic/obstacle_map.h"
#include "carmap/sim/traffic/traffic_flow.h"
#include "carmap/sim/traffic/walkers.h"

namespace carmap {
namespace {

using Mix = std::vector<KindWeight>;

enum Stream : uint64_t {
  kParkedOnes,
  kLeaders,
  kWalkers,
  kLooks,
  kInstead,
  kLanes = 100,
  kCyclists = 1000
};

constexpr double kSightM = 150;

// --- Who goes where ---

Mix ParkedMix() {
  return {{"hatchback", 35}, {"saloon", 20}, {"estate", 20}, {"suv", 17}, {"van", 8}};
}

Mix LaneMix(bool freeway, bool slow_lane, bool fast_lane) {
  Mix mix = {{"hatchback", 25}, {"saloon", 20}, {"estate", 18},   {"suv", 15},
             {"van", 10},       {"lorry", 5},   {"motorcycle", 4}};
  if (!freeway) mix.push_back({"bus", 3});
  if (freeway && slow_lane) mix.push_back({"lorry", 45});
  if (fast_lane) std::erase_if(mix, [](const KindWeight& k) { return k.kind == "lorry"; });
  return mix;
}

Mix FirstLeaderMix(bool dense, bool freeway) {
  if (!dense) return LaneMix(freeway, false, false);
  return {{"lorry", 30},   {"bus", freeway ? 8.0 : 30.0}, {"van", 18}, {"suv", 8}, {"estate", 7},
          {"hatchback", 7}};
}

/// A lane of the profile, as the vehicle with the cameras sees it.
struct Lane {
  int number = 0;
  bool with_ego = false;
};

std::vector<Lane> LanesOf(const RoadProfile& profile, int ego_direction) {
  std::vector<Lane> lanes;
  const int first = std::min(profile.first_lane, profile.first_oncoming);
  const int last = std::max(profile.last_lane, profile.last_oncoming);
  for (int number = first; number <= last; ++number) {
    const bool oncoming = number >= profile.first_oncoming && number <= profile.last_oncoming;
    const bool along = number >= profile.first_lane && number <= profile.last_lane;
    if (oncoming || along) lanes.push_back({number, oncoming == (ego_direction < 0)});
  }
  return lanes;
}

bool IsDrivenByEgo(double left_m, double lane_width_m, const EgoTrack& ego) {
  return std::any_of(ego.instants().begin(), ego.instants().end(), [&](const auto& instant) {
    return std::abs(instant.left_m - left_m) < 0.6 * lane_width_m;
  });
}

// --- Nobody runs into anybody ---

/// Outlines of what is taken already, at rest or at each step.
class Timetable {
 public:
  explicit Timetable(size_t steps) : moving_(steps) {}

  void AddAtRest(const GroundBox& box) { at_rest_.Add(box); }
  void Add(size_t step, const GroundBox& box) { moving_[step].push_back(box); }
  bool IsFree(size_t step, const GroundBox& box) const {
    return at_rest_.IsFree(box) &&
           std::none_of(moving_[step].begin(), moving_[step].end(),
                        [&](const GroundBox& other) { return Overlap(box, other); });
  }

 private:
  Occupancy at_rest_;
  std::vector<std::vector<GroundBox>> moving_;
};

// --- How it looks ---

/// Looks have colours of their own; two of one look still differ.
float DrawShade(HashSequence& random) { return static_cast<float>(random.Between(0.75, 1.3)); }

}  // namespace

struct Traffic::Impl {
  Impl(std::shared_ptr<const World> world, const Route& route, const RoadProfile& profile,
       TrafficDensity density, uint64_t seed, const std::vector<EgoState>& ego,
       uint32_t first_model_idx)
      : world_(std::move(world)),
        route_(route),
        profile_(profile),
        density_(density),
        seed_(seed),
        ego_(ego),
        first_model_idx_(first_model_idx) {
    if (density == TrafficDensity::kNone || ego.empty()) return;
    fleet_.emplace();
    track_.emplace(route_, ego);
    Park();
    if (density == TrafficDensity::kParked) return;
    Timetable timetable = TimetableOfEgo();
    const ObstacleMap standing(*world_);
    // In this order: whoever is in the way of an earlier one is left out, or is a smaller one.
    DriveAhead(timetable);
    DriveInLanes(standing, timetable);
    Cycle(standing, timetable);
    Walk(standing, timetable);
  }

  std::vector<Placement> At(size_t frame_idx) const {
    std::vector<Placement> placements;
    if (!track_) return placements;
    const double exact_step = track_->StepAt(ego_[frame_idx].time_s);
    const auto step = static_cast<size_t>(std::max(0.0, exact_step));
    const double fraction = exact_step - static_cast<double>(step);
    const Eigen::Vector2d here =
        route_.At(ego_[frame_idx].along_m, ego_[frame_idx].left_m).position_in_enu;
    const auto add_if_near = [&](const Placement& placement) {
      if ((placement.position_in_enu.head<2>() - here).norm() < kSightM) {
        placements.push_back(placement);
      }
    };
    for (const Placement& parked : parked_) add_if_near(parked);
    for (size_t i = 0; i < courses_.size(); ++i) {
      const Course& course = courses_[i];
      if (step < course.first_step || step + 1 >= course.first_step + course.places.size()) {
        continue;
      }
      add_if_near(PlacementOf(i, step - course.first_step, fraction));
    }
    return placements;
  }

  const std::vector<Mesh>& models() const {
    static const auto* const kNone = new std::vector<Mesh>;
    return fleet_ ? fleet_->models() : *kNone;
  }

 private:
  const Body& BodyOf(uint32_t idx) const { return fleet_->bodies()[idx]; }
  bool IsDense() const { return density_ == TrafficDensity::kDense; }
  bool IsFreeway() const { return profile_.speed_mps > 18; }
  HashSequence Draw(uint64_t stream) const { return HashSequence(seed_, stream); }

  // --- Parked ones ---

  void Park() {
    Occupancy taken;
    for (const EgoTrack::Instant& instant : track_->instants()) {
      taken.Add(EgoOutline(instant).Grown(0.3, 0.1));
    }
    for (size_t i = 0; i < world_->parking.size(); ++i) {
      HashSequence random(HashKeys(seed_, kParkedOnes), i);
      if (!random.Chance(IsDense() ? 0.9 : 0.7)) continue;
      const ParkingPlace& place = world_->parking[i];
      const Body& body = DrawParked(place.length_m, random);
      Placement placement = ParkedAt(place, place.length_m - body.length_m, random);
      const GroundBox box{placement.position_in_enu.head<2>(), placement.heading_rad,
                          body.length_m / 2, body.width_m / 2};
      if (!taken.IsFree(box.Grown(0.15, 0.05)) || !NextInstance(placement)) continue;
      taken.Add(box);
      placement.model_idx = first_model_idx_ + body.first_model;
      placement.mobility = PlacementMobility::kParked;
      parked_.push_back(placement);
      parked_boxes_.push_back(box);
    }
  }

  /// One that fits in if it can.
  const Body& DrawParked(double room_m, HashSequence& random) const {
    constexpr int kAttempts = 8;
    const Mix mix = ParkedMix();
    uint32_t body = fleet_->Draw(mix, random);
    for (int i = 1; i < kAttempts && BodyOf(body).length_m > room_m; ++i) {
      body = fleet_->Draw(mix, random);
    }
    return BodyOf(body);
  }

  /// Not quite in the middle, not quite straight, some the other way round.
  Placement ParkedAt(const ParkingPlace& place, double room_m, HashSequence& random) const {
    Placement placement;
    const double along_m = random.Between(-0.5, 0.5) * std::max(0.0, room_m - 0.3);
    const double aside_m = random.Between(-0.08, 0.08);
    const bool turned = random.Chance(0.15);
    const Eigen::Vector2d forward(std::cos(place.heading_rad), std::sin(place.heading_rad));
    placement.position_in_enu = place.position_in_enu;
    placement.position_in_enu.head<2>() +=
        along_m * forward + aside_m * Eigen::Vector2d(-forward.y(), forward.x());
    placement.position_in_enu.z() += along_m * std::tan(place.pitch_rad);
    placement.heading_rad =
        place.heading_rad + static_cast<float>(random.Between(-0.03, 0.03) + (turned ? M_PI : 0));
    placement.pitch_rad = turned ? -place.pitch_rad : place.pitch_rad;
    return placement;
  }

  /// False where no number is left.
  bool NextInstance(Placement& placement) {
    if (last_instance_ == std::numeric_limits<uint16_t>::max()) return false;
    placement.instance = ++last_instance_;
    HashSequence random(HashKeys(seed_, kLooks), placement.instance);
    placement.shade = DrawShade(random);
    placement.texture_seed = static_cast<uint32_t>(random.Next());
    return true;
  }

  // --- Moving ones ---

  GroundBox EgoOutline(const EgoTrack::Instant& instant) const {
    const Body body{.length_m = EgoTrack::kLengthM, .width_m = EgoTrack::kWidthM};
    const int direction = track_->direction();
    return OutlineOf(body, route_, {direction * instant.progress_m, instant.left_m}, direction);
  }

  Timetable TimetableOfEgo() const {
    Timetable timetable(track_->instants().size());
    for (const GroundBox& box : parked_boxes_) timetable.AddAtRest(box);
    for (size_t step = 0; step < track_->instants().size(); ++step) {
      const EgoTrack::Instant& instant = track_->instants()[step];
      timetable.Add(step, EgoOutline(instant).Grown(0.3 + kHalfStepS * instant.speed_mps, 0.05));
    }
    return timetable;
  }

  /// With room around it and for what it moves until the middle between two steps.
  GroundBox OutlineAt(const Course& course, size_t i) const {
    const size_t next = std::min(i + 1, course.places.size() - 1);
    const double moved_m = std::abs(course.places[next].along_m - course.places[i].along_m);
    return OutlineOf(BodyOf(course.body), *course.path, course.places[i], course.direction)
        .Grown(0.1 + moved_m / 2, 0.05);
  }

  /// Where it has room all its way; empty if it has not.
  std::vector<GroundBox> RoomFor(const Course& course, const Timetable& timetable) const {
    std::vector<GroundBox> boxes;
    for (size_t i = 0; i < course.places.size(); ++i) {
      boxes.push_back(OutlineAt(course, i));
      if (!timetable.IsFree(course.first_step + i, boxes.back())) return {};
    }
    return boxes;
  }

  /// For one that has no room: the next shorter vehicle; a line nearer to the lane's middle for who
  /// rides beside it. False where there is nothing else to try.
  bool Adapt(Course& course) const {
    const Body& body = BodyOf(course.body);
    if (body.kind == "cyclist") {
      for (Course::Place& place : course.places) place.left_m += 0.1 * course.direction;
      return true;
    }
    const std::optional<uint32_t> shorter = fleet_->NextShorter(course.body);
    if (shorter) course.body = *shorter;
    return shorter.has_value();
  }

  void Accept(std::vector<Course> courses, Timetable& timetable) {
    constexpr int kAttempts = 6;
    for (Course& course : courses) {
      std::vector<GroundBox> boxes = RoomFor(course, timetable);
      for (int attempt = 1; attempt < kAttempts && boxes.empty() && Adapt(course); ++attempt) {
        boxes = RoomFor(course, timetable);
      }
      Placement looks;
      if (boxes.empty() || !NextInstance(looks)) continue;
      for (size_t i = 0; i < boxes.size(); ++i) timetable.Add(course.first_step + i, boxes[i]);
      looks.mobility = PlacementMobility::kMoving;
      looks_.push_back(looks);
      courses_.push_back(std::move(course));
    }
  }

  void DriveAhead(Timetable& timetable) {
    const double cruise_mps = track_->cruise_mps();
    const Mix first = FirstLeaderMix(IsDense(), IsFreeway()), others = LaneMix(IsFreeway(), {}, {});
    LeaderOptions options{.first = first, .others = others, .sight_m = Sight(170)};
    if (IsDense()) {
      options.max_members = 5;
      options.min_gap_m = 6 + 0.1 * cruise_mps;
      options.max_gap_m = 9 + 0.25 * cruise_mps;
      options.min_near_s = 30;
      options.max_near_s = 75;
    }
    Accept(SimulateLeaders(route_, *track_, *fleet_, options, Draw(kLeaders)), timetable);
  }

  void DriveInLanes(const ObstacleMap& standing, Timetable& timetable) {
    ObstacleMap obstacles = standing;
    for (const GroundBox& box : parked_boxes_) obstacles.Add(box);
    const double ego_left_m = track_->instants().front().left_m;
    for (const Lane& lane : LanesOf(profile_, track_->direction())) {
      const double left_m = lane.number * profile_.lane_width_m;
      if (IsDrivenByEgo(left_m, profile_.lane_width_m, *track_)) continue;
      // Lanes further to the left, as their drivers see it, are faster.
      const double from_ego = (left_m - ego_left_m) / profile_.lane_width_m;
      const double rank = track_->direction() * from_ego;
      const double faster = lane.with_ego ? 1 + 0.07 * rank - 0.01 : 0.97;
      const Mix mix = LaneMix(IsFreeway(), lane.with_ego && rank < 0, lane.with_ego && rank > 1);
      const FlowOptions options{
          .direction = lane.with_ego ? track_->direction() : -track_->direction(),
          .mix = mix,
          .mean_spacing_m = IsDense() ? 18 + 1.6 * profile_.speed_mps : 40 + 4 * profile_.speed_mps,
          .min_factor = faster - 0.06,
          .max_factor = faster + 0.06,
          .with_ego = lane.with_ego,
          .base_mps = profile_.speed_mps,
          .sight_m = Sight(200)};
      const LaneLine& line = lanes_.emplace_back(route_, left_m);
      const auto stream = static_cast<uint64_t>(kLanes + lane.number);
      Accept(SimulateFlow(line, NarrowPlaces(line.path(), obstacles), *track_, *fleet_, options,
                          Draw(stream)),
             timetable);
    }
  }

  /// In both directions, as far from the lane's middle as what is parked leaves room.
  void Cycle(const ObstacleMap& standing, Timetable& timetable) {
    if (IsFreeway()) return;
    constexpr double kFromMiddleM = 1.62;
    const Mix mix = {{"cyclist", 1}};
    for (const int side : {-1, 1}) {
      const double left_m = side > 0 ? profile_.last_oncoming * profile_.lane_width_m + kFromMiddleM
                                     : profile_.first_lane * profile_.lane_width_m - kFromMiddleM;
      const FlowOptions options{.direction = -side,
                                .mix = mix,
                                .mean_spacing_m = IsDense() ? 60.0 : 120.0,
                                .min_factor = 0.8,
                                .max_factor = 1.3,
                                .base_mps = 4.5,
                                .sight_m = Sight(200)};
      const LaneLine& line = lanes_.emplace_back(route_, left_m);
      const auto stream = static_cast<uint64_t>(kCyclists + side);
      Accept(SimulateFlow(line, NarrowPlaces(line.path(), standing), *track_, *fleet_, options,
                          Draw(stream)),
             timetable);
    }
  }

  void Walk(const ObstacleMap& standing, Timetable& timetable) {
    if (IsFreeway()) return;
    sidewalks_ = FindSidewalks(route_, profile_, *world_->ground);
    Accept(SimulateWalkers(sidewalks_, route_, standing, *track_, *fleet_, IsDense() ? 12 : 30,
                           Draw(kWalkers)),
           timetable);
  }

  /// On a small loop the ends of what is filled must not meet.
  double Sight(double metres) const {
    return route_.closed() ? std::min(metres, route_.length_m() / 2 - 35) : metres;
  }

  Placement PlacementOf(size_t course_idx, size_t i, double fraction) const {
    const Course& course = courses_[course_idx];
    const Course::Place &a = course.places[i], &b = course.places[i + 1];
    const Course::Place place{std::lerp(a.along_m, b.along_m, fraction),
                              std::lerp(a.left_m, b.left_m, fraction)};
    const Body& body = BodyOf(course.body);
    const GroundBox box = OutlineOf(body, *course.path, place, course.direction);
    const Eigen::Vector2d half = 0.3 * body.length_m * box.Forward();
    const double front_m = world_->ground->HeightAt(box.centre_in_enu + half);
    const double rear_m = world_->ground->HeightAt(box.centre_in_enu - half);
    Placement placement = looks_[course_idx];
    const bool on_sidewalk = body.kind == "pedestrian";
    placement.position_in_enu << box.centre_in_enu,
        (front_m + rear_m) / 2 + (on_sidewalk ? kSidewalkHeightM : 0);
    placement.heading_rad = static_cast<float>(box.heading_rad);
    placement.pitch_rad = static_cast<float>(std::atan2(front_m - rear_m, 2 * half.norm()));
    const bool stands = std::abs(b.along_m - a.along_m) < 1e-3;
    const double way_m = std::abs(place.along_m - course.places.front().along_m);
    placement.model_idx = first_model_idx_ + body.first_model + (stands ? 0 : PhaseOf(body, way_m));
    return placement;
  }

  static uint32_t PhaseOf(const Body& body, double way_m) {
    if (body.cycle_m <= 0) return 0;
    const double cycles = way_m / body.cycle_m;
    const auto phase = static_cast<uint32_t>((cycles - std::floor(cycles)) * body.phases);
    return std::min(phase, body.phases - 1);
  }

  static constexpr double kHalfStepS = EgoTrack::kStepS / 2;

  const std::shared_ptr<const World> world_;
  const Route route_;
  const RoadProfile profile_;
  const TrafficDensity density_;
  const uint64_t seed_;
  const std::vector<EgoState> ego_;
  const uint32_t first_model_idx_;
  std::optional<Fleet> fleet_;
  std::optional<EgoTrack> track_;

  std::vector<Placement> parked_;
  std::vector<GroundBox> parked_boxes_;
  std::deque<LaneLine> lanes_;       ///< courses point into these
  std::vector<Sidewalk> sidewalks_;  ///< and these
  std::vector<Course> courses_;
  std::vector<Placement> looks_;  ///< of each course: what stays the same
  uint16_t last_instance_ = 0;
};

Traffic::Traffic(std::shared_ptr<const World> world, const Route& route, const RoadProfile& profile,
                 TrafficDensity density, uint64_t seed, const std::vector<EgoState>& ego,
                 uint32_t first_model_idx)
    : impl_(std::make_unique<const Impl>(std::move(world), route, profile, density, seed, ego,
                                         first_model_idx)) {}

Traffic::~Traffic() = default;

const std::vector<Mesh>& Traffic::models() const { return impl_->models(); }

std::vector<Placement> Traffic::At(size_t frame_idx) const { return impl_->At(frame_idx); }

}  // namespace carmap
