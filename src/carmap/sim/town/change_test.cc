#include "carmap/sim/town/change.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "carmap/sim/models/models.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/route_shapes.h"
#include "carmap/sim/town/occupancy.h"
#include "carmap/sim/town/world_builder.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;

struct Street {
  Route route = MakeRoute(RouteShape::kStraight, Scene::kDowntown, 600, 2);
  World world = BuildWorld(Scene::kDowntown, route, {}, 2);
};
const Street& TheStreet() {
  static const auto* const kStreet = new Street;
  return *kStreet;
}

bool Has(const World& world, const std::string& name) {
  return std::any_of(world.objects.begin(), world.objects.end(),
                     [&](const WorldObject& object) { return object.name == name; });
}

TEST(DrawChanges, DrawsAsManyAsSaid) {
  const Street& street = TheStreet();
  const std::vector<Change> changes = DrawChanges(street.world, street.route, 5);
  int removed = 0, placed = 0, cones = 0;
  for (const Change& change : changes) {
    EXPECT_GT(change.size_m.minCoeff(), 0) << change.name;
    removed += change.what == Change::What::kRemoved ? 1 : 0;
    cones += change.kind == "cone" ? 1 : 0;
    placed += change.kind == "scaffolding" || change.kind == "container" ? 1 : 0;
  }
  EXPECT_GE(removed + placed, 8);
  EXPECT_LE(removed + placed, 12);
  EXPECT_GE(removed, 2);
  EXPECT_EQ(cones, 11) << "one closure of 30 m";
}

TEST(DrawChanges, FollowsFromTheSeed) {
  const Street& street = TheStreet();
  const auto draw = [&](uint64_t seed) {
    return ToJson(DrawChanges(street.world, street.route, seed)).dump();
  };
  EXPECT_EQ(draw(5), draw(5));
  EXPECT_NE(draw(5), draw(6));
}

TEST(DrawChanges, LeavesTheRouteFree) {
  for (const Scene scene : {Scene::kSuburb, Scene::kFreeway}) {
    const Route route = MakeRoute(RouteShape::kCurves, scene, 500, 8);
    const World world = BuildWorld(scene, route, {}, 8);
    for (uint64_t seed = 0; seed < 4; ++seed) {
      for (const Change& change : DrawChanges(world, route, seed)) {
        if (change.what == Change::What::kRemoved) continue;
        const GroundBox box{change.position_in_enu.head<2>(), change.heading_rad,
                            change.size_m.x() / 2, change.size_m.y() / 2};
        for (double s = 0; s < route.length_m(); s += 1) {
          const RoutePoint at = route.At(s);
          ASSERT_FALSE(Overlap(box, {at.position_in_enu, at.heading_rad, 0.6, 1.0}))
              << change.name << " at " << s;
        }
      }
    }
  }
}

TEST(ApplyChanges, TakesAwayAndAdds) {
  const Street& street = TheStreet();
  World world = street.world;
  const std::vector<Change> changes = DrawChanges(world, street.route, 9);
  ASSERT_TRUE(ApplyChanges(changes, world).ok());
  for (const Change& change : changes) {
    EXPECT_EQ(Has(street.world, change.name), change.what == Change::What::kRemoved);
    EXPECT_EQ(Has(world, change.name), change.what == Change::What::kAdded) << change.name;
  }
  for (const WorldObject& object : world.objects) {
    ASSERT_LT(object.placement.model_idx, world.models.size());
  }
  EXPECT_LT(world.parking.size(), street.world.parking.size()) << "none below a closure";
}

TEST(ApplyChanges, NamesWhatItDoesNotKnow) {
  World world = TheStreet().world;
  const size_t objects = world.objects.size();
  const absl::Status missing =
      ApplyChanges({{.what = Change::What::kRemoved, .name = "tree-99999"}}, world);
  EXPECT_EQ(missing.code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(std::string(missing.message()), HasSubstr(world.objects.front().name));
  const std::string name = world.objects.front().name;
  EXPECT_EQ(ApplyChanges({{.name = name}, {.name = name}}, world).code(),
            absl::StatusCode::kNotFound)
      << "twice";
  EXPECT_EQ(ApplyChanges({{.what = Change::What::kAdded, .kind = "castle"}}, world).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(world.objects.size(), objects) << "nothing is done by halves";
}

TEST(ChangesFromJson, ReadsWhatToJsonWrites) {
  const Street& street = TheStreet();
  const std::string text = ToJson(DrawChanges(street.world, street.route, 3)).dump(1);
  const auto changes = ChangesFromJson(text);
  ASSERT_TRUE(changes.ok()) << changes.status();
  EXPECT_EQ(ToJson(*changes).dump(1), text);
}

TEST(ChangesFromJson, FillsInWhatAnEditorLeavesOut) {
  const auto changes = ChangesFromJson(
      R"({"changes": [{"what": "removed", "name": "kiosk-00000"},
                      {"what": "added", "kind": "container", "position_in_enu": [1, 2, 0]}]})");
  ASSERT_TRUE(changes.ok()) << changes.status();
  ASSERT_EQ(changes->size(), 2u);
  EXPECT_EQ((*changes)[1].name, "new-container-00001");
  EXPECT_GT((*changes)[1].size_m.minCoeff(), 1);
  EXPECT_EQ((*changes)[1].heading_rad, 0);
}

TEST(ChangesFromJson, RefusesWhatIsNotSo) {
  const auto error_of = [](const std::string& text) {
    const auto changes = ChangesFromJson(text);
    EXPECT_EQ(changes.status().code(), absl::StatusCode::kInvalidArgument) << text;
    return std::string(changes.status().message());
  };
  const auto entry = [](const std::string& rest) {
    return R"({"changes": [{"what": "added", "kind": "cone", "position_in_enu": [0, 0, 0]}, )" +
           rest + "]}";
  };
  EXPECT_THAT(error_of(""), HasSubstr("not JSON"));
  EXPECT_THAT(error_of("[1, 2"), HasSubstr("not JSON"));
  EXPECT_THAT(error_of("[]"), HasSubstr("form"));
  EXPECT_THAT(error_of("17"), HasSubstr("form"));
  EXPECT_THAT(error_of("null"), HasSubstr("form"));
  EXPECT_THAT(error_of(R"({"changes": 3})"), HasSubstr("form"));
  EXPECT_THAT(error_of(std::string(100000, '[')), HasSubstr("not JSON"));
  EXPECT_THAT(error_of(entry("7")), HasSubstr("changes[1]"));
  EXPECT_THAT(error_of(entry(R"({"what": "moved"})")), HasSubstr("\"what\""));
  EXPECT_THAT(error_of(entry(R"({"what": 1})")), HasSubstr("\"what\""));
  EXPECT_THAT(error_of(entry(R"({"what": "removed"})")), HasSubstr("\"name\""));
  EXPECT_THAT(error_of(entry(R"({"what": "removed", "name": 8})")), HasSubstr("\"name\""));
  EXPECT_THAT(error_of(entry(R"({"what": "added", "kind": "castle", "position_in_enu": [0,0,0]})")),
              HasSubstr("\"kind\""));
  EXPECT_THAT(error_of(entry(R"({"what": "added", "kind": "cone"})")), HasSubstr("position"));
  for (const char* position : {"[0, 0]", "[0, 0, \"x\"]", "[0, 0, null]", "3", "[0, 0, 1e9]"}) {
    EXPECT_THAT(error_of(entry(R"({"what": "added", "kind": "cone", "position_in_enu": )" +
                               std::string(position) + "}")),
                HasSubstr("position"));
  }
  EXPECT_THAT(
      error_of(entry(R"({"what": "added", "kind": "cone", "position_in_enu": [0, 0, NaN]})")),
      HasSubstr("not JSON"));
  EXPECT_THAT(
      error_of(entry(R"({"what": "added", "kind": "cone", "position_in_enu": [0, 0, 1e999]})")),
      HasSubstr("not JSON"));
  EXPECT_THAT(error_of(entry(R"({"what": "added", "kind": "cone", "position_in_enu": [0, 0, 0],
                                 "size_m": [1, -1, 1]})")),
              HasSubstr("size_m"));
  EXPECT_THAT(error_of(entry(R"({"what": "added", "kind": "cone", "position_in_enu": [0, 0, 0],
                                 "heading_rad": "north"})")),
              HasSubstr("heading_rad"));
  std::string many = R"({"changes": [)";
  for (int i = 0; i < 20001; ++i) many += "0,";
  EXPECT_THAT(error_of(many + "0]}"), HasSubstr("at most"));
}

}  // namespace
}  // namespace carmap
