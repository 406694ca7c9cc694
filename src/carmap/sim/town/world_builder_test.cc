#include "carmap/sim/town/world_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <unordered_set>

#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/road_network.h"
#include "carmap/sim/road/route_shapes.h"
#include "carmap/sim/town/ground_mesh.h"
#include "carmap/sim/town/site.h"

namespace carmap {
namespace {

constexpr Scene kScenes[] = {Scene::kSuburb, Scene::kDowntown, Scene::kFreeway};

std::string_view KindOf(const WorldObject& object) {
  return std::string_view(object.name).substr(0, object.name.rfind('-'));
}

/// Squares of the plane that something stands in, higher than a kerb and lower than `below_m`.
class Obstacles {
 public:
  Obstacles(const World& world, double below_m) : below_m_(below_m) {
    for (const Placement& tile : world.tiles) Add(world, tile);
    for (const WorldObject& object : world.objects) {
      const Eigen::Vector2d p = object.placement.position_in_enu.head<2>();
      if (world.ground->CarriagewayDistance(p) < 20) Add(world, object.placement);
    }
  }
  bool At(const Eigen::Vector2d& p) const { return squares_.count(Key(p)) > 0; }

 private:
  static constexpr double kSquareM = 0.4, kLowM = 0.3;

  static int64_t Key(const Eigen::Vector2d& p) {
    return (static_cast<int64_t>(std::floor(p.x() / kSquareM)) << 32) +
           static_cast<int64_t>(std::floor(p.y() / kSquareM));
  }
  void Add(const World& world, const Placement& placement) {
    const Mesh& mesh = world.models[placement.model_idx];
    const double c = std::cos(placement.heading_rad), s = std::sin(placement.heading_rad);
    for (const Eigen::Vector3f& vertex : mesh.vertices) {
      const Eigen::Vector3d v = placement.scale * vertex.cast<double>();
      const Eigen::Vector3d p =
          placement.position_in_enu +
          Eigen::Vector3d(c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z());
      const double above_m = p.z() - world.ground->HeightAt(p.head<2>());
      if (above_m > kLowM && above_m < below_m_) squares_.insert(Key(p.head<2>()));
    }
  }

  double below_m_;
  std::unordered_set<int64_t> squares_;
};

TEST(BuildWorld, NothingStandsOnTheLanes) {
  for (const Scene scene : kScenes) {
    const Route route = MakeRoute(RouteShape::kCurves, scene, 400, 21);
    const World world = BuildWorld(scene, route, {}, 21);
    const RoadProfile profile = ProfileOf(scene);
    const Obstacles obstacles(world, 2.6);
    for (double s = 0; s < route.length_m(); s += 0.3) {
      for (int lane = profile.first_lane; lane <= profile.last_oncoming; ++lane) {
        const bool driven = lane <= profile.last_lane || lane >= profile.first_oncoming;
        if (!driven) continue;
        for (const double aside_m : {-0.9, -0.45, 0.0, 0.45, 0.9}) {
          const Eigen::Vector2d p =
              route.At(s, lane * profile.lane_width_m + aside_m).position_in_enu;
          ASSERT_FALSE(obstacles.At(p))
              << "scene " << static_cast<int>(scene) << ", " << s << " m, lane " << lane;
        }
      }
    }
    for (const WorldObject& object : world.objects) {
      if (KindOf(object) == "gantry" || KindOf(object) == "concrete-barrier") continue;
      EXPECT_GT(world.ground->CarriagewayDistance(object.placement.position_in_enu.head<2>()), 0.1)
          << object.name;
    }
  }
}

TEST(BuildWorld, ParkedCarsHaveRoomAndLeaveTheRouteFree) {
  for (const Scene scene : {Scene::kSuburb, Scene::kDowntown}) {
    const Route route = MakeRoute(RouteShape::kCurves, scene, 400, 22);
    const World world = BuildWorld(scene, route, {}, 22);
    EXPECT_GT(world.parking.size(), 60u);
    const Obstacles obstacles(world, 1.5);
    Occupancy swath;
    for (double s = 0; s < route.length_m(); s += 1) {
      const RoutePoint at = route.At(s);
      swath.Add({at.position_in_enu, at.heading_rad, 1, 1.1});
    }
    for (const ParkingPlace& place : world.parking) {
      const GroundBox car{place.position_in_enu.head<2>(), place.heading_rad, 2.2, 0.85};
      EXPECT_TRUE(swath.IsFree(car));
      for (const double forward : {-1.0, -0.5, 0.0, 0.5, 1.0}) {
        for (const double left : {-1.0, 0.0, 1.0}) {
          EXPECT_FALSE(obstacles.At(car.At(forward, left))) << place.position_in_enu.transpose();
        }
      }
    }
  }
}

TEST(BuildWorld, ObjectsHaveNamesOfTheirOwn) {
  const Route route = MakeRoute(RouteShape::kStraight, Scene::kSuburb, 300, 1);
  const World world = BuildWorld(Scene::kSuburb, route, {}, 1);
  std::set<std::string> names;
  std::set<std::string_view> kinds;
  for (const WorldObject& object : world.objects) {
    EXPECT_TRUE(names.insert(object.name).second) << object.name;
    kinds.insert(KindOf(object));
    EXPECT_GE(object.placement.model_idx, world.tiles.size());
    EXPECT_LT(object.placement.model_idx, world.models.size());
  }
  for (const char* kind : {"tree", "bush", "hedge", "lamp", "traffic-sign", "electric-box"}) {
    EXPECT_TRUE(kinds.count(kind) > 0) << kind;
  }
}

TEST(BuildWorld, FollowsFromItsArguments) {
  for (const Scene scene : kScenes) {
    const auto build = [&](uint64_t seed) {
      return BuildWorld(scene, MakeRoute(RouteShape::kCurves, scene, 250, 4), {}, seed);
    };
    const World a = build(4), b = build(4), other = build(5);
    ASSERT_EQ(a.objects.size(), b.objects.size());
    for (size_t i = 0; i < a.objects.size(); ++i) {
      EXPECT_EQ(a.objects[i].name, b.objects[i].name);
      EXPECT_EQ(a.objects[i].placement.position_in_enu, b.objects[i].placement.position_in_enu);
      EXPECT_EQ(a.objects[i].placement.texture_seed, b.objects[i].placement.texture_seed);
    }
    ASSERT_EQ(a.models.size(), b.models.size());
    for (size_t i = 0; i < a.models.size(); ++i) {
      EXPECT_EQ(a.models[i].vertices, b.models[i].vertices);
      EXPECT_EQ(a.models[i].triangles, b.models[i].triangles);
    }
    EXPECT_NE(a.objects.size(), other.objects.size());
  }
}

TEST(BuildWorld, KerbsRunAlongTheEdgeOfAllCarriageways) {
  const Route route = MakeRoute(RouteShape::kBlock, Scene::kDowntown, 500, 3);
  const Site site(Scene::kDowntown, route, {}, 3);
  double length_m = 0;
  int pieces = 0, exact = 0;
  for (const auto& contour : CarriagewayEdges(site.ground())) {
    for (size_t i = 0; i < contour.size(); ++i) {
      const Eigen::Vector2d& a = contour[i];
      const Eigen::Vector2d& b = contour[(i + 1) % contour.size()];
      length_m += (b - a).norm();
      EXPECT_LT((b - a).norm(), 5.1);
      const Eigen::Vector2d left(-(b - a).y(), (b - a).x());
      const double off_m = std::abs(site.ground().CarriagewayDistance((a + b) / 2));
      EXPECT_LT(off_m, 0.2);  // where three roads meet, the edge has kinks
      exact += off_m < 0.02 ? 1 : 0;
      ++pieces;
      if ((b - a).norm() < 0.3) continue;
      EXPECT_LT(site.ground().CarriagewayDistance((a + b) / 2 + 0.3 * left.normalized()), -0.2);
    }
  }
  EXPECT_GT(exact, 0.98 * pieces);
  EXPECT_GT(length_m, 2 * route.length_m());
}

/// Real paths: streets driven twice, crossings, gardens between.
TEST(BuildWorld, CarriesRecordedPaths) {
  const char* from_environment = std::getenv("CARMAP_DATA");
  const std::filesystem::path folder =
      std::filesystem::path(from_environment != nullptr ? from_environment : CARMAP_DATA_DIR) /
      "kitti_poses" / "poses";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there; set CARMAP_DATA";
  for (const char* name : {"00.txt", "05.txt", "06.txt", "07.txt"}) {
    const auto poses = ReadTrajectory(folder / name);
    ASSERT_TRUE(poses.ok()) << poses.status();
    const auto path = RouteAlong(*poses);
    ASSERT_TRUE(path.ok()) << name << ": " << path.status();
    const Site site(Scene::kSuburb, path->route, path->positions_in_enu, 1);
    for (double s = 0; s < path->route.length_m(); s += 0.5) {
      ASSERT_LT(site.ground().CarriagewayDistance(path->route.At(s).position_in_enu), -0.9)
          << name << " at " << s;
    }
    for (const Eigen::Vector3d& p : path->positions_in_enu) {
      ASSERT_NEAR(site.ground().HeightAt(p.head<2>()), p.z(), 4) << name;
    }
  }
}

}  // namespace
}  // namespace carmap
