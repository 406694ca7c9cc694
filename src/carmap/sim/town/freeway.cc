#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/town/buildings.h"
#include "carmap/sim/town/scenes.h"
#include "carmap/sim/town/street.h"

namespace carmap {
namespace {

void AddMedian(Site& site, const CentreLine& line) {
  constexpr double kModuleM = 4;
  HashSequence draw(line.seed, 0x6d656469);
  const auto variant = static_cast<uint32_t>(draw.Below(10));
  for (double s = kModuleM / 2; s < line.path.length_m(); s += kModuleM) {
    const RoutePoint at = line.path.At(s);
    site.Place("concrete-barrier", variant, at.position_in_enu,
               {.heading_rad = at.heading_rad, .edge_m = 0.05}, draw);
  }
}

/// Over one direction: a foot in the median, the other beyond the hard shoulder.
void AddGantries(Site& site, const RoadSide& side) {
  constexpr double kFeetM = 18.4;  // apart, in the model
  HashSequence draw = side.Draw(0x67616e74);
  const double outer_m = side.EdgeM() + 0.9;
  for (double s = draw.Between(60, 300); s < side.length_m() - 30; s += draw.Between(400, 700)) {
    const double left_m = side.side * outer_m / 2;
    const RoutePoint at = side.line->path.At(s, left_m);
    site.PlaceAnyway("gantry", static_cast<uint32_t>(draw.Below(10)), at.position_in_enu,
                     {.heading_rad = side.Heading(s), .scale = outer_m / kFeetM}, draw);
    site.occupancy().Add({side.At(s, 0.9), side.Heading(s), 0.9, 0.7});
  }
}

/// A road that crosses above: a deck with railings, a wall at each end, a pier in the middle.
bool BuildBridge(Site& site, const CentreLine& line, double along_m, HashSequence& draw) {
  constexpr float kClearM = 5.4f, kTopM = 6.7f, kHalfM = 4.5f, kBeyondM = 4, kAbutmentM = 9;
  const RoutePoint at = line.path.At(along_m);
  const auto half_span = static_cast<float>(line.section.Edge(1)) + kBeyondM;
  const float end = half_span + kAbutmentM;
  const double across = at.heading_rad + M_PI / 2;
  if (!site.occupancy().IsFree({at.position_in_enu, across, end + 1, kHalfM + 0.5})) return false;
  const double reach_m = (kBeyondM + kAbutmentM) / 2;
  for (const int side : {-1, 1}) {
    const RoutePoint foot = line.path.At(along_m, side * (end - reach_m + 0.3));
    site.occupancy().Add({foot.position_in_enu, across, reach_m, kHalfM + 0.5});
  }
  site.occupancy().Add({at.position_in_enu, across, 0.9, kHalfM});

  MeshBuilder& builder = site.TileAt(at.position_in_enu);
  builder.SetFrame(site.FrameInTile(at.position_in_enu, site.At(at.position_in_enu), across));
  const SurfaceIdx concrete =
      builder.Use({Pattern::kConcrete, static_cast<float>(draw.Between(0.3, 0.5)), 1, 0,
                   SemanticClass::kBuilding});
  const SurfaceIdx steel = builder.Use({Pattern::kMetal, 0.3f, 1, 0, SemanticClass::kFence});
  builder.Box({-end, -kHalfM, kClearM}, {end, kHalfM, kTopM}, concrete);
  builder.Box({-0.4f, -kHalfM + 1, -1}, {0.4f, kHalfM - 1, kClearM}, concrete, false);
  for (const float side : {-1.f, 1.f}) {
    const float near = side > 0 ? half_span : -end, far = side > 0 ? end : -half_span;
    builder.Box({near, -kHalfM + 0.3f, -3}, {far, kHalfM - 0.3f, kClearM}, concrete, false);
    const float y = side * (kHalfM - 0.15f);
    builder.Box({-end, y - 0.15f, kTopM}, {end, y + 0.15f, kTopM + 0.35f}, concrete);
    for (const float z : {0.7f, 1.05f}) {
      builder.Box({-end, y - 0.03f, kTopM + z}, {end, y + 0.03f, kTopM + z + 0.06f}, steel);
    }
    for (float x = -end; x <= end; x += 2) {
      builder.Box({x - 0.03f, y - 0.03f, kTopM + 0.35f}, {x + 0.03f, y + 0.03f, kTopM + 1.1f},
                  steel, false);
    }
  }
  return true;
}

void AddBridges(Site& site, const CentreLine& line) {
  HashSequence draw(line.seed, 0x62726964);
  for (double s = draw.Between(150, 500); s < line.path.length_m() - 100;) {
    s += BuildBridge(site, line, s, draw) ? draw.Between(450, 1000) : 25;
  }
}

/// Sound walls or woods beyond the rail, stretch by stretch.
void LineWithWalls(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x77616c6c);
  for (double s = 0; s < side.length_m();) {
    const double length_m = draw.Between(120, 380);
    const auto variant = static_cast<uint32_t>(draw.Below(10));
    const double end_m = std::min(side.length_m(), s + length_m);
    const double kind = draw.Unit();
    if (kind < 0.35) {
      AddModules(site, side, "sound-wall", variant, 4, s, end_m, 3.2, draw);
    } else if (kind < 0.55) {
      AddModules(site, side, "wire-fence", variant, 2, s, end_m, 9, draw);
    }
    s = end_m + draw.Between(20, 200);
  }
}

/// Bushes and trees on the slope beside, thick and thin.
void PlantVerge(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x76657267);
  for (double s = 0; s < side.length_m(); s += 3.2) {
    // Wooded and open stretches of about a hundred metres.
    const double wave = std::sin(s / 37 + draw.Below(2)) + std::sin(s / 83);
    for (const double out_m : {5.5, 9.0, 14.0, 20.0, 28.0}) {
      if (!draw.Chance(wave > 0 ? 0.36 : 0.1)) continue;
      const double kind = draw.Unit();
      const bool bush = kind < (out_m < 8 ? 0.85 : 0.35);
      site.Place(bush ? "bush" : (kind > 0.85 ? "conifer" : "tree"),
                 static_cast<uint32_t>(draw.Below(1000)),
                 side.At(s + draw.Between(-1.5, 1.5), out_m + draw.Between(-1.5, 1.5)),
                 {.heading_rad = draw.Between(-M_PI, M_PI),
                  .scale = draw.Between(0.7, 1.25),
                  .margin_m = bush ? 0.1 : 1,
                  .edge_m = 3.8},
                 draw);
    }
  }
}

/// Farms, halls and houses some way off.
void BuildFarOff(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x6661726f);
  for (double s = draw.Between(0, 60); s < side.length_m(); s += draw.Between(25, 110)) {
    HouseSpec spec = DrawHouse(draw);
    spec.garage = false;
    spec.detailed = draw.Chance(0.5);
    if (draw.Chance(0.3)) {  // a hall
      spec.width_m = static_cast<float>(draw.Between(20, 45));
      spec.depth_m = static_cast<float>(draw.Between(15, 30));
      spec.roof = RoofKind::kFlat;
      spec.floors = 2 + static_cast<int>(draw.Below(2));
    }
    const Eigen::Vector2d origin = side.At(s, draw.Between(40, 110));
    const double heading = side.BuildingHeading(s) + draw.Between(-0.6, 0.6);
    const Eigen::Vector2d y(-std::sin(heading), std::cos(heading));
    const GroundBox box{origin + spec.depth_m / 2 * y, heading, spec.width_m / 2 + 0.5,
                        spec.depth_m / 2 + 0.5};
    HashSequence house(draw.Next());
    if (!site.IsFree(box, 8)) continue;
    site.occupancy().Add(box);
    AddHouse(spec, site.FrameInTile(origin, site.At(origin), heading), house, site.TileAt(origin));
  }
}

void FurnishVerge(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x72616973);
  const auto rail = static_cast<uint32_t>(draw.Below(10));
  for (double s = 0; s < side.length_m();) {
    const double end_m = std::min(side.length_m(), s + draw.Between(150, 500));
    AddModules(site, side, "guard-rail", rail, 4, s, end_m, 0.5, draw);
    s = end_m + (draw.Chance(0.5) ? draw.Between(10, 80) : 0);
  }
  AddRow(site, side,
         {.kind = "bollard", .spacing_m = 50, .jitter_m = 0.5, .out_m = 1.0, .one_variant = true},
         1);
  AddRow(site, side,
         {.kind = "traffic-sign",
          .spacing_m = 150,
          .jitter_m = 60,
          .out_m = 1.6,
          .scale_low = 1.2,
          .scale_high = 1.6},
         2);
  AddRow(site, side, {.kind = "billboard", .spacing_m = 330, .jitter_m = 150, .out_m = 4.6}, 3);
  AddRow(site, side, {.kind = "electric-box", .spacing_m = 210, .jitter_m = 90, .out_m = 2}, 4);
  if (draw.Chance(0.5)) AddPoleLine(site, side, 7, 55, 0);
}

}  // namespace

void FurnishFreeway(Site& site) {
  const std::vector<RoadSide> sides = RoadSidesOf(site);
  for (const RoadSide& side : sides) AddGantries(site, side);
  for (const CentreLine& line : site.roads().lines()) {
    if (line.kind != CentreLine::Kind::kMain) continue;
    AddBridges(site, line);
    AddMedian(site, line);
  }
  for (const RoadSide& side : sides) LineWithWalls(site, side);
  for (const RoadSide& side : sides) FurnishVerge(site, side);
  for (const RoadSide& side : sides) BuildFarOff(site, side);
  for (const RoadSide& side : sides) {
    PlantVerge(site, side);
    AddRoadWear(site, side);
  }
  FillWithGreen(site, {.near_share = 0.15, .far_share = 0.2, .edge_m = 6});
}

}  // namespace carmap
