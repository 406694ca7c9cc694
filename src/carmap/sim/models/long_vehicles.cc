// Lorries and buses.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

/// What long vehicles have in common, with their surfaces.
struct LongVehicle {
  LongVehicle(SemanticClass shown_as, float paint_albedo)
      : label(shown_as),
        paint(b.Use({Pattern::kCarPaint, paint_albedo, 1, 0.12f, shown_as})),
        dark(b.Use({Pattern::kPlain, 0.04f, 1, 0.02f, shown_as})),
        glass(b.Use({Pattern::kGlass, 0.04f, 1, 0.3f, shown_as})),
        metal(b.Use({Pattern::kMetal, 0.4f, 1, 0.08f, shown_as})),
        light(b.Use({Pattern::kPlain, 0.65f, 1, 0.3f, shown_as})),
        tail_light(b.Use({Pattern::kPlain, 0.1f, 1, 0.05f, shown_as})),
        lettering(b.Use({Pattern::kSign, 0.7f, 1, 0.03f, shown_as})) {}

  /// A pane or panel just before the side at `y`, on both sides of the vehicle.
  void OnSides(float y, float from_x, float to_x, float low, float high, SurfaceIdx surface) {
    b.Quad({to_x, y, low}, {from_x, y, low}, {from_x, y, high}, {to_x, y, high}, surface);
    b.Quad({from_x, -y, low}, {to_x, -y, low}, {to_x, -y, high}, {from_x, -y, high}, surface);
  }
  /// Before the front (`x` > 0) or the rear.
  void OnEnd(float x, float half_width, float low, float high, SurfaceIdx surface,
             float middle = 0) {
    const float left = x > 0 ? -half_width : half_width;
    b.Quad({x, middle + left, low}, {x, middle - left, low}, {x, middle - left, high},
           {x, middle + left, high}, surface);
  }

  void Wheels(float x, float half_width, float radius, float tyre_m) {
    const SurfaceIdx rubber = b.Use({Pattern::kRubber, 0.05f, 1, 0, label});
    for (const float side : {1.f, -1.f}) {
      b.SetFrame(FrameAt({x, side * (half_width - tyre_m), radius}, 0, 0,
                         -side * static_cast<float>(M_PI / 2)));
      b.Lathe({{0, 0},
               {radius, 0},
               {radius, tyre_m - 0.03f},
               {0.94f * radius, tyre_m},
               {0.6f * radius, tyre_m},
               {0.52f * radius, tyre_m - 0.08f}},
              14, rubber);
      b.Lathe({{0.52f * radius, tyre_m - 0.08f},
               {0.25f * radius, tyre_m - 0.07f},
               {0.2f * radius, tyre_m + 0.01f},
               {0, tyre_m + 0.02f}},
              14, metal);
      b.SetFrame(Eigen::Affine3f::Identity());
    }
  }

  void NumberPlate(float x, float z) { OnEnd(x, 0.26f, z - 0.055f, z + 0.055f, lettering); }

  MeshBuilder b;
  const SemanticClass label;
  const SurfaceIdx paint, dark, glass, metal, light, tail_light, lettering;
};

/// A box with rounded upright edges, from `rear` to `front`, its front leaning back by `rake`.
void AddBodyBox(MeshBuilder& b, float rear, float front, float half, float low, float high,
                float rake, SurfaceIdx surface) {
  const float r = 0.12f;
  const auto ring = [&](float z, float shrink, float lean) -> Points3 {
    const float y = half - shrink, f = front - lean - shrink, back = rear + shrink;
    return {{f, -y + r, z},        {f, y - r, z},        {f - r, y, z},
            {back + r / 2, y, z},  {back, y - r / 2, z}, {back, -y + r / 2, z},
            {back + r / 2, -y, z}, {f - r, -y, z}};
  };
  const float waist = low + 0.45f * (high - low);
  const Points3 floor = ring(low, 0.02f, 0);
  const Points3 top = ring(high, 0.1f, rake);
  b.Loft({floor, ring(waist, 0, 0), ring(high - 0.12f, 0, rake * 0.9f), top}, /*closed=*/true,
         surface);
  b.Polygon(top, surface);
  b.Polygon({floor.rbegin(), floor.rend()}, surface);
}

void AddMirrors(LongVehicle& v, float x, float half, float z) {
  for (const float side : {1.f, -1.f}) {
    const float y = side * (half + 0.16f);
    v.b.Box({x, y - 0.09f, z - 0.25f}, {x + 0.12f, y + 0.09f, z + 0.2f}, v.dark);
    v.b.Quad({x - 0.003f, y + 0.08f, z - 0.2f}, {x - 0.003f, y - 0.08f, z - 0.2f},
             {x - 0.003f, y - 0.08f, z + 0.16f}, {x - 0.003f, y + 0.08f, z + 0.16f}, v.glass);
    AddBar(v.b, {x + 0.05f, side * (half - 0.03f), z + 0.25f}, {x + 0.05f, y, z + 0.18f}, 0.03f,
           0.03f, v.dark);
  }
}

void AddCab(LongVehicle& v, float front, float half, float roof) {
  const float rear = front - 1.75f, floor = 0.42f;
  AddBodyBox(v.b, rear, front, half, floor, roof, 0.14f, v.paint);
  // The windscreen leans as the cab does above its waist.
  const float waist = floor + 0.45f * (roof - floor), rake = 0.9f * 0.14f;
  const auto lean = [&](float z) { return front - rake * (z - waist) / (roof - 0.12f - waist); };
  const auto raked = [&](float low, float high, float half_width, SurfaceIdx surface) {
    const float a = lean(low) + 0.01f, c = lean(high) + 0.01f;
    v.b.Quad({a, -half_width, low}, {a, half_width, low}, {c, half_width, high},
             {c, -half_width, high}, surface);
  };
  raked(waist + 0.05f, roof - 0.35f, half - 0.16f, v.glass);
  raked(roof - 0.32f, roof - 0.15f, half - 0.25f, v.lettering);
  v.OnEnd(front + 0.012f, half - 0.35f, 0.8f, waist - 0.08f, v.dark);  // grille
  for (int i = 0; i < 4; ++i) {
    const float z = 0.86f + 0.13f * static_cast<float>(i);
    v.b.Box({front + 0.005f, -half + 0.4f, z}, {front + 0.03f, half - 0.4f, z + 0.05f}, v.metal);
  }
  for (const float side : {1.f, -1.f}) {
    v.OnEnd(front + 0.012f, 0.2f, 0.55f, 0.75f, v.light, side * (half - 0.38f));
  }
  v.NumberPlate(front + 0.015f, 0.56f);
  v.OnSides(half + 0.008f, rear + 0.55f, front - 0.3f, waist + 0.1f, roof - 0.35f, v.glass);
  for (const float x : {rear + 0.5f, front - 0.22f}) {
    v.OnSides(half + 0.006f, x - 0.01f, x + 0.01f, 0.6f, roof - 0.3f, v.dark);
  }
  v.OnSides(half + 0.006f, rear + 0.4f, front - 0.1f, 0.42f, 0.62f, v.dark);  // steps
  AddMirrors(v, front - 0.25f, half, waist + 0.45f);
}

/// The load: a tarpaulin with folds and lettering, or a stiff box.
void AddLoad(LongVehicle& v, float rear, float front, float half, float top, bool tarpaulin,
             uint32_t variant) {
  const float floor = 1.15f;
  const SurfaceIdx cover =
      tarpaulin ? v.b.Use({Pattern::kFabric, std::array{0.6f, 0.3f, 0.45f}[variant % 3], 0.4f, 0,
                           v.label})
                : v.b.Use({Pattern::kMetal, 0.65f, 0.6f, 0.06f, v.label});
  HashSequence random(0x7a59, variant);
  const int bays = tarpaulin ? 14 : 2;
  for (const float side : {1.f, -1.f}) {
    std::vector<Points3> rings(3);
    for (int i = 0; i <= bays; ++i) {
      const float share = static_cast<float>(i) / static_cast<float>(bays);
      const float x = side > 0 ? front + share * (rear - front) : rear + share * (front - rear);
      const float slack =
          tarpaulin && i > 0 && i < bays ? static_cast<float>(random.Between(0, 0.05)) : 0;
      rings[0].emplace_back(x, side * (half - slack), floor);
      rings[1].emplace_back(x, side * (half - slack / 2), (floor + top) / 2);
      rings[2].emplace_back(x, side * half, top);
    }
    v.b.Loft(rings, /*closed=*/false, cover);
  }
  v.b.Quad({rear, -half, top}, {front, -half, top}, {front, half, top}, {rear, half, top}, cover);
  v.b.Quad({front, -half, floor}, {front, half, floor}, {front, half, top}, {front, -half, top},
           cover);
  v.b.Quad({rear, half, floor}, {rear, -half, floor}, {rear, -half, top}, {rear, half, top}, cover);
  v.b.Box({rear, -half, floor - 0.14f}, {front, half, floor}, v.metal);
  if (tarpaulin) {
    const float middle = (rear + front) / 2, low = floor + 0.5f;
    v.OnSides(half + 0.012f, middle - 0.36f * (front - rear), middle + 0.36f * (front - rear), low,
              low + 1.1f,
              variant % 2 ? v.b.Use({Pattern::kPoster, 0.5f, 1, 0, v.label}) : v.lettering);
    for (int i = 1; i < 12; ++i) {  // straps
      const float x = rear + (front - rear) * static_cast<float>(i) / 12;
      v.OnSides(half + 0.006f, x - 0.02f, x + 0.02f, floor - 0.08f, floor + 0.25f, v.dark);
    }
  }
  for (const float y : {-0.02f, 0.f}) {  // doors, and what holds them shut
    const float at = y < 0 ? -half * 0.55f : half * 0.55f;
    v.b.Box({rear - 0.05f, at - 0.025f, floor}, {rear, at + 0.025f, top - 0.05f}, v.metal);
  }
  v.OnEnd(rear - 0.008f, 0.012f, floor, top, v.dark);
  v.OnEnd(rear - 0.008f, 0.5f * half, floor + 1.2f, floor + 1.7f, v.lettering, 0.1f);
}

Mesh Lorry(uint32_t variant) {
  const bool large = variant % 2 == 0;
  const float length = large ? 9.6f : 7.6f, half = large ? 1.27f : 1.15f, top = large ? 3.6f : 3.1f;
  LongVehicle v(kTruck, std::array{0.7f, 0.12f, 0.2f, 0.75f}[variant % 4]);
  const float front = length / 2, rear = -length / 2 + 0.05f;
  AddCab(v, front - 0.03f, half - 0.05f, large ? 2.85f : 2.55f);
  AddLoad(v, rear, front - 2, half, top, variant != 1, variant);
  const float radius = large ? 0.5f : 0.42f;
  v.b.Box({rear + 0.3f, -0.45f, 0.6f}, {front - 0.4f, 0.45f, 1.01f}, v.dark);
  v.Wheels(front - 1.3f, half - 0.03f, radius, 0.3f);
  v.Wheels(rear + 2, half - 0.03f, radius, 0.5f);
  if (large) v.Wheels(rear + 3.2f, half - 0.03f, radius, 0.5f);
  // Guards between the wheels, tank, mudguards, the bar below the tail.
  const float from = rear + (large ? 3.9f : 2.7f), to = front - 2;
  for (const float z : {0.5f, 0.75f}) {
    for (const float side : {1.f, -1.f}) {
      AddBar(v.b, {from, side * (half - 0.06f), z}, {to, side * (half - 0.06f), z}, 0.03f, 0.1f,
             v.metal);
    }
  }
  v.b.Cylinder({from + 0.2f, -half + 0.38f, 0.68f}, {from + 1.3f, -half + 0.38f, 0.68f}, 0.3f, 10,
               v.metal);
  v.b.Box({rear + 0.05f, -half + 0.1f, 0.45f}, {rear + 0.15f, half - 0.1f, 0.6f}, v.metal);
  for (const float side : {1.f, -1.f}) {
    v.b.Box({rear, side * (half - 0.3f) - 0.2f, 0.72f},
            {rear + 0.1f, side * (half - 0.3f) + 0.2f, 0.88f}, v.tail_light);
  }
  v.NumberPlate(rear - 0.01f, 0.94f);
  return std::move(v.b).Build();
}

Mesh Bus(uint32_t variant) {
  LongVehicle v(kBus, std::array{0.65f, 0.3f, 0.5f}[variant]);
  constexpr float kFront = 6, kHalf = 1.275f, kFloor = 0.3f, kTop = 2.95f;
  const float rear = variant == 2 ? -4.8f : -6;
  const float middle = (kFront + rear) / 2;
  v.b.SetFrame(FrameAt({-middle, 0, 0}));
  AddBodyBox(v.b, rear, kFront, kHalf, kFloor, kTop, 0.1f, v.paint);
  v.b.Box({rear + 0.8f, -0.9f, kTop}, {rear + 3.4f, 0.9f, 3.1f}, v.paint);  // climate, on the roof
  // A band of windows with pillars, doors on the right.
  const float low = 1.25f, high = 2.55f, y = kHalf + 0.01f;
  const int panes = static_cast<int>((kFront - rear - 1.2f) / 1.45f);
  const float width = (kFront - rear - 1.2f) / static_cast<float>(panes);
  for (int i = 0; i < panes; ++i) {
    const float from = rear + 0.7f + width * static_cast<float>(i);
    v.OnSides(y, from + 0.04f, from + width - 0.04f, low, high, v.glass);
  }
  v.OnSides(kHalf + 0.004f, rear + 0.6f, kFront - 0.4f, low - 0.05f, high + 0.05f, v.dark);
  for (const float x : {kFront - 1.75f, middle - 0.7f}) {
    for (const float leaf : {0.f, 0.62f}) {
      v.b.Quad({x + leaf, -y - 0.006f, 0.38f}, {x + leaf + 0.58f, -y - 0.006f, 0.38f},
               {x + leaf + 0.58f, -y - 0.006f, 2.4f}, {x + leaf, -y - 0.006f, 2.4f}, v.glass);
    }
    v.b.Quad({x - 0.06f, -y - 0.003f, 0.34f}, {x + 1.26f, -y - 0.003f, 0.34f},
             {x + 1.26f, -y - 0.003f, 2.46f}, {x - 0.06f, -y - 0.003f, 2.46f}, v.dark);
  }
  const SurfaceIdx advertisement = v.b.Use({Pattern::kPoster, 0.5f, 1, 0.05f, kBus});
  if (variant != 1)
    v.b.Quad({middle + 2.6f, y, 0.55f}, {middle - 1.6f, y, 0.55f}, {middle - 1.6f, y, 1.15f},
             {middle + 2.6f, y, 1.15f}, advertisement);
  v.OnSides(y, kFront - 3.6f, kFront - 2.2f, 2.6f, 2.8f, v.lettering);
  // Front: windscreen, the destination above it, lights.
  const float lean = 0.1f;
  v.b.Quad({kFront + 0.01f, -1.1f, 0.95f}, {kFront + 0.01f, 1.1f, 0.95f},
           {kFront + 0.01f, 1.1f, 1.45f}, {kFront + 0.01f, -1.1f, 1.45f}, v.glass);
  v.b.Quad({kFront + 0.01f, -1.1f, 1.45f}, {kFront + 0.01f, 1.1f, 1.45f},
           {kFront - 0.7f * lean + 0.01f, 1.1f, 2.4f}, {kFront - 0.7f * lean + 0.01f, -1.1f, 2.4f},
           v.glass);
  v.b.Quad(
      {kFront - 0.7f * lean + 0.012f, -0.95f, 2.44f}, {kFront - 0.7f * lean + 0.012f, 0.95f, 2.44f},
      {kFront - 0.9f * lean + 0.012f, 0.95f, 2.72f}, {kFront - 0.9f * lean + 0.012f, -0.95f, 2.72f},
      v.b.Use({Pattern::kSign, 0.12f, 1, 0.1f, kBus}));
  for (const float side : {1.f, -1.f}) {
    v.OnEnd(kFront + 0.012f, 0.18f, 0.6f, 0.78f, v.light, side * 0.9f);
    v.OnEnd(rear - 0.012f, 0.1f, 0.8f, 1.3f, v.tail_light, side * 1.05f);
  }
  v.OnEnd(kFront + 0.012f, 1.05f, 0.32f, 0.48f, v.dark);
  v.NumberPlate(kFront + 0.02f, 0.56f);
  v.OnEnd(rear - 0.012f, 1, 1.6f, 2.5f, v.glass);
  v.OnEnd(rear - 0.012f, 0.75f, 0.6f, 1.3f, v.dark);
  v.OnEnd(rear - 0.014f, 0.3f, 2.55f, 2.75f, v.lettering);
  v.NumberPlate(rear - 0.02f, 1.42f);
  for (int i = 0; i < 6; ++i) {  // louvres of the engine
    const float z = 0.65f + 0.1f * static_cast<float>(i);
    v.b.Box({rear - 0.03f, -0.7f, z}, {rear - 0.01f, 0.7f, z + 0.04f}, v.metal);
  }
  AddMirrors(v, kFront - 0.05f, kHalf - 0.05f, 2.1f);
  Mesh body = std::move(v.b).Build();
  LongVehicle whole(kBus, 0.5f);
  whole.b.Add(body, Eigen::Affine3f::Identity());
  for (const float x : {kFront - 2.7f, rear + 3.3f}) {
    // The arch: a dark half disc behind the wheel's outer face.
    for (const float side : {1.f, -1.f}) {
      Points3 arch;
      for (int i = 0; i <= 10; ++i) {
        const float angle = static_cast<float>(M_PI) * static_cast<float>(i) / 10;
        arch.emplace_back(x - middle + side * -0.6f * std::cos(angle) * -1, side * (kHalf + 0.006f),
                          0.45f + 0.6f * std::sin(angle));
      }
      arch.emplace_back(x - middle - side * 0.6f, side * (kHalf + 0.006f), kFloor);
      arch.emplace_back(x - middle + side * 0.6f, side * (kHalf + 0.006f), kFloor);
      if (side > 0) std::reverse(arch.begin(), arch.end());
      whole.b.Polygon(arch, whole.dark);
    }
    whole.Wheels(x - middle, kHalf + 0.02f, 0.48f, 0.3f);
  }
  return std::move(whole.b).Build();
}

constexpr ModelKind kKinds[] = {{"lorry", 4, Lorry}, {"bus", 3, Bus}};

}  // namespace

std::span<const ModelKind> LongVehicleKinds() { return kKinds; }

}  // namespace carmap
