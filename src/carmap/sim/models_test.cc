#include "carmap/sim/models.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <set>
#include <string>

#include "carmap/sim/mesh_builder.h"
#include "carmap/sim/mesh_testing.h"

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
      {"hedge", 3500},  {"lorry", 2500},   {"bus", 2500},        {"hatchback", 1700},
      {"saloon", 1700}, {"estate", 1700},  {"suv", 1700},        {"van", 1700},
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
  expect(MakeProp("hedge", 0), 2, 0.8, 1.3);
  expect(MakeProp("wire-fence", 0), 2, 0.06, 1.2);
  expect(MakeProp("guard-rail", 0), 4, 0.25, 0.75);
  expect(MakeProp("sound-wall", 1), 4, 0.28, 4.1);
  expect(MakeProp("concrete-barrier", 0), 4, 0.6, 0.82);
  expect(MakeProp("scaffolding", 0), 6, 0.9, 7.1);
  expect(MakeProp("container", 0), 6, 2.5, 2.6);
  expect(MakeProp("cone", 0), 0.4, 0.4, 0.75);
  EXPECT_GT(MakeProp("gantry", 0).width_m, 4 * 3.7);
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
