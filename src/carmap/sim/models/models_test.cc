#include "carmap/sim/models/models.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>

#include "carmap/sim/mesh/mesh_builder.h"
#include "carmap/sim/mesh/mesh_testing.h"

namespace carmap {
namespace {

using enum SemanticClass;
using testing::Contains;
using testing::ElementsAre;
using testing::Not;

using Classes = std::set<SemanticClass>;

void ForEach(const std::function<void(const Model&, uint32_t variant, bool vehicle)>& check) {
  for (const std::string_view kind : PropKinds()) {
    for (uint32_t variant = 0; variant < PropVariants(kind); ++variant) {
      SCOPED_TRACE(testing::Message() << kind << " " << variant);
      check(MakeProp(kind, variant), variant, false);
    }
  }
  for (const std::string_view kind : VehicleKinds()) {
    for (uint32_t variant = 0; variant < VehicleVariants(kind); ++variant) {
      SCOPED_TRACE(testing::Message() << kind << " " << variant);
      check(MakeVehicle(kind, variant), variant, true);
    }
  }
}

Classes ClassesOf(const Mesh& mesh) {
  Classes classes;
  for (const uint16_t surface : mesh.surface_of_triangle) {
    classes.insert(mesh.surfaces[surface].label);
  }
  return classes;
}

TEST(Models, AreWellFormed) {
  ForEach([](const Model& model, uint32_t, bool) {
    EXPECT_EQ(FaultOf(model.mesh), "");
    for (size_t i = 0; i < model.mesh.triangles.size(); ++i) {
      const auto& [a, b, c] = model.mesh.triangles[i];
      const auto& v = model.mesh.vertices;
      EXPECT_GT((v[b] - v[a]).cross(v[c] - v[a]).norm(), 0) << "triangle " << i;
    }
  });
}

TEST(Models, StandOnTheGroundAndStateTheirSize) {
  ForEach([](const Model& model, uint32_t, bool vehicle) {
    const Eigen::AlignedBox3f bounds = BoundsOf(model.mesh);
    EXPECT_NEAR(model.length_m, bounds.sizes().x(), 1e-4);
    EXPECT_NEAR(model.width_m, bounds.sizes().y(), 1e-4);
    EXPECT_NEAR(model.height_m, bounds.max().z(), 1e-4);
    EXPECT_LE(bounds.min().z(), 0.011) << "hovers";
    EXPECT_GE(bounds.min().z(), vehicle ? -0.011 : -0.43) << "sinks";
    EXPECT_TRUE(bounds.contains(Eigen::Vector3f(0, 0, 0.02f))) << "the origin lies below the model";
  });
}

TEST(Models, FollowFromKindAndVariant) {
  ForEach([](const Model& model, uint32_t variant, bool vehicle) {
    const auto make = vehicle ? MakeVehicle : MakeProp;
    const uint32_t variants = vehicle ? VehicleVariants(model.kind) : PropVariants(model.kind);
    EXPECT_TRUE(SameBytes(model.mesh, make(model.kind, variant).mesh));
    EXPECT_TRUE(SameBytes(model.mesh, make(model.kind, variant + variants).mesh)) << "wraps";
    if (variants > 1) {
      EXPECT_FALSE(SameBytes(model.mesh, make(model.kind, variant + 1).mesh));
    }
  });
}

TEST(Models, KeepToTheirBudgets) {
  const std::map<std::string_view, size_t> budgets = {
      {"tree", 8000},   {"conifer", 5500}, {"young-tree", 3000}, {"bush", 4000},
      {"hedge", 4000},  {"lorry", 2500},   {"bus", 2500},        {"hatchback", 1700},
      {"saloon", 1700}, {"cyclist", 1800}, {"motorcycle", 1900}, {"estate", 1700},
      {"suv", 1700},    {"van", 1700},
  };
  ForEach([&](const Model& model, uint32_t, bool) {
    const auto budget = budgets.find(model.kind);
    EXPECT_LE(model.mesh.triangles.size(), budget == budgets.end() ? 1500 : budget->second);
  });
}

/// What each kind shows: all of `must`, besides that only `may`.
struct Labels {
  Classes must, may;
};

const std::map<std::string_view, Labels>& ExpectedLabels() {
  static const auto* const kLabels = new std::map<std::string_view, Labels>{
      {"tree", {{kVegetation}, {}}},
      {"young-tree", {{kVegetation, kPole}, {}}},
      {"conifer", {{kVegetation}, {}}},
      {"bush", {{kVegetation}, {}}},
      {"hedge", {{kVegetation}, {}}},
      {"fence", {{kFence}, {}}},
      {"wire-fence", {{kFence}, {}}},
      {"guard-rail", {{kFence}, {}}},
      {"sound-wall", {{kWall}, {}}},
      {"concrete-barrier", {{kWall}, {}}},
      {"lamp", {{kPole}, {}}},
      {"pole", {{kPole}, {}}},
      {"bollard", {{kPole}, {}}},
      {"traffic-sign", {{kTrafficSign, kPole}, {}}},
      {"street-name", {{kTrafficSign, kPole}, {}}},
      {"gantry", {{kTrafficSign, kPole}, {}}},
      {"traffic-light", {{kTrafficLight, kPole}, {}}},
      {"kiosk", {{kBuilding}, {}}},
      {"bus-stop", {{kTrafficSign, kPole}, {kBuilding}}},
      {"scaffolding", {{kBuilding}, {}}},
      // Cityscapes has no class for these: furniture and what builders leave.
      {"billboard", {{kUnlabelled}, {kPole}}},
      {"bin", {{kUnlabelled}, {kPole}}},
      {"bench", {{kUnlabelled}, {}}},
      {"mailbox", {{kUnlabelled, kPole}, {}}},
      {"planter", {{kUnlabelled, kVegetation}, {}}},
      {"electric-box", {{kUnlabelled}, {}}},
      {"advertising-column", {{kUnlabelled}, {}}},
      {"container", {{kUnlabelled}, {}}},
      {"cone", {{kUnlabelled}, {}}},
      {"road-barrier", {{kTrafficSign, kUnlabelled}, {}}},
      {"hatchback", {{kCar}, {}}},
      {"saloon", {{kCar}, {}}},
      {"estate", {{kCar}, {}}},
      {"suv", {{kCar}, {}}},
      {"van", {{kCar}, {}}},
      {"lorry", {{kTruck}, {}}},
      {"bus", {{kBus}, {}}},
      {"pedestrian", {{kPerson}, {}}},
      {"cyclist", {{kRider, kBicycle}, {}}},
      {"motorcycle", {{kRider, kMotorcycle}, {}}},
  };
  return *kLabels;
}

TEST(Models, SurfacesAreLabelled) {
  std::set<std::string_view> seen;
  ForEach([&](const Model& model, uint32_t, bool) {
    seen.insert(model.kind);
    ASSERT_THAT(ExpectedLabels(), Contains(testing::Key(model.kind)));
    const auto& [must, may] = ExpectedLabels().at(model.kind);
    const Classes classes = ClassesOf(model.mesh);
    for (const SemanticClass label : must) EXPECT_THAT(classes, Contains(label));
    for (const SemanticClass label : classes) {
      EXPECT_TRUE(must.contains(label) || may.contains(label)) << static_cast<int>(label);
    }
  });
  EXPECT_EQ(seen.size(), ExpectedLabels().size());
}

TEST(Models, SizesAreLifelike) {
  const auto expect = [](const Model& model, float length_m, float width_m, float height_m) {
    SCOPED_TRACE(model.kind);
    EXPECT_NEAR(model.length_m, length_m, 0.15 * length_m + 0.02);
    EXPECT_NEAR(model.width_m, width_m, 0.15 * width_m + 0.02);
    EXPECT_NEAR(model.height_m, height_m, 0.1 * height_m);
  };
  expect(MakeProp("fence", 0), 2, 0.1, 1);
  expect(MakeProp("hedge", 0), 2.1f, 0.95f, 1.3f);
  expect(MakeProp("wire-fence", 0), 2, 0.06, 1.2);
  expect(MakeProp("guard-rail", 0), 4, 0.25, 0.75);
  expect(MakeProp("sound-wall", 1), 4, 0.28, 4.1);
  expect(MakeProp("concrete-barrier", 0), 4, 0.6, 0.82);
  expect(MakeProp("scaffolding", 0), 6, 0.9, 7.1);
  expect(MakeProp("container", 0), 6, 2.5, 2.6);
  expect(MakeProp("cone", 0), 0.4, 0.4, 0.75);
  EXPECT_GT(MakeProp("gantry", 0).width_m, 4 * 3.7);
}

TEST(Models, VehiclesAreLifelike) {
  const auto expect = [](std::string_view kind, float length_m, float width_m, float height_m) {
    for (uint32_t variant = 0; variant < VehicleVariants(kind); ++variant) {
      SCOPED_TRACE(testing::Message() << kind << " " << variant);
      const Model model = MakeVehicle(kind, variant);
      EXPECT_NEAR(model.length_m, length_m, 0.06 * length_m);
      // With mirrors, which stand out 0.15 m on either side.
      EXPECT_NEAR(model.width_m, width_m + 0.3f, 0.15);
      EXPECT_NEAR(model.height_m, height_m, 0.06 * height_m);
    }
  };
  expect("hatchback", 4.0f, 1.74f, 1.43f);
  expect("saloon", 4.65f, 1.8f, 1.43f);
  expect("estate", 4.6f, 1.78f, 1.5f);
  expect("suv", 4.5f, 1.85f, 1.7f);
  EXPECT_NEAR(MakeVehicle("van", 0).length_m, 5.5, 0.1);
  EXPECT_NEAR(MakeVehicle("van", 0).height_m, 2.4, 0.05);
  EXPECT_NEAR(MakeVehicle("lorry", 0).length_m, 9.6, 0.1);
  EXPECT_NEAR(MakeVehicle("lorry", 0).height_m, 3.6, 0.1);
  EXPECT_NEAR(MakeVehicle("bus", 0).length_m, 12, 0.2);
  EXPECT_NEAR(MakeVehicle("bus", 0).height_m, 3.1, 0.1);
  EXPECT_NEAR(MakeVehicle("pedestrian", 0).height_m, 1.8, 0.05);
  EXPECT_NEAR(MakeVehicle("cyclist", 0).length_m, 1.75, 0.1);
}

TEST(Models, VehiclesHaveWindowsWheelsAndPlates) {
  for (const char* kind : {"hatchback", "saloon", "estate", "suv", "van", "lorry", "bus"}) {
    SCOPED_TRACE(kind);
    std::set<Pattern> patterns;
    const Mesh mesh = MakeVehicle(kind, 0).mesh;
    for (const uint16_t surface : mesh.surface_of_triangle) {
      patterns.insert(mesh.surfaces[surface].pattern);
    }
    EXPECT_THAT(patterns, testing::IsSupersetOf({Pattern::kCarPaint, Pattern::kGlass,
                                                 Pattern::kRubber, Pattern::kSign}));
  }
}

/// Distance to the triangle along a ray (Möller and Trumbore 1997), infinite beside it.
float Hit(const Eigen::Vector3f& origin, const Eigen::Vector3f& ray, const Eigen::Vector3f& a,
          const Eigen::Vector3f& b, const Eigen::Vector3f& c) {
  const Eigen::Vector3f ab = b - a, ac = c - a, p = ray.cross(ac);
  const float determinant = ab.dot(p);
  if (std::abs(determinant) < 1e-12f) return INFINITY;
  const Eigen::Vector3f to_origin = (origin - a) / determinant, q = to_origin.cross(ab);
  const float u = to_origin.dot(p), v = ray.dot(q), t = ac.dot(q);
  return u < 0 || v < 0 || u + v > 1 || t < 0 ? INFINITY : t;
}

/// Of what is seen of the mesh from all around, the share that shows its inside.
double InsideOutShare(const Mesh& mesh) {
  const Eigen::AlignedBox3f bounds = BoundsOf(mesh);
  const float radius = bounds.sizes().norm();
  HashSequence random(1);
  int hits = 0, inside_out = 0;
  for (int i = 0; i < 300; ++i) {
    const double angle = random.Between(0, 2 * M_PI), rise = random.Between(0, 0.8);
    const Eigen::Vector3f eye =
        bounds.center() +
        radius * Eigen::Vector3d(std::cos(angle), std::sin(angle), rise).cast<float>();
    Eigen::Vector3f target = bounds.min();
    for (int k = 0; k < 3; ++k) target[k] += bounds.sizes()[k] * static_cast<float>(random.Unit());
    const Eigen::Vector3f ray = (target - eye).normalized();
    float nearest = INFINITY;
    bool shows_inside = false, leaf = false;
    for (size_t t = 0; t < mesh.triangles.size(); ++t) {
      const auto& [a, b, c] = mesh.triangles[t];
      const auto& v = mesh.vertices;
      const float distance = Hit(eye, ray, v[a], v[b], v[c]);
      if (distance >= nearest) continue;
      nearest = distance;
      shows_inside = (v[b] - v[a]).cross(v[c] - v[a]).dot(ray) > 0;
      leaf = mesh.surfaces[mesh.surface_of_triangle[t]].pattern == Pattern::kLeaves;
    }
    if (nearest == INFINITY || leaf) continue;
    ++hits;
    inside_out += shows_inside;
  }
  return hits < 20 ? 0 : static_cast<double>(inside_out) / hits;
}

TEST(Models, ShowTheirOutsides) {
  ForEach([](const Model& model, uint32_t variant, bool) {
    // Sheets have no inside; with these some are seen from both sides.
    const bool sheets = model.kind == "kiosk" || model.kind == "bus-stop" ||
                        model.kind == "scaffolding" || model.kind == "guard-rail" ||
                        model.kind == "traffic-light";
    if (variant % 8 >= 4 || sheets) return;
    EXPECT_LE(InsideOutShare(model.mesh), 0.03);
  });
}

TEST(Models, WalkersAndCyclistsMove) {
  for (const char* kind : {"pedestrian", "cyclist"}) {
    SCOPED_TRACE(kind);
    const uint32_t phases = VehiclePhases(kind);
    EXPECT_EQ(phases, 8);
    EXPECT_EQ(VehicleVariants(kind) % phases, 0);
    EXPECT_GT(VehicleCycleM(kind), 1);
    for (uint32_t phase = 0; phase < phases; ++phase) {
      const Mesh now = MakeVehicle(kind, phase).mesh;
      const Mesh opposite = MakeVehicle(kind, (phase + phases / 2) % phases).mesh;
      // Half a cycle later left and right have changed places.
      EXPECT_NEAR(BoundsOf(now).max().x(), BoundsOf(opposite).max().x(), 1e-3);
      EXPECT_NEAR(BoundsOf(now).max().y(), -BoundsOf(opposite).min().y(), 0.05);
    }
  }
  const auto length = [](uint32_t phase) { return MakeVehicle("pedestrian", phase).length_m; };
  EXPECT_GT(length(2), length(0) + 0.2f) << "a full step, against legs that pass each other";
  EXPECT_EQ(VehiclePhases("bus"), 1);
  EXPECT_EQ(VehicleCycleM("bus"), 0);
}

TEST(Models, FacesOfSignsLookToWhoComesAlong) {
  for (const char* kind : {"traffic-sign", "billboard", "gantry"}) {
    SCOPED_TRACE(kind);
    const Mesh mesh = MakeProp(kind, 0).mesh;
    Eigen::Vector3f faces = Eigen::Vector3f::Zero();
    for (size_t i = 0; i < mesh.triangles.size(); ++i) {
      const Pattern pattern = mesh.surfaces[mesh.surface_of_triangle[i]].pattern;
      if (pattern != Pattern::kSign && pattern != Pattern::kPoster) continue;
      const auto& [a, b, c] = mesh.triangles[i];
      const auto& v = mesh.vertices;
      faces += (v[b] - v[a]).cross(v[c] - v[a]) / 2;
    }
    EXPECT_LT(faces.normalized().x(), -0.999);
  }
}

TEST(Models, ArmsReachOverTheRoad) {
  EXPECT_GT(BoundsOf(MakeProp("lamp", 0).mesh).max().y(), 1.5);
  EXPECT_GT(BoundsOf(MakeProp("lamp", 0).mesh).min().y(), -0.2);
  EXPECT_GT(BoundsOf(MakeProp("traffic-light", 1).mesh).max().y(), 4);
}

TEST(Models, PiecesInARowJoin) {
  for (const char* kind : {"fence", "wire-fence", "guard-rail", "sound-wall"}) {
    for (uint32_t variant = 0; variant < PropVariants(kind); ++variant) {
      SCOPED_TRACE(testing::Message() << kind << " " << variant);
      const Eigen::AlignedBox3f bounds = BoundsOf(MakeProp(kind, variant).mesh);
      EXPECT_NEAR(bounds.min().x(), -bounds.max().x(), 1e-3);
      EXPECT_NEAR(std::round(bounds.sizes().x()), bounds.sizes().x(), 0.02);
    }
  }
}

TEST(Models, UnknownKindsHaveNoVariants) {
  EXPECT_EQ(PropVariants("dragon"), 0);
  EXPECT_EQ(PropVariants("bus"), 0) << "is no prop";
  EXPECT_EQ(VehicleVariants("tree"), 0);
  EXPECT_EQ(VehicleVariants(""), 0);
  EXPECT_DEATH(MakeProp("dragon", 0), "no model of kind \"dragon\"");
}

}  // namespace
}  // namespace carmap
