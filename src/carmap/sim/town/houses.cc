#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/town/buildings.h"

namespace carmap {
namespace {

using Eigen::Affine3f;
using Eigen::Vector3f;

constexpr float kFloorM = 2.75f, kPlinthM = 0.4f, kOverhangM = 0.45f, kGableOverhangM = 0.3f;
constexpr float kGarageWidthM = 3.2f;

float Between(HashSequence& draw, double low, double high) {
  return static_cast<float>(draw.Between(low, high));
}

Surface Building(Pattern pattern, float albedo, float contrast = 1, float gloss = 0) {
  return {pattern, albedo, contrast, gloss, SemanticClass::kBuilding};
}

/// What one house is made of.
struct Materials {
  SurfaceIdx wall, gable, plinth, reveal, roof, trim, concrete, metal;
  WindowStyle windows;
};

Materials DrawMaterials(HashSequence& draw, MeshBuilder& builder) {
  const bool brick = draw.Chance(0.18);
  const Surface wall = brick ? Building(Pattern::kBrick, Between(draw, 0.16, 0.3))
                             : Building(Pattern::kPlaster, Between(draw, 0.35, 0.72));
  const Surface trim = Building(Pattern::kWood, Between(draw, 0.12, 0.5));
  Materials m;
  m.wall = builder.Use(wall);
  const double gable = draw.Unit();
  m.gable = gable < 0.7    ? m.wall
            : gable < 0.85 ? builder.Use(Building(Pattern::kWood, Between(draw, 0.1, 0.3)))
                           : builder.Use(Building(Pattern::kRoofTiles, Between(draw, 0.1, 0.2)));
  m.plinth = builder.Use(Building(Pattern::kPlaster, wall.albedo * Between(draw, 0.4, 0.8)));
  m.reveal = builder.Use(Building(Pattern::kPlain, std::min(0.75f, 1.1f * wall.albedo)));
  m.roof = builder.Use(Building(Pattern::kRoofTiles, Between(draw, 0.08, 0.22)));
  m.trim = builder.Use(trim);
  m.concrete = builder.Use(Building(Pattern::kConcrete, 0.35f));
  m.metal = builder.Use(Building(Pattern::kMetal, 0.25f));
  m.windows = {.frame = builder.Use(Building(Pattern::kPlain, draw.Chance(0.7) ? 0.75f : 0.18f)),
               .glass = builder.Use(Building(Pattern::kGlass, 0.05f, 1, 0.35f)),
               .curtain = builder.Use(Building(Pattern::kCurtain, 0.4f, 1, 0.12f)),
               .blind = builder.Use(Building(Pattern::kWood, Between(draw, 0.2, 0.65))),
               .poster = kNoSurface,
               .sill = m.concrete,
               .door = builder.Use(Building(Pattern::kWood, Between(draw, 0.08, 0.4))),
               .reveal_m = Between(draw, 0.1, 0.2),
               .shutters = draw.Chance(0.25),
               .crossed = draw.Chance(0.4),
               .blind_share = Between(draw, 0.1, 0.45)};
  return m;
}

/// Rows of windows, the same on all floors; some are left out.
std::vector<WindowSpec> WindowGrid(float length_m, int floors, float width_m, float height_m,
                                   HashSequence& draw) {
  std::vector<WindowSpec> windows;
  const int columns = static_cast<int>((length_m - 0.8f) / 2.7f);
  const float step = length_m / static_cast<float>(std::max(1, columns));
  for (int floor = 0; floor < floors; ++floor) {
    for (int column = 0; column < columns; ++column) {
      if (draw.Chance(0.15)) continue;
      const float centre = (static_cast<float>(column) + 0.5f) * step;
      windows.push_back(
          {{centre - width_m / 2, kPlinthM + static_cast<float>(floor) * kFloorM + 0.9f, width_m,
            height_m}});
    }
  }
  return windows;
}

/// In place of the windows of the ground floor that are in its way.
void PutDoor(float centre_m, float width_m, std::vector<WindowSpec>* windows) {
  const float left = centre_m - width_m / 2, right = centre_m + width_m / 2;
  std::erase_if(*windows, [&](const WindowSpec& window) {
    const WallOpening& o = window.opening;
    return o.bottom_m < kFloorM && o.left_m < right + 0.7f && o.left_m + o.width_m > left - 0.7f;
  });
  windows->push_back({{left, kPlinthM, width_m, 2.1f}, WindowSpec::Kind::kDoor});
}

/// Two slopes over a rectangle: x within half its length, y from 0 to the span, eaves at `height`.
void AddGableRoof(const Affine3f& frame, float length_m, float span_m, float height_m, float rise_m,
                  const Materials& m, MeshBuilder& builder) {
  constexpr float kThickM = 0.16f;
  const float half = length_m / 2 + kGableOverhangM, slope = rise_m / (span_m / 2);
  const float eaves = height_m - kOverhangM * slope + kThickM, ridge = height_m + rise_m + kThickM;
  builder.SetFrame(frame);
  AddSlab({{-half, -kOverhangM, eaves},
           {half, -kOverhangM, eaves},
           {half, span_m / 2, ridge},
           {-half, span_m / 2, ridge}},
          kThickM, m.roof, m.trim, builder);
  AddSlab({{half, span_m + kOverhangM, eaves},
           {-half, span_m + kOverhangM, eaves},
           {-half, span_m / 2, ridge},
           {half, span_m / 2, ridge}},
          kThickM, m.roof, m.trim, builder);
  for (const float x : {-length_m / 2, length_m / 2}) {
    Points3 gable = {{x, 0, height_m}, {x, span_m, height_m}, {x, span_m / 2, height_m + rise_m}};
    if (x < 0) std::swap(gable[0], gable[1]);
    builder.Polygon(gable, m.gable);
  }
  for (const float y : {-kOverhangM - 0.1f, span_m + kOverhangM}) {  // gutters
    builder.Box({-half, y, eaves - kThickM - 0.02f}, {half, y + 0.1f, eaves - kThickM + 0.1f},
                m.metal);
  }
}

void AddHipRoof(float width_m, float depth_m, float height_m, float rise_m, const Materials& m,
                const Affine3f& frame, MeshBuilder& builder) {
  builder.SetFrame(frame);
  const float half = width_m / 2 + kOverhangM, near = -kOverhangM, far = depth_m + kOverhangM;
  const float ridge_half = std::max(0.2f, width_m / 2 - depth_m / 2.2f);
  const float eaves = height_m + 0.02f, top = height_m + rise_m, middle = depth_m / 2;
  const Vector3f a(-half, near, eaves), b(half, near, eaves), c(half, far, eaves);
  const Vector3f d(-half, far, eaves), left(-ridge_half, middle, top),
      right(ridge_half, middle, top);
  builder.Polygon({a, b, right, left}, m.roof);
  builder.Polygon({b, c, right}, m.roof);
  builder.Polygon({c, d, left, right}, m.roof);
  builder.Polygon({d, a, left}, m.roof);
  builder.Box({-half, near, eaves - 0.2f}, {half, far, eaves - 0.001f}, m.trim);
  for (const float y : {near - 0.1f, far}) {
    builder.Box({-half, y, eaves - 0.14f}, {half, y + 0.1f, eaves}, m.metal);
  }
}

/// On the front slope of a roof whose ridge is parallel to the street.
void AddDormer(float x, float height_m, float slope, const Materials& m, const Affine3f& frame,
               HashSequence& draw, MeshBuilder& builder) {
  constexpr float kWidthM = 1.5f, kHeightM = 1.35f, kFrontM = 0.7f;
  const float base = height_m + kFrontM * slope, top = base + kHeightM;
  const float back = kFrontM + kHeightM / slope;
  builder.SetFrame(frame);
  const Points3 side = {{x - kWidthM / 2, kFrontM, base},
                        {x - kWidthM / 2, kFrontM, top},
                        {x - kWidthM / 2, back, top}};
  builder.Prism(side, {kWidthM, 0, 0}, m.gable, m.gable);
  AddSlab({{x - kWidthM / 2 - 0.15f, kFrontM - 0.25f, top + 0.08f},
           {x + kWidthM / 2 + 0.15f, kFrontM - 0.25f, top + 0.08f},
           {x + kWidthM / 2 + 0.15f, back + 0.5f, top + 0.35f},
           {x - kWidthM / 2 - 0.15f, back + 0.5f, top + 0.35f}},
          0.1f, m.roof, m.trim, builder);
  WindowStyle style = m.windows;
  style.shutters = false;
  style.reveal_m = 0.06f;
  AddWall(frame * FrameAt({x - kWidthM / 2, kFrontM - 0.07f, base + 0.15f}), kWidthM,
          kHeightM - 0.15f, {{{0.2f, 0.12f, kWidthM - 0.4f, 0.95f}}}, style, m.gable, m.reveal,
          draw, builder);
}

void AddBalcony(float x, float z, const Materials& m, const Affine3f& frame, MeshBuilder& builder) {
  constexpr float kHalfM = 1.5f, kOutM = 1.2f, kRailM = 0.95f;
  builder.SetFrame(frame);
  builder.Box({x - kHalfM, -kOutM, z - 0.16f}, {x + kHalfM, 0, z}, m.concrete);
  builder.Box({x - kHalfM, -kOutM, z + kRailM - 0.06f}, {x + kHalfM, -kOutM + 0.06f, z + kRailM},
              m.metal);
  for (const float side : {-kHalfM, kHalfM - 0.05f}) {
    builder.Box({x + side, -kOutM, z + 0.05f}, {x + side + 0.05f, 0, z + kRailM}, m.trim);
  }
  builder.Box({x - kHalfM, -kOutM, z + 0.08f}, {x + kHalfM, -kOutM + 0.03f, z + kRailM - 0.12f},
              m.trim);
}

void AddGarage(const HouseSpec& spec, const Materials& m, const Affine3f& frame, HashSequence& draw,
               MeshBuilder& builder) {
  const float left = spec.width_m / 2, right = left + kGarageWidthM - 0.2f, front = 1.2f, back = 7;
  builder.SetFrame(frame);
  builder.Box({left, front + 0.25f, -1}, {right, back, 2.5f}, m.wall, false);
  builder.Box({left, front - 0.15f, 2.5f}, {right + 0.15f, back + 0.1f, 2.72f}, m.trim);
  AddWall(frame * FrameAt({left, front, -0.6f}), right - left, 3.1f,
          {{{0.3f, 0.65f, right - left - 0.6f, 2.05f}, WindowSpec::Kind::kGarage}}, m.windows,
          m.wall, m.reveal, draw, builder);
}

}  // namespace

HouseSpec DrawHouse(HashSequence& draw) {
  HouseSpec spec;
  spec.floors = draw.Chance(0.55) ? 2 : 1;
  spec.width_m = Between(draw, 8.5, 14);
  spec.depth_m = Between(draw, 8.5, 11.5);
  const double roof = draw.Unit();
  spec.roof = roof < 0.45   ? RoofKind::kGableAlong
              : roof < 0.75 ? RoofKind::kGableAcross
              : roof < 0.93 ? RoofKind::kHip
                            : RoofKind::kFlat;
  spec.garage = draw.Chance(0.4);
  return spec;
}

float HouseLeft(const HouseSpec& spec) { return spec.width_m / 2 + kOverhangM; }

float HouseRight(const HouseSpec& spec) {
  return spec.width_m / 2 + (spec.garage ? kGarageWidthM : kOverhangM);
}

void AddHouse(const HouseSpec& spec, const Affine3f& frame, HashSequence& draw,
              MeshBuilder& builder) {
  const Materials m = DrawMaterials(draw, builder);
  const float w = spec.width_m, d = spec.depth_m;
  const float knee = spec.floors == 1 ? Between(draw, 0.2, 0.9) : 0.25f;
  const float height = kPlinthM + static_cast<float>(spec.floors) * kFloorM + knee;
  const float window_w = Between(draw, 0.95, 1.5), window_h = Between(draw, 1.1, 1.45);

  builder.SetFrame(frame);
  builder.Box({-w / 2 - 0.03f, -0.03f, -1.3f}, {w / 2 + 0.03f, d + 0.03f, kPlinthM}, m.plinth,
              false);
  struct Side {
    Vector3f origin;
    float yaw, length;
  };
  const std::array<Side, 4> sides = {Side{{-w / 2, 0, 0}, 0, w},
                                     Side{{w / 2, 0, 0}, static_cast<float>(M_PI) / 2, d},
                                     Side{{w / 2, d, 0}, static_cast<float>(M_PI), w},
                                     Side{{-w / 2, d, 0}, -static_cast<float>(M_PI) / 2, d}};
  const float door = Between(draw, 0.25, 0.75) * w;
  for (size_t i = 0; i < sides.size(); ++i) {
    std::vector<WindowSpec> windows;
    if (spec.detailed) {
      windows = WindowGrid(sides[i].length, spec.floors, window_w, window_h, draw);
    }
    if (spec.detailed && i == 0) PutDoor(door, 1.1f, &windows);
    if (spec.garage && i == 1) {
      std::erase_if(windows,
                    [](const WindowSpec& window) { return window.opening.bottom_m < 2.9f; });
    }
    AddWall(frame * FrameAt(sides[i].origin, sides[i].yaw), sides[i].length, height, windows,
            m.windows, m.wall, m.reveal, draw, builder);
  }

  const float slope = Between(draw, 0.65, 1.15);
  const bool across = spec.roof == RoofKind::kGableAcross;
  const float rise = slope * (across ? w : d) / 2;
  switch (spec.roof) {
    case RoofKind::kGableAlong:
      AddGableRoof(frame, w, d, height, rise, m, builder);
      break;
    case RoofKind::kGableAcross:
      AddGableRoof(frame * FrameAt({w / 2, d / 2, 0}, static_cast<float>(M_PI) / 2), d, w, height,
                   rise, m, builder);
      break;
    case RoofKind::kHip:
      AddHipRoof(w, d, height, 0.7f * rise, m, frame, builder);
      break;
    case RoofKind::kFlat:
      builder.SetFrame(frame);
      builder.Box({-w / 2 - 0.25f, -0.25f, height}, {w / 2 + 0.25f, d + 0.25f, height + 0.3f},
                  m.trim);
      break;
  }
  if (!spec.detailed) return;

  if (across && rise > 2.6f) {  // a window under the roof
    WindowStyle style = m.windows;
    style.shutters = false;
    style.reveal_m = 0.05f;
    AddWall(frame * FrameAt({-0.75f, -0.06f, height + 0.35f}), 1.5f, 1.5f,
            {{{0.15f, 0.15f, 1.2f, 1.2f}}}, style, m.gable, m.reveal, draw, builder);
  }
  if (spec.roof == RoofKind::kGableAlong && draw.Chance(0.5)) {
    const int count = 1 + static_cast<int>(draw.Below(2));
    for (int i = 0; i < count; ++i) {
      const float x = w * ((static_cast<float>(i) + 0.5f) / static_cast<float>(count) - 0.5f);
      AddDormer(x, height, slope, m, frame, draw, builder);
    }
  }
  builder.SetFrame(frame);
  if (spec.roof != RoofKind::kFlat) {
    const float x = Between(draw, -0.3, 0.3) * w, y = Between(draw, 0.55, 0.7) * d;
    const float top = height + rise * (spec.roof == RoofKind::kHip ? 0.75f : 1) + 0.6f;
    builder.Box({x - 0.3f, y - 0.25f, height}, {x + 0.3f, y + 0.25f, top}, m.plinth, false);
    builder.Box({x - 0.36f, y - 0.31f, top}, {x + 0.36f, y + 0.31f, top + 0.1f}, m.concrete);
  }
  const float door_x = door - w / 2;  // steps, and a roof over the door
  builder.Box({door_x - 0.8f, -0.95f, -0.4f}, {door_x + 0.8f, 0, kPlinthM / 2}, m.concrete, false);
  builder.Box({door_x - 0.8f, -0.6f, -0.4f}, {door_x + 0.8f, 0, kPlinthM - 0.02f}, m.concrete,
              false);
  if (draw.Chance(0.6)) {
    AddSlab({{door_x - 1, -1.1f, kPlinthM + 2.3f},
             {door_x + 1, -1.1f, kPlinthM + 2.3f},
             {door_x + 1, 0, kPlinthM + 2.6f},
             {door_x - 1, 0, kPlinthM + 2.6f}},
            0.1f, m.roof, m.trim, builder);
  }
  for (const float x : {-w / 2 + 0.15f, w / 2 - 0.15f}) {  // rain pipes
    if (spec.roof == RoofKind::kGableAcross) continue;
    builder.Cylinder({x, -0.08f, 0}, {x, -0.08f, height - 0.3f}, 0.045f, 5, m.metal, false);
  }
  if (spec.floors == 2 && draw.Chance(0.25)) {
    AddBalcony(door_x > 0 ? -w / 4 : w / 4, kPlinthM + kFloorM, m, frame, builder);
  }
  if (spec.garage) AddGarage(spec, m, frame, draw, builder);
}

}  // namespace carmap
