// Furniture of streets: what people sit on, wait in, post into, throw into.
#include <algorithm>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

constexpr float kTau = 2 * static_cast<float>(M_PI);

Mesh Kiosk(uint32_t variant) {
  MeshBuilder b;
  const float length_m = variant == 0 ? 2.8f : 3.8f, half = length_m / 2, depth = 1.15f;
  const SurfaceIdx wall = variant == 1 ? b.Use({Pattern::kWood, 0.35f, 1, 0, kBuilding})
                                       : b.Use(Painted(0.4f, kBuilding));
  const SurfaceIdx trim = b.Use(Painted(0.65f, kBuilding));
  const SurfaceIdx dark = b.Use(Painted(0.03f, kBuilding));
  const SurfaceIdx poster = b.Use({Pattern::kPoster, 0.45f, 1, 0.03f, kBuilding});
  const WallOpening hatch = {0.5f, 1.05f, length_m - 1, 1};
  b.Wall({half, depth, 0}, {-half, depth, 0}, 2.5f, {hatch}, 0.25f, wall, trim);
  b.Quad({half, 0.9f, 1}, {-half, 0.9f, 1}, {-half, 0.9f, 2.1f}, {half, 0.9f, 2.1f}, dark);
  b.Wall({-half, depth, 0}, {-half, -depth, 0}, 2.5f, {}, 0, wall, wall);
  b.Wall({-half, -depth, 0}, {half, -depth, 0}, 2.5f, {}, 0, wall, wall);
  b.Wall({half, -depth, 0}, {half, depth, 0}, 2.5f, {}, 0, wall, wall);
  b.Box({-half - 0.05f, -depth - 0.05f, -kFootingM}, {half + 0.05f, depth + 0.05f, 0.12f},
        b.Use({Pattern::kConcrete, 0.35f, 1, 0, kBuilding}));
  b.Box({-half - 0.35f, -depth - 0.2f, 2.5f}, {half + 0.35f, depth + 0.5f, 2.66f}, trim);
  b.Box({-half + 0.1f, depth - 0.02f, 2.68f}, {half - 0.1f, depth + 0.06f, 3.1f},
        b.Use({Pattern::kSign, 0.6f, 1, 0.03f, kBuilding}));
  b.Box({-half + 0.4f, depth, 1}, {half - 0.4f, depth + 0.3f, 1.05f}, trim);
  for (const float side : {-1.f, 1.f}) {  // newspapers on the ends, magazines in the hatch
    MeshBuilder board;
    AddBoard(board, {-half - 0.03f, 0, 1.45f}, 1.5f, 1.3f, 0.04f, 0.05f,
             board.Use({Pattern::kPoster, 0.45f, 1, 0.03f, kBuilding}),
             board.Use(Painted(0.65f, kBuilding)));
    b.Add(board.mesh(), FrameAt({0, 0, 0}, side < 0 ? 0 : kTau / 2));
  }
  for (const float x : {-0.28f, 0.28f}) {
    b.Quad({x * length_m + 0.35f, 0.93f, 1.1f}, {x * length_m - 0.35f, 0.93f, 1.1f},
           {x * length_m - 0.35f, 0.93f, 1.9f}, {x * length_m + 0.35f, 0.93f, 1.9f}, poster);
  }
  if (variant == 2) {  // an awning
    const SurfaceIdx cloth = b.Use({Pattern::kFabric, 0.6f, 1, 0, kBuilding});
    b.Quad({half, depth + 1.3f, 1.95f}, {-half, depth + 1.3f, 1.95f}, {-half, depth, 2.45f},
           {half, depth, 2.45f}, cloth);
    b.Quad({half, depth + 1.3f, 1.75f}, {-half, depth + 1.3f, 1.75f}, {-half, depth + 1.3f, 1.95f},
           {half, depth + 1.3f, 1.95f}, cloth);
  }
  return std::move(b).Build();
}

/// A wheeled household bin, open at no side, its front to +y.
void AddWheelieBin(MeshBuilder& b, float x, float albedo, float lid_albedo) {
  const SurfaceIdx body = b.Use({Pattern::kPlain, albedo, 1, 0.05f, kUnlabelled});
  const SurfaceIdx lid = b.Use({Pattern::kPlain, lid_albedo, 1, 0.05f, kUnlabelled});
  b.SetFrame(FrameAt({x, 0, 0}));
  const auto ring = [](float half_x, float back, float front, float z) -> Points3 {
    return {{-half_x, back, z}, {half_x, back, z}, {half_x, front, z}, {-half_x, front, z}};
  };
  const Points3 foot = ring(0.21f, -0.24f, 0.2f, 0.04f), top = ring(0.27f, -0.32f, 0.3f, 0.95f);
  b.Loft({foot, top}, /*closed=*/true, body);
  b.Polygon({foot.rbegin(), foot.rend()}, body);
  b.Loft({ring(0.29f, -0.36f, 0.34f, 0.95f), ring(0.29f, -0.36f, 0.34f, 1),
          ring(0.25f, -0.3f, 0.26f, 1.06f)},
         /*closed=*/true, lid);
  b.Polygon(ring(0.25f, -0.3f, 0.26f, 1.06f), lid);
  b.Polygon({{-0.29f, 0.34f, 0.95f},
             {0.29f, 0.34f, 0.95f},
             {0.29f, -0.36f, 0.95f},
             {-0.29f, -0.36f, 0.95f}},
            lid);
  b.Cylinder({-0.25f, -0.4f, 0.93f}, {0.25f, -0.4f, 0.93f}, 0.02f, 5, body);
  const SurfaceIdx rubber = b.Use({Pattern::kRubber, 0.05f, 1, 0, kUnlabelled});
  for (const float side : {-1.f, 1.f}) {
    b.Cylinder({side * 0.2f, -0.27f, 0.1f}, {side * 0.27f, -0.27f, 0.1f}, 0.1f, 10, rubber);
  }
  b.Quad({0.13f, 0.262f, 0.6f}, {-0.13f, 0.262f, 0.6f}, {-0.13f, 0.28f, 0.78f},
         {0.13f, 0.28f, 0.78f}, b.Use({Pattern::kSign, 0.6f, 1, 0, kUnlabelled}));
  b.SetFrame(Eigen::Affine3f::Identity());
}

Mesh Bin(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(0.3f, kUnlabelled));
  switch (variant) {
    case 0:  // on a post
      AddPost(b, 0, -0.2f, 1.15f, 0.03f, b.Use(Steel(0.3f, kPole)));
      b.SetFrame(FrameAt({0, 0, 0.35f}));
      b.Lathe({{0, 0}, {0.15f, 0}, {0.19f, 0.6f}, {0.2f, 0.62f}, {0.17f, 0.7f}, {0, 0.72f}}, 12,
              b.Use(Painted(0.3f, kUnlabelled)));
      b.SetFrame(Eigen::Affine3f::Identity());
      b.Box({-0.1f, 0.185f, 0.66f}, {0.1f, 0.2f, 0.84f},
            b.Use({Pattern::kSign, 0.7f, 1, 0, kUnlabelled}));
      break;
    case 1:
      AddWheelieBin(b, 0, 0.1f, 0.12f);
      break;
    case 2:  // put out for collection
      AddWheelieBin(b, -0.4f, 0.08f, 0.3f);
      AddWheelieBin(b, 0.3f, 0.12f, 0.13f);
      break;
    default:  // slatted, with a hood
      for (int i = 0; i < 14; ++i) {
        const float angle = kTau * static_cast<float>(i) / 14;
        b.SetFrame(FrameAt({0, 0, 0}, angle));
        b.Box({0.23f, -0.04f, 0.06f}, {0.25f, 0.04f, 0.85f},
              b.Use({Pattern::kWood, 0.3f, 1, 0, kUnlabelled}));
      }
      b.SetFrame(Eigen::Affine3f::Identity());
      b.Lathe({{0, 0}, {0.22f, 0}, {0.22f, 0.88f}, {0.27f, 0.9f}, {0.27f, 0.95f}, {0, 1.1f}}, 14,
              steel);
  }
  return std::move(b).Build();
}

Mesh Bollard(uint32_t variant) {
  MeshBuilder b;
  switch (variant) {
    case 0:
      AddPost(b, 0, 0, 0.95f, 0.045f, b.Use(Steel(0.3f, kPole)), 10);
      b.Cylinder({0, 0, 0.8f}, {0, 0, 0.86f}, 0.048f, 10, b.Use(Painted(0.8f, kPole)));
      break;
    case 1:
      b.Lathe({{0.1f, -kFootingM},
               {0.1f, 0.12f},
               {0.07f, 0.2f},
               {0.06f, 0.75f},
               {0.085f, 0.8f},
               {0.06f, 0.86f},
               {0.07f, 0.93f},
               {0, 1}},
              10, b.Use(Steel(0.08f, kPole)));
      break;
    default: {  // a reflector post of country roads and freeways
      const SurfaceIdx white = b.Use(Painted(0.8f, kPole)), black = b.Use(Painted(0.04f, kPole));
      const auto section = [](float z) -> Points3 {
        return {{-0.06f, -0.05f, z}, {0.05f, 0, z}, {-0.06f, 0.05f, z}};
      };
      b.Loft({section(-kFootingM), section(0.68f), section(0.9f), section(1)}, /*closed=*/true,
             [&](size_t ring, size_t) { return ring == 1 ? black : white; });
      b.Polygon(section(1), white);
      b.Quad({-0.062f, 0.02f, 0.72f}, {-0.062f, -0.02f, 0.72f}, {-0.062f, -0.02f, 0.86f},
             {-0.062f, 0.02f, 0.86f}, b.Use({Pattern::kPlain, 0.6f, 1, 0.3f, kPole}));
    }
  }
  return std::move(b).Build();
}

Mesh Bench(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx wood = b.Use({Pattern::kWood, 0.3f, 1, 0, kUnlabelled});
  const SurfaceIdx iron = b.Use(Steel(0.1f, kUnlabelled));
  for (int i = 0; i < 4; ++i) {  // the seat
    const float y = -0.2f + 0.12f * static_cast<float>(i);
    AddBar(b, {-0.9f, y + 0.045f, 0.445f}, {0.9f, y + 0.045f, 0.445f}, 0.09f, 0.03f, wood);
  }
  if (variant == 0) {
    for (int i = 0; i < 3; ++i) {
      const float z = 0.55f + 0.12f * static_cast<float>(i),
                  y = -0.24f - 0.04f * static_cast<float>(i);
      AddBar(b, {-0.9f, y - 0.015f, z + 0.045f}, {0.9f, y - 0.015f, z + 0.045f}, 0.03f, 0.09f,
             wood);
    }
  }
  for (const float x : {-0.7f, 0.7f}) {
    if (variant == 0) {
      AddBar(b, {x, -0.22f, -kFootingM}, {x, -0.36f, 0.88f}, 0.06f, 0.05f, iron);
      AddBar(b, {x, 0.2f, -kFootingM}, {x, 0.24f, 0.43f}, 0.06f, 0.05f, iron);
      AddBar(b, {x, -0.26f, 0.4f}, {x, 0.25f, 0.4f}, 0.05f, 0.05f, iron);
    } else {
      b.Box({x - 0.12f, -0.2f, -kFootingM}, {x + 0.12f, 0.25f, 0.43f},
            b.Use({Pattern::kConcrete, 0.45f, 1, 0, kUnlabelled}), false);
    }
  }
  return std::move(b).Build();
}

/// A pole with the stop's sign and the timetable.
void AddStopPole(MeshBuilder& b, float x, float y) {
  b.SetFrame(FrameAt({x, y, 0}));
  AddPost(b, 0, 0, 2.9f, 0.035f, b.Use(Steel(0.4f, kPole)));
  const SurfaceIdx back = b.Use(Steel(0.45f, kTrafficSign));
  const SurfaceIdx face = b.Use(SignFace(0.6f));
  const SurfaceIdx border = b.Use(Painted(0.2f, kTrafficSign));
  AddPlate(b, Circle({-0.05f, 0, 2.65f}, -Vector3f::UnitX(), 0.24f, 20), 0.15f, face, border, back);
  AddPlate(b, Circle({0.05f, 0, 2.65f}, Vector3f::UnitX(), 0.24f, 20), 0.15f, face, border, back);
  AddBoard(b, {-0.06f, 0, 1.5f}, 0.36f, 0.6f, 0.03f, 0.02f, b.Use(SignFace(0.7f)), back);
  b.SetFrame(Eigen::Affine3f::Identity());
}

Mesh BusStop(uint32_t variant) {
  MeshBuilder b;
  if (variant == 1) {
    AddStopPole(b, 0, 0);
    return std::move(b).Build();
  }
  const float half = variant == 0 ? 2.0f : 2.6f;
  const SurfaceIdx frame = b.Use(Steel(variant == 0 ? 0.12f : 0.35f, kBuilding));
  const SurfaceIdx seat = b.Use({Pattern::kWood, 0.3f, 1, 0, kBuilding});
  const SurfaceIdx poster = b.Use({Pattern::kPoster, 0.5f, 1, 0.05f, kBuilding});
  const int bays = variant == 0 ? 3 : 4;
  for (int i = 0; i <= bays; ++i) {
    const float x = half * (2 * static_cast<float>(i) / static_cast<float>(bays) - 1);
    b.Box({x - 0.03f, -0.75f, -kFootingM}, {x + 0.03f, -0.68f, 2.35f}, frame, false);
  }
  for (const float x : {-half, half}) {
    b.Box({x - 0.03f, 0.45f, -kFootingM}, {x + 0.03f, 0.52f, 2.35f}, frame, false);
    AddBar(b, {x, -0.7f, 0.25f}, {x, 0.5f, 0.25f}, 0.04f, 0.06f, frame);
  }
  // Panes show what is behind them; of each, what shows of itself is its rim and its stripes.
  for (const float z : {0.2f, 1.05f, 2.2f}) {
    AddBar(b, {-half, -0.715f, z}, {half, -0.715f, z}, 0.03f, 0.05f, frame);
  }
  b.Quad({half, -0.7f, 1.3f}, {-half, -0.7f, 1.3f}, {-half, -0.7f, 1.42f}, {half, -0.7f, 1.42f},
         b.Use({Pattern::kSign, 0.7f, 1, 0, kBuilding}));
  b.Box({-half - 0.2f, -0.95f, 2.35f}, {half + 0.2f, 0.75f, 2.47f}, frame);
  b.Box({-half + 0.3f, -0.6f, 0.45f}, {half - 1.2f, -0.25f, 0.5f}, seat);
  for (const float x : {-half + 0.5f, half - 1.4f}) {
    b.Box({x - 0.03f, -0.45f, 0}, {x + 0.03f, -0.4f, 0.45f}, frame, false);
  }
  for (const float yaw : {0.f, kTau / 2}) {  // the lit case at the far end, read from both sides
    MeshBuilder side;
    AddBoard(side, {-0.06f, 0, 1.25f}, 1.2f, 1.8f, 0.12f, 0.06f,
             side.Use({Pattern::kPoster, 0.5f, 1, 0.05f, kBuilding}),
             side.Use(Steel(0.2f, kBuilding)));
    b.Add(side.mesh(), FrameAt({half, -0.1f, 0}, yaw));
  }
  b.Quad({-half + 1.5f, -0.69f, 0.9f}, {-half + 0.7f, -0.69f, 0.9f}, {-half + 0.7f, -0.69f, 2.1f},
         {-half + 1.5f, -0.69f, 2.1f}, poster);
  AddStopPole(b, -half - 1.2f, 0.3f);
  return std::move(b).Build();
}

Mesh Mailbox(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx yellow = b.Use({Pattern::kPlain, 0.5f, 1, 0.05f, kUnlabelled});
  const SurfaceIdx dark = b.Use(Painted(0.05f, kUnlabelled));
  const SurfaceIdx face = b.Use({Pattern::kSign, 0.5f, 1, 0, kUnlabelled});
  const float half = variant == 0 ? 0.25f : 0.4f, top = 1.35f;
  const SurfaceIdx leg = b.Use(Steel(0.35f, kPole));
  for (const float x : {-half * 0.6f, half * 0.6f}) AddPost(b, x, 0, 0.75f, 0.03f, leg, 6);
  b.Prism({{-half, -0.18f, 0.72f},
           {-half, 0.18f, 0.72f},
           {-half, 0.18f, top - 0.06f},
           {-half, 0.1f, top},
           {-half, -0.1f, top},
           {-half, -0.18f, top - 0.06f}},
          {2 * half, 0, 0}, yellow, yellow);
  b.Quad({half * 0.7f, 0.184f, 1.17f}, {-half * 0.7f, 0.184f, 1.17f}, {-half * 0.7f, 0.184f, 1.21f},
         {half * 0.7f, 0.184f, 1.21f}, dark);
  b.Quad({half * 0.75f, 0.184f, 0.82f}, {-half * 0.75f, 0.184f, 0.82f},
         {-half * 0.75f, 0.184f, 1.1f}, {half * 0.75f, 0.184f, 1.1f}, face);
  return std::move(b).Build();
}

Mesh Planter(uint32_t variant) {
  MeshBuilder b;
  HashSequence random(0x91a7, variant);
  const SurfaceIdx leaves = b.Use({Pattern::kLeaves, 0.16f, 1, 0, kVegetation});
  const SurfaceIdx flowers = b.Use({Pattern::kLeaves, 0.55f, 0.5f, 0, kVegetation});
  const SurfaceIdx soil = b.Use({Pattern::kSoil, 0.12f, 1, 0, kUnlabelled});
  const SurfaceIdx stone = b.Use({Pattern::kConcrete, 0.45f, 1, 0, kUnlabelled});
  float height_m = 0.5f, reach_x = 0.7f, reach_y = 0.3f;
  if (variant == 0) {
    b.Lathe({{0.4f, 0}, {0.55f, 0.5f}, {0.62f, 0.52f}, {0.62f, 0.62f}, {0.55f, 0.62f}, {0, 0.58f}},
            14, stone);
    height_m = 0.6f, reach_x = reach_y = 0.5f;
  } else {
    const SurfaceIdx side =
        variant == 1 ? stone : b.Use({Pattern::kWood, 0.28f, 1, 0, kUnlabelled});
    b.Box({-0.8f, -0.35f, 0}, {0.8f, 0.35f, 0.5f}, side, false);
    b.Quad({-0.72f, -0.28f, 0.503f}, {0.72f, -0.28f, 0.503f}, {0.72f, 0.28f, 0.503f},
           {-0.72f, 0.28f, 0.503f}, soil);
  }
  for (int i = 0; i < 7; ++i) {
    const float x = reach_x * static_cast<float>(random.Between(-0.8, 0.8));
    const float y = reach_y * static_cast<float>(random.Between(-0.6, 0.6));
    const float rise = static_cast<float>(random.Between(0.12, 0.3));
    b.LeafCluster({x, y, height_m + rise * 0.8f}, {0.2f, 0.2f, rise}, 45, 0.1f, leaves, random);
    b.LeafCluster({x, y, height_m + rise}, {0.2f, 0.2f, rise}, 14, 0.07f, flowers, random);
  }
  return std::move(b).Build();
}

Mesh ElectricBox(uint32_t variant) {
  MeshBuilder b;
  const float half = variant == 1 ? 0.75f : 0.45f, height_m = variant == 1 ? 1.35f : 1.1f;
  const SurfaceIdx grey =
      b.Use({Pattern::kPlain, variant == 2 ? 0.3f : 0.45f, 1, 0.02f, kUnlabelled});
  const SurfaceIdx dark = b.Use(Painted(0.08f, kUnlabelled));
  b.Box({-half, -0.17f, -kFootingM}, {half, 0.17f, 0.14f},
        b.Use({Pattern::kConcrete, 0.3f, 1, 0, kUnlabelled}));
  b.Box({-half, -0.16f, 0.14f}, {half, 0.16f, height_m}, grey, false);
  b.Prism({{-half - 0.03f, -0.19f, height_m},
           {-half - 0.03f, 0.19f, height_m},
           {-half - 0.03f, 0, height_m + 0.08f}},
          {2 * half + 0.06f, 0, 0}, grey, grey);
  const int doors = variant == 1 ? 3 : 2;
  for (int i = 1; i < doors; ++i) {
    const float x = half * (2 * static_cast<float>(i) / static_cast<float>(doors) - 1);
    b.Box({x - 0.008f, 0.155f, 0.18f}, {x + 0.008f, 0.164f, height_m - 0.04f}, dark);
    b.Box({x + 0.04f, 0.16f, height_m * 0.55f}, {x + 0.07f, 0.185f, height_m * 0.68f}, dark);
  }
  for (int i = 0; i < 4; ++i) {  // slots for air
    const float z = height_m - 0.1f - 0.035f * static_cast<float>(i);
    b.Box({-half + 0.08f, 0.155f, z}, {-half + 0.3f, 0.164f, z + 0.015f}, dark);
  }
  if (variant != 0) {  // stickers
    b.Quad({half - 0.08f, 0.166f, 0.5f}, {half - 0.33f, 0.166f, 0.5f},
           {half - 0.33f, 0.166f, 0.85f}, {half - 0.08f, 0.166f, 0.85f},
           b.Use({Pattern::kPoster, 0.55f, 1, 0, kUnlabelled}));
  }
  return std::move(b).Build();
}

Mesh AdvertisingColumn(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx poster = b.Use({Pattern::kPoster, 0.5f, 1, 0, kUnlabelled});
  const SurfaceIdx base = b.Use({Pattern::kConcrete, 0.35f, 1, 0, kUnlabelled});
  const SurfaceIdx cap = b.Use(Painted(variant == 0 ? 0.15f : 0.5f, kUnlabelled));
  const float top = variant == 0 ? 2.9f : 3.4f, radius_m = variant == 0 ? 0.6f : 0.72f;
  b.Lathe({{radius_m + 0.06f, -kFootingM}, {radius_m + 0.06f, 0.3f}, {radius_m, 0.34f}}, 28, base);
  b.Lathe({{radius_m, 0.34f}, {radius_m, top}}, 28, poster);
  b.Lathe({{radius_m, top},
           {radius_m + 0.09f, top + 0.03f},
           {radius_m + 0.09f, top + 0.13f},
           {radius_m * 0.7f, top + 0.3f},
           {0, top + 0.42f}},
          28, cap);
  return std::move(b).Build();
}

constexpr ModelKind kKinds[] = {
    {"kiosk", 3, Kiosk},
    {"bin", 4, Bin},
    {"bollard", 3, Bollard},
    {"bench", 2, Bench},
    {"bus-stop", 3, BusStop},
    {"mailbox", 2, Mailbox},
    {"planter", 3, Planter},
    {"electric-box", 3, ElectricBox},
    {"advertising-column", 2, AdvertisingColumn},
};

}  // namespace

std::span<const ModelKind> FurnitureKinds() { return kKinds; }

}  // namespace carmap
