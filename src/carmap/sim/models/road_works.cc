// What builders leave at the roadside.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

Mesh Cone(uint32_t variant) {
  MeshBuilder b;
  const float height_m = variant == 0 ? 0.75f : 0.5f, scale = height_m / 0.75f;
  const SurfaceIdx red = b.Use(Painted(0.25f, kUnlabelled)),
                   white = b.Use(Painted(0.8f, kUnlabelled));
  const SurfaceIdx foot =
      b.Use({Pattern::kRubber, variant == 0 ? 0.06f : 0.25f, 1, 0, kUnlabelled});
  b.Box({-0.2f * scale, -0.2f * scale, 0}, {0.2f * scale, 0.2f * scale, 0.04f}, foot);
  std::vector<Points3> rings;
  for (const float share : {0.04f, 0.32f, 0.5f, 0.66f, 0.82f, 1.f}) {
    const float radius = scale * (0.15f - 0.115f * share);
    rings.push_back(Circle({0, 0, share * height_m}, Vector3f::UnitZ(), radius, 14));
  }
  b.Loft(rings, /*closed=*/true, [&](size_t ring, size_t) { return ring % 2 ? white : red; });
  b.Polygon(rings.back(), red);
  return std::move(b).Build();
}

/// Slanting stripes on a board in the plane x = `x` that looks to -x (`front` > 0) or to +x, from
/// (-half_m, low) to (half_m, top), every other one `light`.
void AddStripes(MeshBuilder& b, float x, float half_m, float low, float top, float pitch_m,
                float front, SurfaceIdx dark, SurfaceIdx light) {
  const float height_m = top - low;
  const auto quad = [&](float from, float to, float slant, SurfaceIdx surface) {
    const auto at = [&](float u, float z) {
      return Vector3f(x, -front * std::clamp(u, -half_m, half_m), z);
    };
    b.Quad(at(from, low), at(to, low), at(to + slant, top), at(from + slant, top), surface);
  };
  // The board in the dark colour, stripes a little before it.
  quad(-half_m, half_m, 0, dark);
  x -= 0.002f * front;
  for (float u = -half_m; u < half_m - 0.01f; u += 2 * pitch_m)
    quad(u, u + pitch_m, height_m, light);
}

/// A striped beacon on its foot, as they stand in rows.
void AddBeacon(MeshBuilder& b) {
  const SurfaceIdx red = b.Use({Pattern::kPlain, 0.2f, 1, 0, kTrafficSign});
  const SurfaceIdx white = b.Use({Pattern::kPlain, 0.8f, 1, 0, kTrafficSign});
  b.Box({-0.4f, -0.2f, 0}, {0.4f, 0.2f, 0.12f},
        b.Use({Pattern::kRubber, 0.07f, 1, 0, kUnlabelled}));
  for (const float front : {1.f, -1.f}) {
    for (int i = 0; i < 6; ++i) {  // stripes rise towards the traffic's side
      const float z = 0.2f + 0.17f * static_cast<float>(i), x = -0.021f * front;
      const SurfaceIdx surface = i % 2 ? white : red;
      b.Quad({x, front * 0.125f, z - 0.04f}, {x, front * -0.125f, z + 0.04f},
             {x, front * -0.125f, z + 0.21f}, {x, front * 0.125f, z + 0.13f}, surface);
    }
  }
  b.Box({-0.02f, -0.125f, 0.12f}, {0.02f, 0.125f, 1.2f}, white);
  b.Cylinder({0, 0, 1.2f}, {0, 0, 1.25f}, 0.05f, 8, b.Use(Painted(0.1f, kUnlabelled)));
  b.Cylinder({-0.04f, 0, 1.34f}, {0.04f, 0, 1.34f}, 0.09f, 12,
             b.Use({Pattern::kPlain, 0.6f, 1, 0.2f, kUnlabelled}));
}

Mesh RoadBarrier(uint32_t variant) {
  MeshBuilder b;
  if (variant == 1) {
    AddBeacon(b);
    return std::move(b).Build();
  }
  const SurfaceIdx red = b.Use({Pattern::kPlain, 0.2f, 1, 0, kTrafficSign});
  const SurfaceIdx white = b.Use({Pattern::kPlain, 0.8f, 1, 0, kTrafficSign});
  const SurfaceIdx steel = b.Use(Steel(0.4f, kUnlabelled));
  const SurfaceIdx foot = b.Use({Pattern::kRubber, 0.07f, 1, 0, kUnlabelled});
  for (const float y : {-0.85f, 0.85f}) {
    b.Box({-0.4f, y - 0.16f, 0}, {0.4f, y + 0.16f, 0.11f}, foot);
    b.Box({-0.02f, y - 0.03f, 0.11f}, {0.02f, y + 0.03f, 1.1f}, steel);
    b.Cylinder({-0.04f, y, 1.22f}, {0.04f, y, 1.22f}, 0.09f, 12,
               b.Use({Pattern::kPlain, 0.6f, 1, 0.2f, kUnlabelled}));
  }
  const int boards = variant == 0 ? 1 : 2;
  for (int i = 0; i < boards; ++i) {
    const float top = 1.05f - 0.5f * static_cast<float>(i);
    b.Box({-0.035f, -1, top - 0.25f}, {-0.022f, 1, top}, white);
    AddStripes(b, -0.037f, 1, top - 0.25f, top, 0.2f, 1, red, white);
    AddStripes(b, -0.02f, 1, top - 0.25f, top, 0.2f, -1, red, white);
  }
  return std::move(b).Build();
}

/// Of 6 m along x, against a façade at -y: standards in two rows, ledgers, decks, braces.
Mesh Scaffolding(uint32_t variant) {
  constexpr float kLevelM = 2, kBack = -0.35f, kFront = 0.35f;
  MeshBuilder b;
  const int levels = std::array{3, 4, 5}[variant];
  const SurfaceIdx steel = b.Use(Steel(0.45f, kBuilding));
  const SurfaceIdx plank = b.Use({Pattern::kWood, 0.35f, 1, 0, kBuilding});
  const float top = kLevelM * static_cast<float>(levels) + 1.1f;
  const auto tube = [&](const Vector3f& from, const Vector3f& to) {
    b.Tube({from, to}, {0.024f, 0.024f}, 5, steel, false);
  };
  for (const float x : {-3.f, -1.f, 1.f, 3.f}) {
    for (const float y : {kBack, kFront}) {
      b.Box({x - 0.12f, y - 0.1f, -kFootingM}, {x + 0.12f, y + 0.1f, 0.03f}, plank);
      tube({x, y, 0}, {x, y, top});
    }
  }
  for (int level = 1; level <= levels; ++level) {
    const float z = kLevelM * static_cast<float>(level);
    for (const float x : {-3.f, -1.f, 1.f, 3.f}) tube({x, kBack, z}, {x, kFront, z});
    for (const float rise : {0.f, 0.5f, 1.f}) tube({-3, kFront, z + rise}, {3, kFront, z + rise});
    tube({-3, kBack, z}, {3, kBack, z});
    for (int bay = 0; bay < 3; ++bay) {
      const float x = -3 + 2 * static_cast<float>(bay);
      b.Box({x + 0.02f, kBack + 0.03f, z + 0.03f}, {x + 1.98f, kFront - 0.04f, z + 0.08f}, plank);
      b.Box({x + 0.02f, kFront - 0.03f, z + 0.06f}, {x + 1.98f, kFront, z + 0.21f}, plank);
    }
    const float from_x = level % 2 ? -3.f : 1.f;
    tube({from_x, kFront + 0.05f, z - kLevelM + 0.1f}, {from_x + 2, kFront + 0.05f, z});
    tube({level % 2 ? 3.f : -1.f, kFront + 0.05f, z - kLevelM + 0.1f},
         {level % 2 ? 1.f : -3.f, kFront + 0.05f, z});
    const float ladder_x = level % 2 ? -0.4f : 0.4f;
    for (const float y : {-0.15f, 0.15f}) {
      tube({ladder_x - 0.3f, y, z - kLevelM + 0.1f}, {ladder_x + 0.3f, y, z + 0.3f});
    }
  }
  if (variant != 0) {  // a sheet over some bays, hung with folds
    const SurfaceIdx sheet = b.Use({Pattern::kFabric, 0.5f, 1, 0, kBuilding});
    HashSequence random(0x5caf, variant);
    std::vector<Points3> rings;
    for (int row = 0; row <= 4; ++row) {
      Points3& ring = rings.emplace_back();
      for (int i = 0; i <= 12; ++i) {
        const float fold = static_cast<float>(random.Between(0, 0.1)) * (row % 4 ? 1.f : 0.3f);
        ring.emplace_back(3 - static_cast<float>(i) / 3, kFront + 0.08f + fold,
                          top - 2 - 0.9f * static_cast<float>(4 - row) + 1.9f);
      }
    }
    b.Loft(rings, /*closed=*/false, sheet);
  }
  return std::move(b).Build();
}

/// An office of the site, of corrugated metal with a door and windows.
Mesh SiteOffice() {
  MeshBuilder b;
  const SurfaceIdx metal = b.Use({Pattern::kMetal, 0.4f, 1, 0.03f, kUnlabelled});
  const SurfaceIdx frame = b.Use({Pattern::kMetal, 0.3f, 1, 0.03f, kUnlabelled});
  const SurfaceIdx glass = b.Use({Pattern::kGlass, 0.06f, 1, 0.4f, kUnlabelled});
  constexpr float kHalfX = 3, kHalfY = 1.2f, kTop = 2.6f;
  // Ribs about all four sides.
  std::vector<Vector3f> outline;
  const auto side = [&](const Vector3f& from, const Vector3f& to) {
    const Vector3f along = (to - from).normalized(), out = along.cross(Vector3f::UnitZ());
    const int ribs = static_cast<int>(std::lround((to - from).norm() / 0.3f));
    for (int i = 0; i < ribs; ++i) {
      const Vector3f at = from + (to - from) * (static_cast<float>(i) / static_cast<float>(ribs));
      for (const auto& [u, v] :
           {std::pair{0.f, 0.f}, {0.14f, 0.f}, {0.17f, -0.03f}, {0.27f, -0.03f}}) {
        outline.push_back(at + u * along + v * out);
      }
    }
  };
  side({-kHalfX, -kHalfY, 0.15f}, {kHalfX, -kHalfY, 0.15f});
  side({kHalfX, -kHalfY, 0.15f}, {kHalfX, kHalfY, 0.15f});
  side({kHalfX, kHalfY, 0.15f}, {-kHalfX, kHalfY, 0.15f});
  side({-kHalfX, kHalfY, 0.15f}, {-kHalfX, -kHalfY, 0.15f});
  Points3 top = outline;
  for (Vector3f& p : top) p.z() = kTop - 0.15f;
  b.Loft({outline, top}, /*closed=*/true, metal);
  for (const float z : {0.f, kTop - 0.15f}) {
    b.Box({-kHalfX - 0.02f, -kHalfY - 0.02f, z}, {kHalfX + 0.02f, kHalfY + 0.02f, z + 0.15f},
          frame);
  }
  for (const float x : {-kHalfX, kHalfX}) {
    for (const float y : {-kHalfY, kHalfY}) {
      b.Box({x - 0.06f, y - 0.06f, 0.15f}, {x + 0.06f, y + 0.06f, kTop - 0.15f}, frame, false);
    }
  }
  for (const float x : {-1.8f, 1.4f}) {
    b.Box({x - 0.6f, kHalfY, 1}, {x + 0.6f, kHalfY + 0.04f, 2.1f}, frame);
    b.Quad({x + 0.54f, kHalfY + 0.045f, 1.06f}, {x - 0.54f, kHalfY + 0.045f, 1.06f},
           {x - 0.54f, kHalfY + 0.045f, 2.04f}, {x + 0.54f, kHalfY + 0.045f, 2.04f}, glass);
  }
  b.Box({-0.65f, kHalfY, 0.15f}, {0.25f, kHalfY + 0.03f, 2.2f}, b.Use(Painted(0.55f, kUnlabelled)));
  b.Box({0.12f, kHalfY + 0.03f, 1.1f}, {0.18f, kHalfY + 0.09f, 1.16f},
        b.Use(Painted(0.05f, kUnlabelled)));
  return std::move(b).Build();
}

/// A skip with slanting ends, full of rubble, or a high one with ribs.
Mesh Skip(bool high) {
  MeshBuilder b;
  const SurfaceIdx metal = b.Use({Pattern::kMetal, high ? 0.2f : 0.35f, 1.5f, 0.02f, kUnlabelled});
  const float half = high ? 2.6f : 1.7f, top = high ? 2.0f : 1.3f, slant = high ? 0.1f : 0.55f,
              y = high ? 1.1f : 0.85f;
  b.Prism(
      {{-half + slant, -y, 0.06f}, {half - slant, -y, 0.06f}, {half, -y, top}, {-half, -y, top}},
      {0, 2 * y, 0}, metal, metal);
  for (const float side : {-1.f, 1.f}) {
    AddBar(b, {-half, side * y, top}, {half, side * y, top}, 0.1f, 0.1f, metal);
    AddBar(b, {side * half, -y, top}, {side * half, y, top}, 0.1f, 0.1f, metal);
    const int ribs = high ? 8 : 4;
    for (int i = 0; i < ribs; ++i) {
      const float x =
          (half - slant - 0.2f) * (2 * static_cast<float>(i) / static_cast<float>(ribs - 1) - 1);
      AddBar(b, {x, side * (y + 0.03f), 0.1f}, {x, side * (y + 0.03f), top - 0.05f}, 0.06f, 0.08f,
             metal);
    }
    b.Box({-half + slant, side * (y - 0.2f) - 0.08f, 0},
          {half - slant, side * (y - 0.2f) + 0.08f, 0.06f}, metal);
  }
  b.Quad({half * 0.35f, y + 0.075f, top * 0.45f}, {-half * 0.35f, y + 0.075f, top * 0.45f},
         {-half * 0.35f, y + 0.075f, top * 0.8f}, {half * 0.35f, y + 0.075f, top * 0.8f},
         b.Use({Pattern::kSign, 0.55f, 1, 0, kUnlabelled}));
  HashSequence random(0x5c1b, high);
  const SurfaceIdx rubble[] = {b.Use({Pattern::kConcrete, 0.4f, 1, 0, kUnlabelled}),
                               b.Use({Pattern::kBrick, 0.25f, 1, 0, kUnlabelled}),
                               b.Use({Pattern::kWood, 0.3f, 1, 0, kUnlabelled})};
  for (int i = 0; i < 30; ++i) {
    const float x = half * static_cast<float>(random.Between(-0.8, 0.8)),
                s = static_cast<float>(random.Between(0.1, 0.35));
    const float at_y = y * static_cast<float>(random.Between(-0.7, 0.7));
    b.SetFrame(FrameAt({x, at_y, top + 0.05f}, static_cast<float>(random.Between(0, 6)),
                       static_cast<float>(random.Between(-0.6, 0.6))));
    b.Box({-s, -s * 0.6f, -0.15f}, {s, s * 0.6f, 0.1f}, rubble[i % 3]);
  }
  return std::move(b).Build();
}

Mesh Container(uint32_t variant) {
  return variant == 0 ? SiteOffice() : Skip(/*high=*/variant == 2);
}

constexpr ModelKind kKinds[] = {
    {"scaffolding", 3, Scaffolding},
    {"container", 3, Container},
    {"cone", 2, Cone},
    {"road-barrier", 3, RoadBarrier},
};

}  // namespace

std::span<const ModelKind> RoadWorkKinds() { return kKinds; }

}  // namespace carmap
