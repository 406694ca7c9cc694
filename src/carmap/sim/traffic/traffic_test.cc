#include "carmap/sim/traffic/traffic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "carmap/sim/mesh/mesh_builder.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/lane_line.h"
#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/traffic/ego_track.h"
#include "carmap/sim/traffic/fleet.h"
#include "carmap/sim/traffic/traffic_flow.h"

namespace carmap {
namespace {

using Points = std::vector<Eigen::Vector2d>;

constexpr double kFrameS = 0.1035;
constexpr double kShoulderM = 0.3, kParkingM = 2.1, kSidewalkM = 2;  // widths
const RoadProfile kTown{.lane_width_m = 3.1, .speed_mps = 10};
const RoadProfile kFreeway{.lane_width_m = 3.75,
                           .first_lane = -1,
                           .last_lane = 2,
                           .first_oncoming = 4,
                           .last_oncoming = 7,
                           .speed_mps = 27};

/// A road along the route on a slope of 3 % to the east: two lanes, parking and sidewalks on both
/// sides.
class RouteGround : public GroundMap {
 public:
  explicit RouteGround(const Route& route) {
    for (double along_m = 0; along_m <= route.length_m(); along_m += 1) {
      points_.push_back(route.At(along_m));
    }
  }
  double HeightAt(const Eigen::Vector2d& p) const override { return 0.03 * p.x(); }
  GroundCover CoverAt(const Eigen::Vector2f& p, const Eigen::Vector2f&) const override {
    const double distance_m = CarriagewayDistance(p.cast<double>());
    const SemanticClass label = distance_m < 0            ? SemanticClass::kRoad
                                : distance_m < kSidewalkM ? SemanticClass::kSidewalk
                                                          : SemanticClass::kTerrain;
    return {.label = label};
  }
  double CarriagewayDistance(const Eigen::Vector2d& p) const override {
    double nearest_m = 100;
    for (const RoutePoint& point : points_) {
      const Eigen::Vector2d v = p - point.position_in_enu;
      if (v.squaredNorm() > 400) continue;
      const Eigen::Vector2d forward(std::cos(point.heading_rad), std::sin(point.heading_rad));
      const double left_m = forward.x() * v.y() - forward.y() * v.x();
      const double middle_m = kTown.lane_width_m / 2;
      const double aside_m =
          std::abs(left_m - middle_m) - kTown.lane_width_m - kShoulderM - kParkingM;
      nearest_m = std::min(nearest_m, std::max(aside_m, std::abs(v.dot(forward)) - 1));
    }
    return nearest_m;
  }

 private:
  std::vector<RoutePoint> points_;
};

std::shared_ptr<World> TownAlong(const Route& route) {
  auto world = std::make_shared<World>();
  world->ground = std::make_shared<RouteGround>(route);
  for (double along_m = 3; along_m < route.length_m() - 3; along_m += 6) {
    for (const int side : {-1, 1}) {
      const double left_m = side * (kTown.lane_width_m / 2 + kShoulderM + kParkingM / 2) +
                            (side > 0 ? kTown.lane_width_m : 0);
      const RoutePoint at = route.At(along_m, left_m);
      // Where the route comes by again there is no parking.
      const double edge_m = world->ground->CarriagewayDistance(at.position_in_enu);
      if (edge_m < -kParkingM / 2 - 0.1) continue;
      ParkingPlace place;
      place.position_in_enu << at.position_in_enu, world->ground->HeightAt(at.position_in_enu);
      place.heading_rad = static_cast<float>(at.heading_rad + (side > 0 ? M_PI : 0));
      place.length_m = 5.6f;
      world->parking.push_back(place);
    }
  }
  return world;
}

struct Stop {
  double along_m, duration_s;
};

/// Drives the whole of an open route, or `laps` of a closed one.
std::vector<EgoState> Drive(const Route& route, double speed_mps, double left_m = 0,
                            bool reverse = false, std::optional<Stop> stop = std::nullopt,
                            double laps = 1) {
  const SpeedLimit limit(route, 2, 1.5);
  const double way_m = laps * route.length_m();
  std::vector<EgoState> states;
  double s = 0;
  for (double waited_s = 0; s < way_m;) {
    const double along_m = reverse ? way_m - s : s;
    double v = std::min(speed_mps, limit.At(along_m));
    if (stop && waited_s < stop->duration_s) {
      const double left = std::max(0.0, stop->along_m - s);
      v = std::min(v, std::sqrt(2 * 1.5 * left));
      if (v < 0.2) waited_s += kFrameS, v = 0;
    } else if (stop) {
      v = std::min(v, std::sqrt(0.1 + 2 * 1.5 * std::max(0.0, s - stop->along_m)));
    }
    states.push_back({kFrameS * static_cast<double>(states.size()), along_m, left_m, v});
    s += v * kFrameS;
  }
  return states;
}

Route Straight(double length_m) { return Route({{0, 0}, {length_m, 0}}, false); }
Route Curvy() {
  Points points;
  for (double x = 0; x <= 1200; x += 5) points.emplace_back(x, 60 * std::sin(x / 90));
  return Route(points, false);
}

/// With corners of a radius of 8 m.
Points Rounded(const Points& corners, bool closed) {
  constexpr double kRadiusM = 8;
  Points points;
  const size_t count = corners.size();
  for (size_t i = 0; i < count; ++i) {
    if (!closed && (i == 0 || i + 1 == count)) {
      points.push_back(corners[i]);
      continue;
    }
    const Eigen::Vector2d in = (corners[(i + count - 1) % count] - corners[i]).normalized();
    const Eigen::Vector2d out = (corners[(i + 1) % count] - corners[i]).normalized();
    const double half_angle = std::acos(std::clamp(in.dot(out), -1.0, 1.0)) / 2;
    const Eigen::Vector2d middle =
        corners[i] + (in + out).normalized() * kRadiusM / std::sin(half_angle);
    const Eigen::Vector2d first = corners[i] + in * kRadiusM / std::tan(half_angle) - middle;
    const Eigen::Vector2d last = corners[i] + out * kRadiusM / std::tan(half_angle) - middle;
    const double turn = std::atan2(first.x() * last.y() - first.y() * last.x(), first.dot(last));
    for (int k = 0; k <= 8; ++k) {
      points.push_back(middle + Eigen::Rotation2Dd(turn * k / 8) * first);
    }
  }
  return points;
}

Route Block() { return Route(Rounded({{0, 0}, {180, 0}, {180, 120}, {0, 120}}, true), true); }

/// Crosses itself, and drives its first street again the other way round.
Route Loop() {
  return Route(Rounded({{0, 0},
                        {320, 0},
                        {320, 150},
                        {120, 150},
                        {120, -120},
                        {250, -120},
                        {250, 3.1},
                        {0, 3.1}},
                       false),
               false);
}

/// Of what is lower than the mirrors of cars.
GroundBox BoxOf(const Mesh& mesh, const Placement& placement) {
  Eigen::Vector2f half = Eigen::Vector2f::Zero();
  for (const Eigen::Vector3f& v : mesh.vertices) {
    if (v.z() < 0.8f) half = half.cwiseMax(v.head<2>().cwiseAbs());
  }
  return {placement.position_in_enu.head<2>(), placement.heading_rad, half.x(), half.y()};
}

/// A drive through traffic, and all of it at all frames.
struct Scenery {
  Scenery(const Route& route_in, std::vector<EgoState> ego_in, TrafficDensity density,
          const RoadProfile& profile_in = kTown, uint64_t seed = 1)
      : route(route_in), ego(std::move(ego_in)), profile(profile_in), world(TownAlong(route)) {
    if (profile.speed_mps > 20) world->parking.clear();
    const std::clock_t start = std::clock();
    traffic = std::make_unique<Traffic>(world, route, profile, density, seed, ego, kFirstModel);
    cpu_s = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
    for (size_t i = 0; i < ego.size(); ++i) frames.push_back(traffic->At(i));
  }
  const Mesh& MeshOf(const Placement& placement) const {
    return traffic->models()[placement.model_idx - kFirstModel];
  }
  GroundBox Box(const Placement& placement) const {
    const uint32_t idx = placement.model_idx;
    if (!half_sizes.contains(idx)) {
      const GroundBox box = BoxOf(MeshOf(placement), {});
      half_sizes[idx] = {box.half_length_m, box.half_width_m};
    }
    const Eigen::Vector2d& half = half_sizes[idx];
    return {placement.position_in_enu.head<2>(), placement.heading_rad, half.x(), half.y()};
  }
  GroundBox EgoBox(size_t frame) const {
    const RoutePoint at = route.At(ego[frame].along_m, ego[frame].left_m);
    const bool reverse = ego.back().along_m < ego.front().along_m;
    return {at.position_in_enu, at.heading_rad + (reverse ? M_PI : 0), 2.2, 0.9};
  }

  static constexpr uint32_t kFirstModel = 40;
  Route route;
  std::vector<EgoState> ego;
  RoadProfile profile;
  std::shared_ptr<World> world;
  std::unique_ptr<Traffic> traffic;
  double cpu_s = 0;
  std::vector<std::vector<Placement>> frames;
  mutable std::map<uint32_t, Eigen::Vector2d> half_sizes;
};

constexpr TrafficDensity kParked = TrafficDensity::kParked, kMoving = TrafficDensity::kMoving,
                         kDense = TrafficDensity::kDense;

bool IsMoving(const Placement& placement) {
  return placement.mobility == PlacementMobility::kMoving;
}

/// What a test looks at in all frames of a drive.
struct Case {
  const char* name;
  Scenery (*make)();
};
const Case kCases[] = {
    {"stop",
     [] {
       const Route route = Straight(1500);
       return Scenery(route, Drive(route, 10, 0, false, Stop{600, 20}), kDense);
     }},
    {"reverse", [] { return Scenery(Curvy(), Drive(Curvy(), 10, 3.1, true), kDense); }},
    {"block", [] { return Scenery(Block(), Drive(Block(), 9, 0, false, {}, 1.5), kDense); }},
    {"loop", [] { return Scenery(Loop(), Drive(Loop(), 9), kDense); }},
    {"freeway",
     [] { return Scenery(Straight(3000), Drive(Straight(3000), 27), kDense, kFreeway); }},
};

std::string NameOf(const testing::TestParamInfo<Case>& of) { return of.param.name; }

class TrafficOnRoutes : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Cases, TrafficOnRoutes, testing::ValuesIn(kCases), NameOf);

/// How one moved between frames.
struct Step {
  Placement at;
  double speed_mps = 0, acceleration = 0;
};

void ExpectPlausible(const Scenery& scenery, const Step& before, Step& now, bool is_first_speed) {
  const Eigen::Vector3d moved = now.at.position_in_enu - before.at.position_in_enu;
  now.speed_mps = moved.norm() / kFrameS;
  ASSERT_LT(now.speed_mps, 1.4 * scenery.profile.speed_mps);
  const double turned = std::remainder(now.at.heading_rad - before.at.heading_rad, 2 * M_PI);
  const bool on_foot = scenery.Box(now.at).half_length_m < 0.6;
  ASSERT_LT(std::abs(turned), on_foot ? 0.4 : 0.02 + 0.35 * now.speed_mps * kFrameS);
  if (is_first_speed || scenery.Box(now.at).half_width_m < 0.5) return;
  now.acceleration = (now.speed_mps - before.speed_mps) / kFrameS;
  ASSERT_GT(now.acceleration, -6);
  ASSERT_LT(now.acceleration, 4);
}

TEST_P(TrafficOnRoutes, NobodyRunsIntoAnybodyNorJumps) {
  const Scenery scenery = GetParam().make();
  std::map<uint16_t, Step> before;
  size_t braking = 0, samples = 0;
  for (size_t frame = 0; frame < scenery.frames.size(); ++frame) {
    SCOPED_TRACE(frame);
    std::vector<GroundBox> boxes{scenery.EgoBox(frame)};
    std::map<uint16_t, Step> now;
    for (const Placement& placement : scenery.frames[frame]) {
      const GroundBox box = scenery.Box(placement);
      for (const GroundBox& other : boxes) {
        ASSERT_FALSE(Overlap(box, other)) << box.centre_in_enu.transpose();
      }
      boxes.push_back(box);
      ASSERT_GT(placement.instance, 0);
      Step step{placement};
      if (const auto last = before.find(placement.instance); last != before.end()) {
        ExpectPlausible(scenery, last->second, step, last->second.speed_mps == 0);
        ++samples;
        if (step.acceleration < -4) ++braking;
      }
      ASSERT_TRUE(now.emplace(placement.instance, step).second) << "instance given twice";
    }
    before = std::move(now);
  }
  EXPECT_GT(samples, 10000);
  EXPECT_LT(static_cast<double>(braking), 1e-3 * static_cast<double>(samples));
}

TEST(Traffic, ComesAndGoesFarAway) {
  const Route route = Straight(1200);
  const Scenery scenery(route, Drive(route, 10, 0, false, Stop{500, 15}), kDense);
  for (size_t frame = 1; frame < scenery.frames.size(); ++frame) {
    for (const auto& [from, to] : {std::pair(frame - 1, frame), std::pair(frame, frame - 1)}) {
      std::set<uint16_t> known;
      for (const Placement& placement : scenery.frames[from]) known.insert(placement.instance);
      for (const Placement& placement : scenery.frames[to]) {
        if (known.contains(placement.instance)) continue;
        const Eigen::Vector2d ego = scenery.EgoBox(to).centre_in_enu;
        EXPECT_GT((placement.position_in_enu.head<2>() - ego).norm(), 140) << frame;
      }
    }
  }
}

TEST(Traffic, IsBuiltInTime) {
  const Route route = Straight(2500);
  EXPECT_LT(Scenery(route, Drive(route, 10), kDense).cpu_s, 10) << "0.5 s, longer with sanitizers";
}

TEST(Traffic, NoneAndParked) {
  const Route route = Straight(300);
  EXPECT_THAT(Scenery(route, Drive(route, 10), TrafficDensity::kNone).frames,
              testing::Each(testing::IsEmpty()));
  const Scenery parked(route, Drive(route, 10), kParked);
  EXPECT_GT(parked.frames[0].size(), 20);
  for (const auto& frame : parked.frames) {
    for (const Placement& placement : frame)
      EXPECT_EQ(placement.mobility, PlacementMobility::kParked);
  }
}

size_t ParkedIn(const Scenery& scenery) {
  std::set<uint16_t> instances;
  for (const auto& frame : scenery.frames) {
    for (const Placement& placement : frame) {
      if (!IsMoving(placement)) instances.insert(placement.instance);
    }
  }
  return instances.size();
}

TEST(Traffic, ParkedOnesFillMostPlacesAndChangeWithTheSeed) {
  const Route route = Straight(900);
  const Scenery one(route, Drive(route, 10), kParked, kTown, 1);
  const Scenery two(route, Drive(route, 10), kParked, kTown, 2);
  const Scenery dense(route, Drive(route, 10), kDense);
  const auto places = static_cast<double>(one.world->parking.size());
  EXPECT_NEAR(static_cast<double>(ParkedIn(one)) / places, 0.7, 0.07);
  EXPECT_NEAR(static_cast<double>(ParkedIn(dense)) / places, 0.88, 0.07);

  size_t same = 0;
  for (const Placement& a : one.frames[0]) {
    for (const Placement& b : two.frames[0]) {
      if ((a.position_in_enu - b.position_in_enu).norm() < 1 && a.model_idx == b.model_idx &&
          std::abs(a.shade - b.shade) < 0.05) {
        ++same;
      }
    }
  }
  EXPECT_LT(static_cast<double>(same), 0.2 * static_cast<double>(one.frames[0].size()));
}

TEST(Traffic, StandsOnTheGroundAndTiltsWithIt) {
  const Scenery scenery(Curvy(), Drive(Curvy(), 10), kMoving);
  for (const Placement& placement : scenery.frames[300]) {
    const double slope = 0.03 * std::cos(placement.heading_rad);
    const bool on_foot = scenery.Box(placement).half_length_m < 0.6;
    EXPECT_NEAR(placement.position_in_enu.z(),
                0.03 * placement.position_in_enu.x() + (on_foot ? kSidewalkHeightM : 0), 0.02);
    if (!IsMoving(placement)) continue;
    EXPECT_NEAR(placement.pitch_rad, slope, 1e-3);
  }
}

/// In a straight street, whichever way ego drives.
void ExpectRightHandTraffic(const Scenery& scenery) {
  const double oncoming_m = kTown.lane_width_m;
  std::array<size_t, 2> in_lanes{}, riding{}, walking{};
  for (const auto& frame : scenery.frames) {
    for (const Placement& placement : frame) {
      if (!IsMoving(placement)) continue;
      const bool back = std::abs(std::remainder(placement.heading_rad, 2 * M_PI)) > M_PI / 2;
      const double left_m = placement.position_in_enu.y();
      const GroundBox box = scenery.Box(placement);
      if (box.half_length_m < 0.6) {
        const auto cover = scenery.world->ground->CoverAt(
            placement.position_in_enu.head<2>().cast<float>(), {0.1f, 0.1f});
        EXPECT_EQ(cover.label, SemanticClass::kSidewalk);
        ++walking[left_m > 0];
      } else if (std::abs(left_m - (back ? oncoming_m : 0)) < 0.01) {
        ++in_lanes[back];
      } else {
        EXPECT_NEAR(left_m, back ? oncoming_m + 1.47 : -1.47, 0.16);
        EXPECT_LT(box.half_width_m, 0.45) << "only cyclists ride beside the lane";
        ++riding[back];
      }
    }
  }
  EXPECT_THAT(in_lanes, testing::Each(testing::Gt(500)));
  EXPECT_THAT(riding, testing::Each(testing::Gt(20)));
  EXPECT_THAT(walking, testing::Each(testing::Gt(500)));
}

TEST(Traffic, KeepsToTheRight) {
  const Route route = Straight(1000);
  ExpectRightHandTraffic(Scenery(route, Drive(route, 10), kDense));
  ExpectRightHandTraffic(Scenery(route, Drive(route, 10, kTown.lane_width_m, true), kDense));
}

/// From the front of ego to the rear of the nearest one ahead in its lane, wider than a motorcycle.
std::optional<double> GapAhead(const Scenery& scenery, size_t frame) {
  const GroundBox ego = scenery.EgoBox(frame);
  const Eigen::Vector2d forward = ego.Forward(), left(-forward.y(), forward.x());
  std::optional<double> gap;
  for (const Placement& placement : scenery.frames[frame]) {
    const GroundBox box = scenery.Box(placement);
    const Eigen::Vector2d v = box.centre_in_enu - ego.centre_in_enu;
    if (!IsMoving(placement) || box.half_width_m < 0.8 || std::abs(v.dot(left)) > 1) continue;
    if (v.dot(forward) < 0) continue;
    const double gap_m = v.dot(forward) - ego.half_length_m - box.half_length_m;
    gap = std::min(gap.value_or(gap_m), gap_m);
  }
  return gap;
}

/// Of the frames of a drive.
double ShareNear(TrafficDensity density, uint64_t seed) {
  const Scenery scenery(Straight(1500), Drive(Straight(1500), 10), density, kTown, seed);
  double near = 0;
  for (size_t i = 0; i < scenery.frames.size(); ++i) {
    if (GapAhead(scenery, i).value_or(1e9) < 16) ++near;
  }
  return near / static_cast<double>(scenery.frames.size());
}

TEST(Traffic, WhereItIsDenseSomeoneDrivesCloseAhead) {
  double sum = 0;
  for (const uint64_t seed : {1, 2}) {
    const double share = ShareNear(kDense, seed);
    EXPECT_GT(share, 0.15);
    EXPECT_LT(share, 0.95) << "at times the view is free";
    sum += share;
  }
  EXPECT_GT(sum / 2, 0.3);
  EXPECT_LT(ShareNear(kMoving, 1), 0.1);
}

/// 10 m/s, standing at 300 m for 20 s, as along the route as against it.
std::vector<EgoState> HaltingDrive(int direction) {
  std::vector<EgoState> ego;
  double progress_m = 0, waited_s = 0;
  while (progress_m < 600) {
    const double to_stop_m = std::abs(300 - progress_m);
    double v = std::min(10.0, std::sqrt(2 * to_stop_m + 0.04));
    if (to_stop_m < 0.05 && waited_s < 20) v = 0, waited_s += EgoTrack::kStepS;
    const double along_m = direction > 0 ? progress_m : 600 - progress_m;
    ego.push_back(
        {EgoTrack::kStepS * static_cast<double>(ego.size()), along_m, 1.0 * direction, v});
    progress_m += v * EgoTrack::kStepS;
  }
  return ego;
}

TEST(Leaders, KeepAheadOfEgoAndStopBeforeIt) {
  const Route route({{0, 0}, {600, 0}}, /*closed=*/false);
  const Fleet fleet;
  const KindWeight bus[] = {{"bus", 1}}, saloon[] = {{"saloon", 1}};
  const LeaderOptions options{.first = bus,
                              .others = saloon,
                              .min_gap_m = 8,
                              .max_gap_m = 12,
                              .min_near_s = 1000,
                              .max_near_s = 1000};
  for (const int direction : {1, -1}) {
    const EgoTrack ego(route, HaltingDrive(direction));
    ASSERT_EQ(ego.direction(), direction);
    EXPECT_NEAR(ego.cruise_mps(), 10, 0.1);
    const auto courses = SimulateLeaders(route, ego, fleet, options, HashSequence(3));
    ASSERT_FALSE(courses.empty());
    const Course& nearest = courses.front();
    ASSERT_EQ(nearest.places.size(), ego.instants().size()) << "near all the time";
    const double half_m = fleet.bodies()[nearest.body].length_m / 2 + EgoTrack::kLengthM / 2;
    double standing_s = 0;
    for (size_t step = 0; step + 1 < nearest.places.size(); ++step) {
      const double along_m = nearest.places[step].along_m;
      const double gap_m = direction * along_m - ego.instants()[step].progress_m - half_m;
      EXPECT_GT(gap_m, 1);
      EXPECT_LT(gap_m, 35);
      EXPECT_EQ(nearest.places[step].left_m, direction) << "as far to the left as ego";
      const double moved_m = direction * (nearest.places[step + 1].along_m - along_m);
      EXPECT_GE(moved_m, 0);
      if (moved_m < 0.01) standing_s += EgoTrack::kStepS;
    }
    EXPECT_GT(standing_s, 8);
    EXPECT_LT(standing_s, 21);
  }
}

TEST(Traffic, OnTheFreewaySomeOvertakeAndSomeAreOvertaken) {
  const Scenery scenery(Straight(4000), Drive(Straight(4000), 27), kMoving, kFreeway);
  std::map<uint16_t, double> before;
  size_t overtake = 0, overtaken = 0, oncoming = 0;
  for (size_t frame = 0; frame < scenery.frames.size(); ++frame) {
    std::map<uint16_t, double> now;
    for (const Placement& placement : scenery.frames[frame]) {
      if (std::cos(placement.heading_rad) < 0) {
        ++oncoming;
        EXPECT_GT(placement.position_in_enu.y(), 3.5 * kFreeway.lane_width_m);
        continue;
      }
      EXPECT_LT(placement.position_in_enu.y(), 2.5 * kFreeway.lane_width_m);
      const double ahead_m = placement.position_in_enu.x() - scenery.ego[frame].along_m;
      if (const auto last = before.find(placement.instance); last != before.end()) {
        if (last->second < 0 && ahead_m >= 0) ++overtake;
        if (last->second >= 0 && ahead_m < 0) ++overtaken;
      }
      now[placement.instance] = ahead_m;
    }
    before = std::move(now);
  }
  EXPECT_GT(overtake, 1);
  EXPECT_GT(overtaken, 1);
  EXPECT_GT(oncoming, 1000);
}

bool SamePlacements(const std::vector<Placement>& a, const std::vector<Placement>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const auto& x, const auto& y) {
    return x.model_idx == y.model_idx && x.position_in_enu == y.position_in_enu &&
           x.heading_rad == y.heading_rad && x.pitch_rad == y.pitch_rad && x.shade == y.shade &&
           x.texture_seed == y.texture_seed && x.instance == y.instance;
  });
}

TEST(Traffic, FollowsFromTheSeedWhateverTheOrderOfFrames) {
  const auto ego = Drive(Curvy(), 10);
  const Scenery one(Curvy(), ego, kDense), same(Curvy(), ego, kDense),
      other(Curvy(), ego, kDense, kTown, 2);
  for (size_t frame = one.frames.size(); frame-- > 0;) {
    ASSERT_TRUE(SamePlacements(one.traffic->At(frame), same.frames[frame])) << frame;
  }
  EXPECT_FALSE(SamePlacements(one.frames[100], other.frames[100]));
}

TEST(Traffic, OneKeepsItsLooksButForItsStride) {
  const Scenery scenery(Curvy(), Drive(Curvy(), 10), kDense);
  std::map<uint16_t, Placement> first;
  std::map<uint16_t, std::set<uint32_t>> models;
  for (const auto& frame : scenery.frames) {
    for (const Placement& placement : frame) {
      const Placement& known = first.emplace(placement.instance, placement).first->second;
      EXPECT_EQ(known.shade, placement.shade);
      EXPECT_EQ(known.texture_seed, placement.texture_seed);
      EXPECT_EQ(known.mobility, placement.mobility);
      models[placement.instance].insert(placement.model_idx);
    }
  }
  size_t walking = 0;
  for (const auto& [instance, used] : models) {
    const bool is_large = scenery.Box(first[instance]).half_width_m > 0.6;
    EXPECT_TRUE(!is_large || used.size() == 1);
    if (used.size() > 2) ++walking;
  }
  EXPECT_GT(walking, 20);
}

TEST(Traffic, QueuesBeforeAClosedLane) {
  const Route route = Straight(800);
  const auto ego = Drive(route, 10);
  const auto world = TownAlong(route);
  world->parking.clear();
  MeshBuilder barrier;
  barrier.Box({-0.2f, -1.2f, 0}, {0.2f, 1.2f, 1}, barrier.Use({}));
  world->models.push_back(std::move(barrier).Build());
  const GroundBox closed{{400, kTown.lane_width_m}, 0, 0.2, 1.2};
  WorldObject object;
  object.placement.position_in_enu << closed.centre_in_enu, 0;
  world->objects.push_back(object);
  const Traffic traffic(world, route, kTown, kDense, 1, ego, 1);
  size_t waiting = 0;
  for (size_t frame = 0; frame < ego.size(); ++frame) {
    for (const Placement& placement : traffic.At(frame)) {
      const GroundBox box = BoxOf(traffic.models()[placement.model_idx - 1], placement);
      ASSERT_FALSE(Overlap(box, closed)) << frame;
      const Eigen::Vector2d v = placement.position_in_enu.head<2>() - closed.centre_in_enu;
      if (std::abs(v.y()) < 0.5 && v.x() > 0 && v.x() < 12) ++waiting;
    }
  }
  EXPECT_GT(waiting, 50);
}

}  // namespace
}  // namespace carmap
