#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "carmap/sim/town/buildings.h"
#include "carmap/sim/town/ground_mesh.h"
#include "carmap/sim/town/scenes.h"
#include "carmap/sim/town/street.h"

namespace carmap {
namespace {

/// A building before it is built: its neighbours tell which of its sides can be seen.
struct Lot {
  RoadSide side;
  FacadeSpec facade;
  Eigen::Vector2d origin;
  double begin_m, end_m, heading_rad;
  uint64_t seed;
};

GroundBox FacadeBox(const FacadeSpec& spec, const Eigen::Vector2d& origin, double heading_rad) {
  const Eigen::Vector2d y(-std::sin(heading_rad), std::cos(heading_rad));
  return {origin + spec.depth_m / 2 * y, heading_rad, spec.width_m / 2 - 0.02,
          spec.depth_m / 2 - 0.02};
}

/// As near to the sidewalk as its front fits in a bend.
std::optional<Lot> FindLot(const Site& site, const RoadSide& side, double begin_m,
                           const FacadeSpec& spec) {
  const double middle_m = begin_m + spec.width_m / 2;
  Lot lot{.side = side,
          .facade = spec,
          .begin_m = begin_m,
          .end_m = begin_m + spec.width_m,
          .heading_rad = side.BuildingHeading(middle_m)};
  for (double back_m = 0; back_m < 2; back_m += 0.25) {
    lot.origin = side.At(middle_m, side.sidewalk_m() + 0.05 + back_m);
    if (site.IsFree(FacadeBox(spec, lot.origin, lot.heading_rad), side.sidewalk_m() - 0.1)) {
      return lot;
    }
  }
  return std::nullopt;
}

std::vector<Lot> DivideIntoLots(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x6c6f7473);
  std::vector<Lot> lots;
  for (double s = draw.Between(0, 3); s < side.length_m() - 6;) {
    if (draw.Chance(0.04)) {
      s += draw.Between(8, 22);  // a yard, a small square
      continue;
    }
    FacadeSpec spec = DrawFacade(draw);
    const uint64_t seed = draw.Next();
    std::optional<Lot> lot = FindLot(site, side, s, spec);
    if (!lot) {
      spec.width_m = std::min(spec.width_m, 8.0f);  // what is left before a corner
      lot = FindLot(site, side, s, spec);
    }
    if (!lot) {
      s += 1;
      continue;
    }
    site.occupancy().Add(FacadeBox(lot->facade, lot->origin, lot->heading_rad));
    lot->seed = seed;
    s = lot->end_m;
    lots.push_back(*lot);
  }
  return lots;
}

/// Whether a part of the ground beside a building is free: then that side has windows.
bool IsOpen(const Site& site, const Lot& lot, double towards_x) {
  const GroundBox box = FacadeBox(lot.facade, lot.origin, lot.heading_rad);
  const double beyond = towards_x * (1 + 1.2 / box.half_length_m);
  for (const double inwards : {-0.8, 0.0, 0.8}) {
    if (site.occupancy().IsFree({box.At(beyond, inwards), lot.heading_rad, 0.3, 0.5})) return true;
  }
  return false;
}

void BuildLot(Site& site, Lot lot) {
  lot.facade.right_open = IsOpen(site, lot, 1);
  lot.facade.left_open = IsOpen(site, lot, -1);
  HashSequence draw(lot.seed);
  AddFacade(lot.facade, site.FrameInTile(lot.origin, site.At(lot.origin), lot.heading_rad), draw,
            site.TileAt(lot.origin));
  if (!draw.Chance(0.05)) return;
  // Being renovated: scaffolding before it.
  for (double s = lot.begin_m + 3; s + 3 <= lot.end_m; s += 6) {
    site.Place("scaffolding", static_cast<uint32_t>(draw.Below(10)),
               lot.side.At(s, lot.side.sidewalk_m() - 0.75),
               {.heading_rad = lot.side.Heading(s), .edge_m = 0.4, .lift_m = kSidewalkHeightM},
               draw);
  }
}

/// A building across the end of a street.
void CloseDeadEnd(Site& site, const RoadSide& side, std::vector<Lot>* lots) {
  HashSequence draw = side.Draw(0x656e64);
  const RoutePoint end = side.line->path.At(side.length_m() + side.sidewalk_m() + 0.3);
  Lot lot{.side = side, .facade = DrawFacade(draw), .origin = end.position_in_enu};
  lot.heading_rad = end.heading_rad - M_PI / 2;
  lot.facade.width_m = std::max(lot.facade.width_m, 14.0f);
  lot.seed = draw.Next();
  const GroundBox box = FacadeBox(lot.facade, lot.origin, lot.heading_rad);
  if (!site.IsFree(box, 0.2)) return;
  site.occupancy().Add(box);
  lots->push_back(lot);
}

void FurnishCorners(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x636f726e);
  const auto place = [&](std::string_view kind, double s, double out_m) {
    site.Place(kind, static_cast<uint32_t>(draw.Below(100)), side.At(s, out_m),
               {.heading_rad = side.Heading(s), .lift_m = kSidewalkHeightM}, draw);
  };
  for (const CentreLine::Junction& junction : side.line->junctions) {
    const bool signals = UnitHash(side.line->seed, static_cast<uint64_t>(junction.begin_m)) < 0.6;
    // Where one who drives on this side comes up to it.
    const double s = side.side < 0 ? junction.begin_m - 4 : junction.end_m + 4;
    if (s < 2 || s > side.length_m() - 2) continue;
    if (signals) place("traffic-light", s, 0.6);
    place("street-name", s + side.side * 1.2, 0.8);
    for (double back = 6; back < 14; back += 1.6) {
      if (draw.Chance(0.7)) place("bollard", s + side.side * back, 0.4);
    }
  }
}

void FurnishSidewalk(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x66757273);
  const double inner_m = side.sidewalk_m() - 0.5, lift = kSidewalkHeightM;
  AddRow(site, side,
         {.kind = "lamp",
          .spacing_m = 32,
          .jitter_m = 2,
          .out_m = 0.5,
          .lift_m = lift,
          .one_variant = true},
         1);
  AddRow(site, side,
         {.kind = "traffic-sign", .spacing_m = 24, .jitter_m = 10, .out_m = 0.4, .lift_m = lift},
         2);
  if (draw.Chance(0.55)) {
    const bool young = draw.Chance(0.5);
    AddRow(site, side,
           {.kind = young ? "young-tree" : "tree",
            .spacing_m = draw.Between(9, 15),
            .out_m = 0.8,
            .chance = 0.85,
            .margin_m = 0.3,
            .scale_low = 0.6,
            .scale_high = 0.85,
            .one_variant = true},
           3);
  }
  AddRow(site, side,
         {.kind = "bus-stop",
          .spacing_m = 220,
          .jitter_m = 90,
          .out_m = inner_m - 0.5,
          .lift_m = lift},
         4);
  AddRow(site, side,
         {.kind = "advertising-column",
          .spacing_m = 110,
          .jitter_m = 45,
          .out_m = 1.1,
          .lift_m = lift},
         5);
  AddRow(
      site, side,
      {.kind = "kiosk", .spacing_m = 260, .jitter_m = 110, .out_m = inner_m - 0.8, .lift_m = lift},
      6);
  AddRow(site, side, {.kind = "bin", .spacing_m = 26, .jitter_m = 12, .out_m = 0.5, .lift_m = lift},
         7);
  AddRow(site, side,
         {.kind = "bench",
          .spacing_m = 45,
          .jitter_m = 20,
          .out_m = inner_m,
          .chance = 0.6,
          .lift_m = lift},
         8);
  AddRow(site, side,
         {.kind = "planter",
          .spacing_m = 30,
          .jitter_m = 14,
          .out_m = inner_m,
          .chance = 0.6,
          .lift_m = lift},
         9);
  AddRow(site, side,
         {.kind = "electric-box",
          .spacing_m = 48,
          .jitter_m = 20,
          .out_m = inner_m,
          .chance = 0.7,
          .lift_m = lift},
         10);
  AddRow(site, side,
         {.kind = "bollard",
          .spacing_m = 7,
          .jitter_m = 3,
          .out_m = 0.35,
          .chance = draw.Chance(0.4) ? 0.8 : 0.1,
          .lift_m = lift,
          .one_variant = true},
         11);
  AddRow(site, side,
         {.kind = "mailbox", .spacing_m = 90, .jitter_m = 40, .out_m = inner_m, .lift_m = lift},
         12);
  AddRow(site, side,
         {.kind = "container",
          .spacing_m = 240,
          .jitter_m = 100,
          .out_m = side.sidewalk_m() + 3,
          .lift_m = 0},
         13);
  AddRow(site, side,
         {.kind = "billboard", .spacing_m = 60, .jitter_m = 30, .out_m = side.sidewalk_m() + 2},
         14);
}

}  // namespace

void FurnishDowntown(Site& site) {
  AddKerbs(site);
  const std::vector<RoadSide> sides = RoadSidesOf(site);
  std::vector<Lot> lots;
  for (const RoadSide& side : sides) {
    const std::vector<Lot> along = DivideIntoLots(site, side);
    lots.insert(lots.end(), along.begin(), along.end());
  }
  for (const RoadSide& side : sides) {
    if (side.side > 0 && IsDeadEnd(*side.line)) CloseDeadEnd(site, side, &lots);
  }
  for (const Lot& lot : lots) BuildLot(site, lot);
  for (const RoadSide& side : sides) {
    FurnishCorners(site, side);
    FurnishSidewalk(site, side);
    AddKerbParking(site, side);
    AddRoadWear(site, side);
  }
  for (const CentreLine& line : site.roads().lines()) AddRoadMarks(site, line, 0.5);
  FillWithGreen(site, {.near_share = 0.15, .far_share = 0.3, .edge_m = 4.5});
}

}  // namespace carmap
