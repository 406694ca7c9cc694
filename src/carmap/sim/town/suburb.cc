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

/// How a stretch of a street is built up.
enum class Style : uint8_t { kOldStreet, kGardens, kGreen, kBlocks, kPark };

Style StyleAt(const RoadSide& side, double along_m) {
  constexpr double kStretchM = 130;
  const double style = UnitHash(HashKeys(side.line->seed, side.side > 0 ? 11 : 12),
                                static_cast<uint64_t>(along_m / kStretchM));
  if (style < 0.2) return Style::kOldStreet;
  if (style < 0.55) return Style::kGardens;
  if (style < 0.8) return Style::kGreen;
  return style < 0.92 ? Style::kBlocks : Style::kPark;
}

/// A building, and the ground that belongs to it.
struct Plot {
  RoadSide side;
  Style style = Style::kGardens;
  double left_m = 0, right_m = 0, depth_m = 0;  ///< of the building, from its origin
  double begin_m = 0, end_m = 0;                ///< along the road
  double house_m = 0;                           ///< of the building's origin along the road
  double setback_m = 0;                         ///< of its front from the sidewalk
  std::optional<double> garage_m;               ///< where its middle is along the road
  uint64_t seed = 0;
};

GroundBox BuildingBox(double left_m, double right_m, double depth_m, const Eigen::Vector2d& origin,
                      double heading_rad) {
  const Eigen::Vector2d x(std::cos(heading_rad), std::sin(heading_rad)), y(-x.y(), x.x());
  return {origin + (right_m - left_m) / 2 * x + depth_m / 2 * y, heading_rad,
          (left_m + right_m) / 2, depth_m / 2 + 0.45};
}

/// True when it fitted.
bool BuildHouse(Site& site, const HouseSpec& spec, const Eigen::Vector2d& origin,
                double heading_rad, double edge_m, HashSequence draw) {
  const GroundBox box =
      BuildingBox(HouseLeft(spec), HouseRight(spec), spec.depth_m, origin, heading_rad);
  if (!site.IsFree(box, edge_m)) return false;
  site.occupancy().Add(box);
  AddHouse(spec, site.FrameInTile(origin, site.At(origin), heading_rad), draw, site.TileAt(origin));
  return true;
}

/// Flats in a lawn.
bool BuildBlock(Site& site, const FacadeSpec& spec, const Eigen::Vector2d& origin,
                double heading_rad, double edge_m, HashSequence draw) {
  const double half_m = spec.width_m / 2;
  const GroundBox box = BuildingBox(half_m, half_m, spec.depth_m, origin, heading_rad);
  if (!site.IsFree(box, edge_m)) return false;
  site.occupancy().Add(box);
  AddFacade(spec, site.FrameInTile(origin, site.At(origin), heading_rad), draw,
            site.TileAt(origin));
  return true;
}

double DrawSetback(Style style, HashSequence& draw) {
  if (style == Style::kOldStreet) return draw.Between(0.1, 0.8);
  if (style == Style::kGreen) return draw.Between(6, 11);
  return style == Style::kBlocks ? draw.Between(5, 9) : draw.Between(3.2, 6.2);
}

double DrawGap(Style style, HashSequence& draw) {
  if (style == Style::kOldStreet && draw.Chance(0.5)) return 0.1;
  return style == Style::kBlocks ? draw.Between(6, 14) : draw.Between(1.5, 6);
}

/// The plot that begins at `begin_m`, with its building, if that fits.
std::optional<Plot> BuildPlot(Site& site, const RoadSide& side, double begin_m,
                              HashSequence& draw) {
  Plot plot{.side = side, .style = StyleAt(side, begin_m)};
  const double edge_m = side.sidewalk_m() + 0.05;
  plot.setback_m = DrawSetback(plot.style, draw);
  const double gap_m = DrawGap(plot.style, draw);
  plot.seed = draw.Next();
  const auto measure = [&](double left_m, double right_m, double depth_m) {
    plot.left_m = left_m;
    plot.right_m = right_m;
    plot.depth_m = depth_m;
    plot.house_m = begin_m + gap_m / 2 + (side.side > 0 ? left_m : right_m);
    plot.begin_m = begin_m;
    plot.end_m = begin_m + left_m + right_m + gap_m;
    return side.At(plot.house_m, side.sidewalk_m() + plot.setback_m);
  };
  bool fits = false;
  if (plot.style == Style::kBlocks) {
    FacadeSpec spec = DrawFacade(draw);
    spec.shop = draw.Chance(0.15);
    spec.floors = 3 + static_cast<int>(draw.Below(2));
    spec.left_open = spec.right_open = true;
    const Eigen::Vector2d origin = measure(spec.width_m / 2, spec.width_m / 2, spec.depth_m);
    fits = BuildBlock(site, spec, origin, side.BuildingHeading(plot.house_m), edge_m,
                      HashSequence(plot.seed));
  } else {
    HouseSpec spec = DrawHouse(draw);
    spec.garage &= plot.style != Style::kOldStreet;
    const Eigen::Vector2d origin = measure(HouseLeft(spec), HouseRight(spec), spec.depth_m);
    // On the right of the house seen from the street.
    if (spec.garage) plot.garage_m = plot.house_m + side.side * (spec.width_m / 2 + 1.5);
    fits = BuildHouse(site, spec, origin, side.BuildingHeading(plot.house_m), edge_m,
                      HashSequence(plot.seed));
  }
  return fits ? std::optional(plot) : std::nullopt;
}

void BuildPlots(Site& site, const RoadSide& side, std::vector<Plot>* plots) {
  HashSequence draw = side.Draw(0x686f7573);
  for (double s = draw.Between(2, 8); s < side.length_m() - 6;) {
    if (StyleAt(side, s) == Style::kPark || draw.Chance(0.04)) {
      s += draw.Between(15, 32);  // meadows, orchards
      continue;
    }
    const std::optional<Plot> plot = BuildPlot(site, side, s, draw);
    s = plot ? plot->end_m : s + 2.5;
    if (plot) plots->push_back(*plot);
  }
}

/// A house across the end of a street.
void CloseDeadEnd(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x656e64);
  HouseSpec spec = DrawHouse(draw);
  spec.garage = false;
  const double setback_m = draw.Between(2.5, 6);
  const RoutePoint end = side.line->path.At(side.length_m() + side.sidewalk_m() + setback_m);
  BuildHouse(site, spec, end.position_in_enu, end.heading_rad - M_PI / 2, 1,
             HashSequence(draw.Next()));
  const RoutePoint front = side.line->path.At(side.length_m() + side.sidewalk_m() + 0.7);
  const Eigen::Vector2d across(-std::sin(front.heading_rad), std::cos(front.heading_rad));
  AddModulesBetween(site, "hedge", static_cast<uint32_t>(draw.Below(100)), 2,
                    front.position_in_enu - 7 * across, front.position_in_enu + 7 * across, 0.3,
                    draw);
}

/// Houses of the next street, seen between those of this one.
void BuildSecondRow(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x7365636f);
  for (const double row_m : {34.0, 62.0}) {
    for (double s = draw.Between(0, 12); s < side.length_m();) {
      HouseSpec spec = DrawHouse(draw);
      spec.garage = false;
      spec.detailed = row_m < 40;
      const double out_m = side.sidewalk_m() + row_m + draw.Between(-4, 4);
      const double turn = M_PI * draw.Below(2);
      if (BuildHouse(site, spec, side.At(s, out_m), side.BuildingHeading(s) + turn, 10,
                     HashSequence(draw.Next()))) {
        s += spec.width_m + draw.Between(6, 16);
      } else {
        s += 6;
      }
    }
  }
}

GroundCover PavedCover(HashSequence& draw) {
  const Pattern patterns[] = {Pattern::kPaving, Pattern::kCobbles, Pattern::kGravel,
                              Pattern::kAsphalt};
  return {patterns[draw.Below(4)], static_cast<float>(draw.Between(0.17, 0.33)), 1,
          SemanticClass::kTerrain};
}

/// The driveway to the garage, with a car now and then; where along the road it is, if it is free.
std::optional<double> AddDriveway(Site& site, const Plot& plot, HashSequence& draw) {
  constexpr double kWidthM = 2.9, kGarageFrontM = 1.2;
  const RoadSide& side = plot.side;
  const double along_m = *plot.garage_m;
  const double heading = side.BuildingHeading(along_m) + (draw.Chance(0.5) ? 1 : -1) * M_PI / 2;
  const double front_m = side.sidewalk_m() + plot.setback_m + kGarageFrontM - 0.05;
  const GroundBox way{side.At(along_m, front_m / 2), heading, front_m / 2 - 0.5, kWidthM / 2 - 0.1};
  if (!site.occupancy().IsFree(way)) return std::nullopt;
  AddWay(site, side, along_m, side.HasParking() ? -2 : 0, front_m, kWidthM, PavedCover(draw));
  if (front_m - side.sidewalk_m() > 5.2 && draw.Chance(0.6)) {
    const Eigen::Vector2d p = side.At(along_m, front_m - 2.75);
    site.AddParking({.position_in_enu = site.At(p),
                     .heading_rad = static_cast<float>(heading),
                     .pitch_rad = static_cast<float>(site.PitchAt(p, heading)),
                     .length_m = 5});
  }
  return along_m;
}

/// Between the garden and the sidewalk, with gaps for ways.
void AddFrontFence(Site& site, const Plot& plot, const std::vector<double>& ways_m,
                   HashSequence& draw) {
  const RoadSide& side = plot.side;
  const double out_m = side.sidewalk_m() + 0.4;
  // Green gardens hide behind hedges.
  const double kind = draw.Unit() * (plot.style == Style::kGreen ? 0.5 : 1);
  const auto variant = static_cast<uint32_t>(draw.Below(100));
  const Surface wall = {.pattern = draw.Chance(0.5)
                                       ? Pattern::kPlaster
                                       : (draw.Chance(0.5) ? Pattern::kBrick : Pattern::kStone),
                        .albedo = static_cast<float>(draw.Between(0.2, 0.5)),
                        .label = SemanticClass::kWall};
  const double height_m = draw.Between(0.45, 1.2);
  double from_m = plot.begin_m;
  std::vector<double> ends = ways_m;
  std::sort(ends.begin(), ends.end());
  ends.push_back(plot.end_m + 1.7);
  for (const double way_m : ends) {
    const double to_m = way_m - 1.7;
    if (to_m - from_m > 1) {
      if (kind < 0.35) {
        AddModules(site, side, "hedge", variant, 2, from_m, to_m, out_m + 0.2, draw);
      } else if (kind < 0.55) {
        AddModules(site, side, "fence", variant, 2, from_m, to_m, out_m, draw);
      } else if (kind < 0.65) {
        AddModules(site, side, "wire-fence", variant, 2, from_m, to_m, out_m, draw);
      } else if (kind < 0.9) {
        AddGardenWall(site, side, from_m, to_m, out_m, height_m, wall);
      }
    }
    from_m = way_m + 1.7;
  }
}

void PlantGarden(Site& site, const Plot& plot, HashSequence& draw) {
  const RoadSide& side = plot.side;
  const double sidewalk_m = side.sidewalk_m();
  const bool green = plot.style == Style::kGreen;
  const auto place = [&](double low_out, double high_out, double tree_share) {
    const double s = draw.Between(plot.begin_m, plot.end_m),
                 out_m = draw.Between(low_out, high_out);
    const double kind = draw.Unit();
    const bool tree = kind < tree_share;
    const std::string_view name =
        tree ? (kind < 0.25 * tree_share ? "conifer" : "tree") : (kind > 0.95 ? "planter" : "bush");
    site.Place(name, static_cast<uint32_t>(draw.Below(1000)), side.At(s, out_m),
               {.heading_rad = draw.Between(-M_PI, M_PI),
                .scale = tree ? draw.Between(green ? 0.8 : 0.55, green ? 1.4 : 1.05)
                              : draw.Between(0.6, 1.3),
                .margin_m = tree ? 1.2 : 0.1,
                .edge_m = sidewalk_m + 0.3},
               draw);
  };
  // Beds, and a lawn of its own green.
  const Eigen::Vector2d front =
      side.At((plot.begin_m + plot.end_m) / 2, sidewalk_m + plot.setback_m / 2);
  const double heading = side.Heading(plot.house_m);
  Decal lawn;
  lawn.centre_in_enu = front.cast<float>();
  lawn.along = Eigen::Vector2d(std::cos(heading), std::sin(heading)).cast<float>();
  lawn.half_length_m = static_cast<float>((plot.end_m - plot.begin_m) / 2);
  lawn.half_width_m = static_cast<float>(plot.setback_m / 2 + 0.2);
  lawn.on_road_too = false;
  const bool bare = draw.Chance(0.15);
  lawn.cover = {bare ? Pattern::kGravel : Pattern::kGrass,
                static_cast<float>(draw.Between(0.13, 0.22)), 1, SemanticClass::kTerrain};
  site.decals().push_back(lawn);
  Decal bed = lawn;
  bed.half_width_m = 0.45f;
  bed.centre_in_enu = side.At(plot.house_m, sidewalk_m + plot.setback_m - 0.5).cast<float>();
  bed.half_length_m = static_cast<float>(plot.left_m);
  bed.cover = {Pattern::kSoil, 0.12f, 1, SemanticClass::kTerrain};
  site.decals().push_back(bed);

  const double front_m = sidewalk_m + 0.9, house_m = sidewalk_m + plot.setback_m;
  if (plot.setback_m > 2) {
    const int count = (green ? 7 : 4) + static_cast<int>(draw.Below(6));
    for (int i = 0; i < count; ++i) place(front_m, house_m - 0.4, green ? 0.35 : 0.2);
  }
  const double back_m = house_m + plot.depth_m + 1;
  const int count = 3 + static_cast<int>(draw.Below(5));
  for (int i = 0; i < count; ++i) place(back_m, back_m + 14, 0.6);
}

void AddGarden(Site& site, const Plot& plot) {
  HashSequence draw(plot.seed, 0x67617264);
  const RoadSide& side = plot.side;
  const double sidewalk_m = side.sidewalk_m();
  std::vector<double> ways_m;
  if (plot.garage_m) {
    if (const auto way_m = AddDriveway(site, plot, draw)) ways_m.push_back(*way_m);
  }
  if (plot.setback_m > 1.8) {
    const double path_m = plot.house_m + draw.Between(-0.5, 0.5) * plot.left_m;
    AddWay(site, side, path_m, 0, sidewalk_m + plot.setback_m - 0.5, 1.2, PavedCover(draw));
    ways_m.push_back(path_m);
    AddFrontFence(site, plot, ways_m, draw);
    const double depth_m = sidewalk_m + plot.setback_m + plot.depth_m;
    const double kind = draw.Unit();  // along the neighbour's garden
    const auto variant = static_cast<uint32_t>(draw.Below(100));
    if (kind < 0.7) {
      AddModulesBetween(site, kind < 0.3 ? "hedge" : (kind < 0.5 ? "fence" : "wire-fence"), variant,
                        2, side.At(plot.end_m, sidewalk_m + 1), side.At(plot.end_m, depth_m + 8),
                        sidewalk_m + 0.3, draw);
    }
    for (const std::string_view kind_at_path : {"mailbox", "bin", "bin"}) {
      if (!draw.Chance(0.5)) continue;
      site.Place(kind_at_path, static_cast<uint32_t>(draw.Below(100)),
                 side.At(path_m + draw.Between(1, 2.2), sidewalk_m + draw.Between(0.8, 1.6)),
                 {.heading_rad = side.Heading(path_m), .edge_m = sidewalk_m}, draw);
    }
  }
  PlantGarden(site, plot, draw);
}

/// Where nobody has built: old trees, bushes.
void PlantPark(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x7061726b);
  for (double s = 3; s < side.length_m(); s += 4.5) {
    if (StyleAt(side, s) != Style::kPark) continue;
    for (const double out_m : {1.2, 6.0, 12.0, 18.0, 25.0}) {
      if (!draw.Chance(0.6)) continue;
      const double kind = draw.Unit();
      site.Place(kind < 0.5 ? "tree" : (kind < 0.6 ? "conifer" : "bush"),
                 static_cast<uint32_t>(draw.Below(1000)),
                 side.At(s + draw.Between(-2, 2), side.sidewalk_m() + out_m + draw.Between(-1, 2)),
                 {.heading_rad = draw.Between(-M_PI, M_PI),
                  .scale = kind < 0.6 ? draw.Between(0.9, 1.6) : draw.Between(0.7, 1.4),
                  .margin_m = 0.4,
                  .edge_m = side.sidewalk_m() + 0.4},
                 draw);
    }
  }
}

void FurnishSidewalk(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x66757273);
  const double sidewalk_m = side.sidewalk_m(), lift = kSidewalkHeightM;
  AddRow(site, side,
         {.kind = "lamp",
          .spacing_m = 46,
          .jitter_m = 3,
          .out_m = 0.45,
          .lift_m = lift,
          .one_variant = true},
         1);
  AddRow(site, side,
         {.kind = "traffic-sign",
          .spacing_m = 50,
          .jitter_m = 22,
          .out_m = 0.4,
          .chance = 0.8,
          .lift_m = lift},
         2);
  if (draw.Chance(0.35)) AddPoleLine(site, side, sidewalk_m - 0.3, 34, lift);
  if (draw.Chance(0.45)) {
    const bool young = draw.Chance(0.6);
    AddRow(site, side,
           {.kind = young ? "young-tree" : "tree",
            .spacing_m = draw.Between(9, 16),
            .out_m = 0.75,
            .chance = 0.85,
            .margin_m = 0.3,
            .scale_low = 0.6,
            .scale_high = 0.95,
            .one_variant = true},
           4);
  }
  AddRow(site, side,
         {.kind = "electric-box",
          .spacing_m = 80,
          .jitter_m = 30,
          .out_m = sidewalk_m - 0.3,
          .chance = 0.7,
          .lift_m = lift},
         5);
  AddRow(site, side,
         {.kind = "bus-stop",
          .spacing_m = 300,
          .jitter_m = 120,
          .out_m = sidewalk_m + 1.2,
          .margin_m = 0.3},
         6);
  AddRow(site, side,
         {.kind = "billboard",
          .spacing_m = 170,
          .jitter_m = 70,
          .out_m = sidewalk_m + 1.6,
          .margin_m = 0.3},
         7);
  AddRow(site, side,
         {.kind = "kiosk",
          .spacing_m = 380,
          .jitter_m = 160,
          .out_m = sidewalk_m + 2.2,
          .margin_m = 0.4},
         8);
  AddRow(site, side,
         {.kind = "advertising-column",
          .spacing_m = 240,
          .jitter_m = 100,
          .out_m = sidewalk_m + 0.9,
          .margin_m = 0.3},
         9);
  AddRow(
      site, side,
      {.kind = "bench", .spacing_m = 130, .jitter_m = 60, .out_m = sidewalk_m + 0.6, .chance = 0.6},
      10);
}

void NameStreets(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x6e616d65);
  for (const CentreLine::Junction& junction : side.line->junctions) {
    const double s = junction.begin_m - 3;
    if (s < 1 || !draw.Chance(0.7)) continue;
    site.Place("street-name", static_cast<uint32_t>(draw.Below(100)), side.At(s, 0.7),
               {.heading_rad = side.Heading(s), .lift_m = kSidewalkHeightM}, draw);
  }
}

}  // namespace

void FurnishSuburb(Site& site) {
  AddKerbs(site);
  const std::vector<RoadSide> sides = RoadSidesOf(site);
  std::vector<Plot> plots;
  for (const RoadSide& side : sides) BuildPlots(site, side, &plots);
  for (const RoadSide& side : sides) {
    if (side.side > 0 && IsDeadEnd(*side.line)) CloseDeadEnd(site, side);
    FurnishSidewalk(site, side);
    PlantPark(site, side);
    NameStreets(site, side);
  }
  for (const Plot& plot : plots) AddGarden(site, plot);
  for (const RoadSide& side : sides) BuildSecondRow(site, side);
  for (const RoadSide& side : sides) {
    AddKerbParking(site, side);
    AddRoadWear(site, side);
  }
  for (const CentreLine& line : site.roads().lines()) AddRoadMarks(site, line, 0.1);
  FillWithGreen(site, {.near_share = 0.35, .far_share = 0.3, .edge_m = 3});
}

}  // namespace carmap
