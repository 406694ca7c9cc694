#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/town/buildings.h"

namespace carmap {
namespace {

using Eigen::Affine3f;
using Eigen::Vector3f;

constexpr float kHalfPi = static_cast<float>(M_PI) / 2;

float Between(HashSequence& draw, double low, double high) {
  return static_cast<float>(draw.Between(low, high));
}

Surface Building(Pattern pattern, float albedo, float contrast = 1, float gloss = 0) {
  return {pattern, albedo, contrast, gloss, SemanticClass::kBuilding};
}

/// Measures and materials of one façade, which repeat over all of it.
struct Style {
  SurfaceIdx wall, ground_wall, trim, roof, metal, sign, awning, reveal;
  WindowStyle windows;
  float ground_floor_m, floor_m, window_w, window_h, step_m;
  bool cornices, surrounds, balconies, modern;

  float EavesM(int floors) const {
    return ground_floor_m + static_cast<float>(floors - 1) * floor_m + 0.25f;
  }
};

Style DrawStyle(const FacadeSpec& spec, HashSequence& draw, MeshBuilder& builder) {
  Style s;
  s.modern = draw.Chance(0.25);
  const double material = draw.Unit();
  const Surface wall = s.modern         ? Building(Pattern::kConcrete, Between(draw, 0.3, 0.6))
                       : material < 0.6 ? Building(Pattern::kPlaster, Between(draw, 0.3, 0.7))
                       : material < 0.8 ? Building(Pattern::kBrick, Between(draw, 0.15, 0.28))
                                        : Building(Pattern::kStone, Between(draw, 0.3, 0.5));
  s.wall = builder.Use(wall);
  s.ground_wall =
      draw.Chance(0.5) ? builder.Use(Building(Pattern::kStone, Between(draw, 0.2, 0.45))) : s.wall;
  s.trim = builder.Use(Building(Pattern::kPlaster, std::min(0.75f, wall.albedo * 1.3f), 0.5f));
  s.reveal = builder.Use(Building(Pattern::kPlain, std::min(0.7f, wall.albedo * 1.1f)));
  s.roof = builder.Use(Building(Pattern::kRoofTiles, Between(draw, 0.08, 0.2)));
  s.metal = builder.Use(Building(Pattern::kMetal, Between(draw, 0.08, 0.3)));
  s.sign = builder.Use(Building(Pattern::kSign, Between(draw, 0.2, 0.6)));
  s.awning = builder.Use(Building(Pattern::kFabric, Between(draw, 0.15, 0.6)));
  const float frame = draw.Chance(0.65) ? 0.72f : 0.12f;
  s.windows = {.frame = builder.Use(Building(Pattern::kPlain, frame)),
               .glass = builder.Use(Building(Pattern::kGlass, 0.05f, 1, 0.4f)),
               .curtain = builder.Use(Building(Pattern::kCurtain, 0.35f, 1, 0.15f)),
               .blind = builder.Use(Building(Pattern::kWood, Between(draw, 0.25, 0.65))),
               .poster = builder.Use(Building(Pattern::kPoster, 0.3f, 1, 0.15f)),
               .sill = s.modern ? kNoSurface : s.trim,
               .door = builder.Use(Building(Pattern::kWood, Between(draw, 0.08, 0.3))),
               .reveal_m = Between(draw, 0.14, 0.22),
               .shutters = !s.modern && draw.Chance(0.12),
               .crossed = draw.Chance(0.5),
               .blind_share = Between(draw, 0.05, 0.3)};
  s.ground_floor_m = spec.shop ? Between(draw, 3.6, 4.2) : Between(draw, 3.1, 3.5);
  s.floor_m = Between(draw, 2.8, 3.4);
  s.window_w = s.modern ? Between(draw, 1.5, 2.3) : Between(draw, 0.95, 1.35);
  s.window_h = s.modern ? Between(draw, 1.3, 1.6) : Between(draw, 1.6, 2.05);
  s.step_m = s.window_w + Between(draw, s.windows.shutters ? 1.5 : 0.9, 1.7);
  s.cornices = !s.modern && draw.Chance(0.7);
  s.surrounds = !s.modern && !s.windows.shutters && draw.Chance(0.35);
  s.balconies = draw.Chance(0.35);
  return s;
}

std::vector<WindowSpec> UpperWindows(const Style& s, float length_m, int floors) {
  std::vector<WindowSpec> windows;
  const int columns = std::max(1, static_cast<int>((length_m - 0.6f) / s.step_m));
  const float step = length_m / static_cast<float>(columns);
  for (int floor = 1; floor < floors; ++floor) {
    const float bottom = s.ground_floor_m + static_cast<float>(floor - 1) * s.floor_m +
                         0.85f * (s.floor_m - s.window_h);
    for (int column = 0; column < columns; ++column) {
      const float centre = (static_cast<float>(column) + 0.5f) * step;
      windows.push_back({{centre - s.window_w / 2, bottom, s.window_w, s.window_h}});
    }
  }
  return windows;
}

std::vector<WindowSpec> GroundFloor(const FacadeSpec& spec, const Style& s, HashSequence& draw) {
  std::vector<WindowSpec> windows;
  const float door_w = 1.2f, margin = 0.5f;
  if (spec.shop) {
    const int panes = std::max(1, static_cast<int>((spec.width_m - 2 * margin) / 4.2f));
    const int door = static_cast<int>(draw.Below(static_cast<uint32_t>(panes) + 1));
    const float gap = 0.45f;
    const float pane_w = (spec.width_m - 2 * margin - door_w - static_cast<float>(panes) * gap) /
                         static_cast<float>(panes);
    float x = margin;
    for (int i = 0; i <= panes; ++i) {
      if (i == door) {
        windows.push_back({{x, 0.12f, door_w, 2.4f}, WindowSpec::Kind::kDoor});
        x += door_w + gap;
      }
      if (i == panes) break;
      windows.push_back({{x, 0.45f, pane_w, s.ground_floor_m - 1.35f}, WindowSpec::Kind::kShop});
      x += pane_w + gap;
    }
    return windows;
  }
  const int columns = std::max(1, static_cast<int>((spec.width_m - 0.6f) / s.step_m));
  const float step = spec.width_m / static_cast<float>(columns);
  const int door = static_cast<int>(draw.Below(static_cast<uint32_t>(columns)));
  for (int i = 0; i < columns; ++i) {
    const float centre = (static_cast<float>(i) + 0.5f) * step;
    if (i == door) {
      windows.push_back({{centre - door_w / 2, 0.12f, door_w, 2.3f}, WindowSpec::Kind::kDoor});
    } else {
      windows.push_back({{centre - s.window_w / 2, 1.05f, s.window_w, 0.85f * s.window_h}});
    }
  }
  return windows;
}

/// Mouldings between floors and round windows, signs, awnings, balconies: what sticks out.
void AddOrnaments(const FacadeSpec& spec, const Style& s, const std::vector<WindowSpec>& windows,
                  const Affine3f& frame, HashSequence& draw, MeshBuilder& builder) {
  const float half = spec.width_m / 2, eaves = s.EavesM(spec.floors);
  builder.SetFrame(frame);
  if (s.cornices) {
    builder.Box({-half, -0.12f, s.ground_floor_m - 0.12f}, {half, 0, s.ground_floor_m + 0.1f},
                s.trim);
    builder.Box({-half, -0.35f, eaves - 0.35f}, {half, 0, eaves}, s.trim);
    builder.Box({-half, -0.2f, eaves - 0.6f}, {half, 0, eaves - 0.35f}, s.trim);
  }
  if (spec.shop) {
    const float bottom = s.ground_floor_m - 0.75f;
    const float left = -half + Between(draw, 0.2, 1.5), right = half - Between(draw, 0.2, 1.5);
    builder.Box({left, -0.14f, bottom}, {right, -0.01f, bottom + 0.55f}, s.sign);
    if (draw.Chance(0.4)) {
      AddSlab({{left, -1.5f, bottom - 0.55f},
               {right, -1.5f, bottom - 0.55f},
               {right, -0.05f, bottom - 0.02f},
               {left, -0.05f, bottom - 0.02f}},
              0.05f, s.awning, s.awning, builder);
    }
    if (draw.Chance(0.6)) {  // a sign that sticks out over the sidewalk
      const float x = draw.Chance(0.5) ? left : right, z = s.ground_floor_m + 0.2f;
      builder.Box({x - 0.07f, -1.0f, z}, {x + 0.07f, -0.15f, z + Between(draw, 0.6, 1.6)}, s.sign);
      builder.Box({x - 0.02f, -0.15f, z + 0.2f}, {x + 0.02f, 0, z + 0.25f}, s.metal);
    }
  }
  for (const WindowSpec& window : windows) {
    const WallOpening& o = window.opening;
    if (window.kind != WindowSpec::Kind::kWindow || o.bottom_m < s.ground_floor_m) continue;
    const float left = o.left_m - half, right = left + o.width_m, top = o.bottom_m + o.height_m;
    if (s.surrounds) {
      builder.Box({left - 0.16f, -0.1f, top + 0.02f}, {right + 0.16f, 0, top + 0.2f}, s.trim);
    }
  }
  if (s.balconies) {
    for (const WindowSpec& window : windows) {
      const WallOpening& o = window.opening;
      const bool column = std::lround(o.left_m / s.step_m) % 3 == 1;
      if (window.kind != WindowSpec::Kind::kWindow || o.bottom_m < s.ground_floor_m || !column) {
        continue;
      }
      const float left = o.left_m - half - 0.3f, right = left + o.width_m + 0.6f;
      const float z = o.bottom_m - 0.25f;
      builder.Box({left, -1, z - 0.15f}, {right, 0, z}, s.trim);
      builder.Box({left, -1, z + 0.88f}, {right, -0.94f, z + 0.94f}, s.metal);
      for (const float x : {left, right - 0.04f}) {
        builder.Box({x, -1, z}, {x + 0.04f, -0.96f, z + 0.9f}, s.metal);
        builder.Box({x, -0.96f, z + 0.88f}, {x + 0.04f, 0, z + 0.94f}, s.metal);
      }
      const int bars = static_cast<int>((right - left) / 0.22f);
      for (int i = 1; i < bars; ++i) {
        const float x = left + (right - left) * static_cast<float>(i) / static_cast<float>(bars);
        builder.Quad({x - 0.012f, -0.97f, z}, {x + 0.012f, -0.97f, z},
                     {x + 0.012f, -0.97f, z + 0.9f}, {x - 0.012f, -0.97f, z + 0.9f}, s.metal);
      }
    }
  }
  builder.Cylinder({half - 0.2f, -0.08f, 0}, {half - 0.2f, -0.08f, eaves - 0.4f}, 0.05f, 5, s.metal,
                   false);
}

void AddRoof(const FacadeSpec& spec, const Style& s, const Affine3f& frame, HashSequence& draw,
             MeshBuilder& builder) {
  const float half = spec.width_m / 2, eaves = s.EavesM(spec.floors), d = spec.depth_m;
  builder.SetFrame(frame);
  if (s.modern || draw.Chance(0.25)) {
    builder.Box({-half, 0, eaves}, {half, d, eaves + 0.5f}, s.wall, false);
    const float x = Between(draw, -0.3, 0.3) * spec.width_m;
    builder.Box({x - 1.6f, 3.5f, eaves + 0.5f}, {x + 1.6f, 7, eaves + 2.6f}, s.metal, false);
    return;
  }
  const float rise = Between(draw, 2.6, 4.2), ridge = d / 2;
  const Vector3f a(-half, -0.3f, eaves), b(half, -0.3f, eaves), c(half, d + 0.3f, eaves);
  const Vector3f e(-half, d + 0.3f, eaves), left(-half, ridge, eaves + rise);
  const Vector3f right(half, ridge, eaves + rise);
  builder.Quad(a, b, right, left, s.roof);
  builder.Quad(c, e, left, right, s.roof);
  builder.Polygon({b, c, right}, s.wall);
  builder.Polygon({e, a, left}, s.wall);
  builder.Box({-half, -0.42f, eaves - 0.06f}, {half, -0.3f, eaves + 0.06f}, s.metal);
  const float slope = rise / (ridge + 0.3f);
  const int dormers = draw.Chance(0.55) ? static_cast<int>(spec.width_m / 4) : 0;
  for (int i = 0; i < dormers; ++i) {
    const float x =
        spec.width_m * ((static_cast<float>(i) + 0.5f) / static_cast<float>(dormers) - 0.5f);
    const float front = 0.6f, base = eaves + 0.9f * slope, top = base + 1.5f;
    const float back = front + 1.5f / slope;
    builder.SetFrame(frame);
    builder.Prism({{x - 0.7f, front, base}, {x - 0.7f, front, top}, {x - 0.7f, back, top}},
                  {1.4f, 0, 0}, s.trim, s.trim);
    AddSlab({{x - 0.85f, front - 0.2f, top + 0.1f},
             {x + 0.85f, front - 0.2f, top + 0.1f},
             {x + 0.85f, back, top + 0.2f},
             {x - 0.85f, back, top + 0.2f}},
            0.1f, s.roof, s.metal, builder);
    WindowStyle style = s.windows;
    style.shutters = false;
    style.reveal_m = 0.05f;
    AddWall(frame * FrameAt({x - 0.7f, front - 0.06f, base + 0.1f}), 1.4f, 1.35f,
            {{{0.18f, 0.1f, 1.04f, 1.1f}}}, style, s.trim, s.reveal, draw, builder);
  }
  builder.SetFrame(frame);
  for (int i = 0; i < 2; ++i) {
    const float x = Between(draw, -0.45, 0.4) * spec.width_m, y = ridge + Between(draw, 0.2, 1);
    builder.Box({x, y, eaves + 0.3f}, {x + 0.9f, y + 0.5f, eaves + rise + Between(draw, 0.5, 1.3)},
                s.wall, false);
  }
}

}  // namespace

FacadeSpec DrawFacade(HashSequence& draw) {
  FacadeSpec spec;
  spec.width_m = Between(draw, 9, 18);
  spec.depth_m = Between(draw, 10, 12);
  spec.floors = 3 + static_cast<int>(draw.Below(4));
  spec.shop = draw.Chance(0.6);
  return spec;
}

void AddFacade(const FacadeSpec& spec, const Affine3f& frame, HashSequence& draw,
               MeshBuilder& builder) {
  const Style s = DrawStyle(spec, draw, builder);
  const float half = spec.width_m / 2, d = spec.depth_m, eaves = s.EavesM(spec.floors);
  std::vector<WindowSpec> windows = UpperWindows(s, spec.width_m, spec.floors);
  const std::vector<WindowSpec> ground = GroundFloor(spec, s, draw);

  AddWall(
      frame * FrameAt({-half, 0, s.ground_floor_m}), spec.width_m, eaves - s.ground_floor_m,
      [&] {
        std::vector<WindowSpec> upper = windows;
        for (WindowSpec& window : upper) window.opening.bottom_m -= s.ground_floor_m;
        return upper;
      }(),
      s.windows, s.wall, s.reveal, draw, builder);
  AddWall(frame * FrameAt({-half, 0, 0}), spec.width_m, s.ground_floor_m, ground, s.windows,
          s.ground_wall, s.reveal, draw, builder);
  const auto side = [&](const Vector3f& origin, float yaw, float length, bool open) {
    AddWall(frame * FrameAt(origin, yaw), length, eaves,
            open ? UpperWindows(s, length, spec.floors) : std::vector<WindowSpec>{}, s.windows,
            s.wall, s.reveal, draw, builder);
  };
  side({half, 0, 0}, kHalfPi, d, spec.right_open);
  side({half, d, 0}, 2 * kHalfPi, spec.width_m, true);
  side({-half, d, 0}, -kHalfPi, d, spec.left_open);
  builder.SetFrame(frame);
  builder.Box({-half, 0, -1.5f}, {half, d, 0.1f}, s.ground_wall, false);
  AddRoof(spec, s, frame, draw, builder);
  AddOrnaments(spec, s, windows, frame, draw, builder);
}

}  // namespace carmap
