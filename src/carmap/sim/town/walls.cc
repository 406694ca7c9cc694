#include <algorithm>
#include <cmath>

#include "carmap/sim/town/buildings.h"

namespace carmap {
namespace {

using Eigen::Vector3f;

/// A rectangle in a plane parallel to the wall, `y` behind it.
void Pane(float left, float bottom, float right, float top, float y, SurfaceIdx surface,
          const Eigen::Vector2f& uv, MeshBuilder& builder) {
  builder.Quad({left, y, bottom}, {right, y, bottom}, {right, y, top}, {left, y, top}, surface, uv);
}

/// The border of a casement and its bars, a little in front of the glass.
void AddCasement(const WallOpening& o, float y, int columns, bool crossed, const WindowStyle& style,
                 MeshBuilder& builder) {
  const float left = o.left_m, right = o.left_m + o.width_m;
  const float bottom = o.bottom_m, top = o.bottom_m + o.height_m, bar = style.frame_m;
  const Eigen::Vector2f uv(left, bottom);
  Pane(left, bottom, right, bottom + bar, y, style.frame, uv, builder);
  Pane(left, top - bar, right, top, y, style.frame, uv, builder);
  Pane(left, bottom + bar, left + bar, top - bar, y, style.frame, uv, builder);
  Pane(right - bar, bottom + bar, right, top - bar, y, style.frame, uv, builder);
  for (int i = 1; i < columns; ++i) {
    const float x = left + o.width_m * static_cast<float>(i) / static_cast<float>(columns);
    Pane(x - 0.6f * bar, bottom + bar, x + 0.6f * bar, top - bar, y, style.frame, uv, builder);
  }
  if (crossed) {
    const float z = bottom + 0.68f * o.height_m;
    Pane(left + bar, z - 0.4f * bar, right - bar, z + 0.4f * bar, y, style.frame, uv, builder);
  }
}

void AddWindow(const WallOpening& o, const WindowStyle& style, HashSequence& draw,
               MeshBuilder& builder) {
  const float right = o.left_m + o.width_m, top = o.bottom_m + o.height_m;
  const Eigen::Vector2f uv(static_cast<float>(draw.Between(0, 50)),
                           static_cast<float>(draw.Between(0, 50)));
  const bool curtain = draw.Chance(0.45);
  Pane(o.left_m, o.bottom_m, right, top, style.reveal_m, curtain ? style.curtain : style.glass, uv,
       builder);
  AddCasement(o, style.reveal_m - 0.02f, o.width_m > 0.9f ? (o.width_m > 1.9f ? 3 : 2) : 1,
              style.crossed, style, builder);
  if (draw.Chance(style.blind_share)) {
    const float share = draw.Chance(0.3) ? 1 : static_cast<float>(draw.Between(0.15, 0.8));
    Pane(o.left_m, top - share * o.height_m, right, top, style.reveal_m - 0.05f, style.blind, uv,
         builder);
  }
  if (style.sill != kNoSurface) {
    builder.Box({o.left_m - 0.06f, -0.06f, o.bottom_m - 0.06f}, {right + 0.06f, 0.02f, o.bottom_m},
                style.sill);
  }
  if (style.shutters) {
    const float leaf = o.width_m / 2;
    builder.Box({o.left_m - leaf - 0.03f, -0.05f, o.bottom_m}, {o.left_m - 0.03f, -0.005f, top},
                style.blind);
    builder.Box({right + 0.03f, -0.05f, o.bottom_m}, {right + leaf + 0.03f, -0.005f, top},
                style.blind);
  }
}

void AddDoor(const WallOpening& o, const WindowStyle& style, HashSequence& draw,
             MeshBuilder& builder) {
  const float right = o.left_m + o.width_m, top = o.bottom_m + o.height_m;
  Pane(o.left_m, o.bottom_m, right, top, style.reveal_m, style.door, {o.left_m, 0}, builder);
  if (draw.Chance(0.7)) {  // a light in its upper half
    const WallOpening light{o.left_m + 0.25f * o.width_m, o.bottom_m + 0.5f * o.height_m,
                            0.5f * o.width_m, 0.4f * o.height_m};
    Pane(light.left_m, light.bottom_m, light.left_m + light.width_m,
         light.bottom_m + light.height_m, style.reveal_m - 0.015f, style.glass, {0, 0}, builder);
    AddCasement(light, style.reveal_m - 0.025f, 1, false, style, builder);
  }
  builder.Box({right - 0.18f, style.reveal_m - 0.07f, o.bottom_m + 0.95f},
              {right - 0.1f, style.reveal_m, o.bottom_m + 1.1f}, style.glass);
}

void AddShopWindow(const WallOpening& o, const WindowStyle& style, HashSequence& draw,
                   MeshBuilder& builder) {
  const float right = o.left_m + o.width_m, top = o.bottom_m + o.height_m;
  const float y = style.reveal_m + 0.1f;
  const Eigen::Vector2f uv(static_cast<float>(draw.Between(0, 90)),
                           static_cast<float>(draw.Between(0, 90)));
  const int columns = std::max(1, static_cast<int>(std::lround(o.width_m / 1.5f)));
  const float step = o.width_m / static_cast<float>(columns);
  for (int i = 0; i < columns; ++i) {
    const float left = o.left_m + static_cast<float>(i) * step;
    const SurfaceIdx pane = draw.Chance(0.55) ? style.poster : style.glass;
    Pane(left, o.bottom_m, left + step, top, y, pane, uv + Eigen::Vector2f(left, 0), builder);
  }
  builder.Quad({o.left_m, style.reveal_m, o.bottom_m}, {right, style.reveal_m, o.bottom_m},
               {right, y, o.bottom_m}, {o.left_m, y, o.bottom_m}, style.frame);
  AddCasement(o, y - 0.02f, columns, draw.Chance(0.5), style, builder);
}

}  // namespace

void AddWall(const Eigen::Affine3f& frame, float length_m, float height_m,
             const std::vector<WindowSpec>& windows, const WindowStyle& style, SurfaceIdx wall,
             SurfaceIdx reveal, HashSequence& draw, MeshBuilder& builder) {
  builder.SetFrame(frame);
  std::vector<WallOpening> openings;
  for (const WindowSpec& window : windows) openings.push_back(window.opening);
  const Eigen::Vector2f uv(static_cast<float>(draw.Between(0, 90)), 0);
  builder.Wall(Vector3f::Zero(), {length_m, 0, 0}, height_m, openings, style.reveal_m, wall, reveal,
               uv);
  for (const auto& [opening, kind] : windows) {
    switch (kind) {
      case WindowSpec::Kind::kWindow:
        AddWindow(opening, style, draw, builder);
        break;
      case WindowSpec::Kind::kDoor:
        AddDoor(opening, style, draw, builder);
        break;
      case WindowSpec::Kind::kShop:
        AddShopWindow(opening, style, draw, builder);
        break;
      case WindowSpec::Kind::kGarage:
        Pane(opening.left_m, opening.bottom_m, opening.left_m + opening.width_m,
             opening.bottom_m + opening.height_m, style.reveal_m, style.blind, {0, 0}, builder);
        break;
    }
  }
}

void AddSlab(const Points3& top, float thickness_m, SurfaceIdx top_surface, SurfaceIdx edge_surface,
             MeshBuilder& builder) {
  const Vector3f down(0, 0, -thickness_m);
  builder.Polygon(top, top_surface);
  Points3 bottom;
  for (auto p = top.rbegin(); p != top.rend(); ++p) bottom.push_back(*p + down);
  builder.Polygon(bottom, edge_surface);
  for (size_t i = 0; i < top.size(); ++i) {
    const Vector3f &a = top[i], &b = top[(i + 1) % top.size()];
    builder.Quad(a + down, b + down, b, a, edge_surface);
  }
}

}  // namespace carmap
