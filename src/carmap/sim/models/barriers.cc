// Fences, walls and rails: pieces that are put in a row along x, ending where the next begins.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

/// A picket seen from +y, with a pointed, rounded or flat head.
void AddPicket(MeshBuilder& b, float x, float width_m, float low, float top, float head_m,
               SurfaceIdx wood) {
  const float y = 0.025f, half = width_m / 2;
  Points3 outline = {{x + half, y, low}, {x - half, y, low}, {x - half, y, top - head_m}};
  if (head_m > 0) outline.emplace_back(x, y, top);
  outline.emplace_back(x + half, y, top - head_m);
  b.Prism(outline, {0, 0.022f, 0}, wood, wood);
}

/// Of 2 m: pickets, boards or iron bars between a post in the middle and those of the neighbours.
Mesh Fence(uint32_t variant) {
  MeshBuilder b;
  HashSequence random(0xfe7ce, variant);
  const float albedo = std::array{0.7f, 0.25f, 0.3f, 0.06f}[variant];
  const SurfaceIdx wood =
      variant == 3 ? b.Use(Steel(albedo, kFence)) : b.Use({Pattern::kWood, albedo, 1, 0, kFence});
  const float height_m = std::array{1.0f, 1.7f, 1.1f, 1.3f}[variant];
  b.Box({-0.05f, -0.06f, -kFootingM}, {0.05f, 0.02f, height_m - 0.05f}, wood, false);
  if (variant != 2) {
    for (const float share : {0.22f, 0.8f}) {
      AddBar(b, {-1, 0.005f, share * height_m}, {1, 0.005f, share * height_m}, 0.035f, 0.07f, wood);
    }
  }
  if (variant == 0 || variant == 1) {
    const int count = variant == 0 ? 14 : 18;
    const float pitch = 2.0f / static_cast<float>(count);
    for (int i = 0; i < count; ++i) {
      const float x = -1 + pitch * (static_cast<float>(i) + 0.5f);
      const float uneven = static_cast<float>(random.Between(-0.012, 0.012));
      AddPicket(b, x + uneven, variant == 0 ? 0.08f : 0.098f, 0.06f, height_m + uneven,
                variant == 0 ? 0.06f : 0, wood);
    }
  } else if (variant == 2) {  // level boards
    for (int i = 0; i < 5; ++i) {
      const float z = 0.1f + 0.2f * static_cast<float>(i);
      AddBar(b, {-1, 0.032f, z + 0.07f}, {1, 0.032f, z + 0.07f}, 0.025f, 0.14f, wood);
    }
  } else {  // iron bars with points, on a low wall
    const SurfaceIdx wall = b.Use({Pattern::kStone, 0.4f, 1, 0, kFence});
    b.Box({-1, -0.12f, -kFootingM}, {1, 0.12f, 0.35f}, wall);
    for (int i = 0; i < 15; ++i) {
      const float x = -1 + 2.0f / 15 * (static_cast<float>(i) + 0.5f);
      b.Tube({{x, 0.005f, 0.35f}, {x, 0.005f, 1.2f}, {x, 0.005f, 1.3f}}, {0.011f, 0.011f, 0}, 4,
             wood, false);
    }
  }
  return std::move(b).Build();
}

/// Of 2 m: rods between level bars.
Mesh WireFence(uint32_t variant) {
  MeshBuilder b;
  const float height_m = variant == 0 ? 1.2f : 1.8f;
  const SurfaceIdx steel = b.Use(Steel(variant == 0 ? 0.12f : 0.35f, kFence));
  b.Box({-0.03f, -0.05f, -kFootingM}, {0.03f, -0.01f, height_m + 0.04f}, steel, false);
  for (float z = 0.06f; z < height_m + 0.01f; z += 0.2f) {
    b.Tube({{-1, 0, z}, {1, 0, z}}, {0.006f, 0.006f}, 4, steel, false);
  }
  constexpr int kRods = 20;
  for (int i = 0; i < kRods; ++i) {
    const float x = -1 + 2.0f / kRods * (static_cast<float>(i) + 0.5f);
    b.Tube({{x, 0.008f, 0.04f}, {x, 0.008f, height_m}}, {0.005f, 0.005f}, 3, steel, false);
  }
  return std::move(b).Build();
}

/// Of 4 m: the pressed beam on posts.
Mesh GuardRail(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(0.45f, kFence)), post = b.Use(Steel(0.38f, kFence));
  const auto beam = [&](float side) {
    // Seen from the end: two waves, towards the traffic.
    const std::array<Vector2f, 9> section = {{{0.02f, 0.44f},
                                              {0.0f, 0.47f},
                                              {0.08f, 0.51f},
                                              {0.08f, 0.55f},
                                              {0.02f, 0.595f},
                                              {0.08f, 0.64f},
                                              {0.08f, 0.68f},
                                              {0.0f, 0.72f},
                                              {0.02f, 0.75f}}};
    const float back = 0.13f;
    std::vector<Points3> rings;
    for (const Vector2f& p : section) {
      const float y = side * (back + p.x());
      rings.push_back({{side * 2, y, p.y()}, {side * -2, y, p.y()}});
    }
    b.Loft(rings, /*closed=*/false, steel);
    for (const float x : {-1.f, 1.f}) {
      const float y = side * 0.09f;
      b.Box({x - 0.1f, std::min(0.f, y) - 0.04f, 0.52f},
            {x + 0.1f, std::max(0.f, y) + 0.04f, 0.67f}, post);
    }
  };
  beam(1);
  if (variant == 1) beam(-1);
  for (const float x : {-1.f, 1.f}) {
    b.Box({x - 0.05f, -0.03f, -kFootingM}, {x + 0.05f, 0.03f, 0.72f}, post, false);
  }
  return std::move(b).Build();
}

/// Of 4 m, with a pillar at its start.
Mesh SoundWall(uint32_t variant) {
  MeshBuilder b;
  const float height_m = std::array{3.5f, 4.0f, 4.5f}[variant];
  const SurfaceIdx pillar = b.Use(Steel(0.3f, kWall));
  b.Box({-2, -0.14f, -kFootingM}, {-1.8f, 0.14f, height_m + 0.1f}, pillar, false);
  const SurfaceIdx plinth = b.Use({Pattern::kConcrete, 0.4f, 1, 0, kWall});
  b.Box({-1.8f, -0.08f, -kFootingM}, {2, 0.08f, 0.5f}, plinth);
  if (variant == 0) {  // planks
    const SurfaceIdx wood = b.Use({Pattern::kWood, 0.28f, 1, 0, kWall});
    b.Box({-1.8f, -0.05f, 0.5f}, {2, 0.05f, height_m}, wood, false);
    for (int i = 0; i < 13; ++i) {
      const float x = -1.65f + 0.29f * static_cast<float>(i);
      b.Box({x, 0.05f, 0.5f}, {x + 0.05f, 0.09f, height_m}, wood, false);
    }
  } else if (variant == 1) {  // ribbed concrete
    const SurfaceIdx concrete = b.Use({Pattern::kConcrete, 0.5f, 1, 0, kWall});
    std::vector<Vector3f> front;
    for (int i = 0; i < 19; ++i) {
      const float x = 2 - 0.2f * static_cast<float>(i);
      front.insert(front.end(), {{x, 0.05f, 0.5f},
                                 {x - 0.06f, 0.11f, 0.5f},
                                 {x - 0.12f, 0.11f, 0.5f},
                                 {x - 0.18f, 0.05f, 0.5f}});
    }
    front.emplace_back(-1.8f, 0.05f, 0.5f);
    Points3 top = front;
    for (Vector3f& p : top) p.z() = height_m;
    b.Loft({front, top}, /*closed=*/false, concrete);
    b.Box({-1.8f, -0.08f, 0.5f}, {2, 0.05f, height_m}, concrete, false);
    b.Box({-1.8f, -0.1f, height_m}, {2, 0.13f, height_m + 0.1f}, plinth);
  } else {  // cassettes of metal, in two greys
    const SurfaceIdx light = b.Use({Pattern::kMetal, 0.5f, 0.8f, 0.03f, kWall});
    const SurfaceIdx dark = b.Use({Pattern::kMetal, 0.25f, 0.8f, 0.03f, kWall});
    b.Box({-1.8f, -0.04f, 0.5f}, {2, 0.04f, height_m}, dark, false);
    int row = 0;
    for (float z = 0.5f; z < height_m - 0.01f; z += 0.5f, ++row) {
      const float bulge = row % 2 ? 0.07f : 0.06f;
      b.Box({-1.8f, -bulge, z + 0.01f}, {2, bulge, z + 0.49f}, row % 3 == 2 ? dark : light);
    }
  }
  return std::move(b).Build();
}

/// Of 4 m, cast, wide at the foot.
Mesh ConcreteBarrier(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx concrete = b.Use({Pattern::kConcrete, variant == 0 ? 0.5f : 0.4f, 1, 0, kWall});
  const float x = 2;
  b.Prism({{-x, -0.3f, 0},
           {-x, 0.3f, 0},
           {-x, 0.3f, 0.08f},
           {-x, 0.13f, 0.33f},
           {-x, 0.08f, 0.82f},
           {-x, -0.08f, 0.82f},
           {-x, -0.13f, 0.33f},
           {-x, -0.3f, 0.08f}},
          {2 * x - 0.015f, 0, 0}, concrete, concrete);
  if (variant == 1) {  // reflectors on top
    for (const float at : {-1.f, 1.f}) {
      b.Box({at - 0.02f, -0.06f, 0.82f}, {at + 0.02f, 0.06f, 0.95f},
            b.Use({Pattern::kPlain, 0.6f, 1, 0.2f, kWall}));
    }
  }
  return std::move(b).Build();
}

constexpr ModelKind kKinds[] = {
    {"fence", 4, Fence},
    {"wire-fence", 2, WireFence},
    {"guard-rail", 2, GuardRail},
    {"sound-wall", 3, SoundWall},
    {"concrete-barrier", 2, ConcreteBarrier},
};

}  // namespace

std::span<const ModelKind> BarrierKinds() { return kKinds; }

}  // namespace carmap
