#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "carmap/sim/buildings.h"
#include "carmap/sim/ground_mesh.h"
#include "carmap/sim/scenes.h"
#include "carmap/sim/street.h"

namespace carmap {
namespace {

/// A house that was built, and the ground that belongs to it.
struct Plot {
  RoadSide side;
  HouseSpec house;
  double begin_m, end_m;  ///< along the road
  double house_m;         ///< of the house's origin along the road
  double setback_m;       ///< of its front from the sidewalk
  uint64_t seed;
};

/// Of a house whose origin is there.
GroundBox HouseBox(const HouseSpec& spec, const Eigen::Vector2d& origin, double heading_rad) {
  const double left = HouseLeft(spec), right = HouseRight(spec);
  const Eigen::Vector2d x(std::cos(heading_rad), std::sin(heading_rad)), y(-x.y(), x.x());
  return {origin + (right - left) / 2 * x + spec.depth_m / 2 * y, heading_rad, (left + right) / 2,
          spec.depth_m / 2 + 0.45};
}

/// True when it fitted.
bool BuildHouse(Site& site, const HouseSpec& spec, const Eigen::Vector2d& origin,
                double heading_rad, double edge_m, HashSequence draw) {
  const GroundBox box = HouseBox(spec, origin, heading_rad);
  if (!site.IsFree(box, edge_m)) return false;
  site.occupancy().Add(box);
  AddHouse(spec, site.FrameInTile(origin, site.At(origin), heading_rad), draw, site.TileAt(origin));
  return true;
}

void BuildHouses(Site& site, const RoadSide& side, std::vector<Plot>* plots) {
  HashSequence draw = side.Draw(0x686f7573);
  const bool dense = draw.Chance(0.25);  // an old street, its houses at the sidewalk
  const double usual_setback_m = dense ? draw.Between(0.1, 1) : draw.Between(3.2, 6.5);
  for (double s = draw.Between(2, 8); s < side.length_m() - 6;) {
    if (!dense && draw.Chance(0.05)) {
      s += draw.Between(15, 32);  // a meadow, an orchard
      continue;
    }
    Plot plot{side, DrawHouse(draw)};
    plot.seed = draw.Next();
    plot.house.garage &= !dense;
    const double left = HouseLeft(plot.house), right = HouseRight(plot.house);
    plot.setback_m = std::max(0.1, usual_setback_m + draw.Between(-0.8, 0.8));
    plot.house_m = s + (side.side > 0 ? left : right);
    const double gap_m = dense && draw.Chance(0.5) ? 0.1 : draw.Between(1.5, 6);
    plot.begin_m = s - gap_m / 2;
    plot.end_m = s + left + right + gap_m / 2;
    const Eigen::Vector2d origin = side.At(plot.house_m, side.sidewalk_m() + plot.setback_m);
    if (!BuildHouse(site, plot.house, origin, side.BuildingHeading(plot.house_m),
                    side.sidewalk_m() + 0.05, HashSequence(plot.seed))) {
      s += 2.5;
      continue;
    }
    s = plot.end_m + gap_m / 2;
    plots->push_back(plot);
  }
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
  // On the right of the house seen from the street.
  const double along_m = plot.house_m + side.side * (plot.house.width_m / 2 + 1.5);
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
  const double kind = draw.Unit();
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
  const auto place = [&](double low_out, double high_out, double tree_share) {
    const double s = draw.Between(plot.begin_m, plot.end_m),
                 out_m = draw.Between(low_out, high_out);
    const double kind = draw.Unit();
    const bool tree = kind < tree_share;
    const std::string_view name =
        tree ? (kind < 0.25 * tree_share ? "conifer" : "tree") : (kind > 0.95 ? "planter" : "bush");
    site.Place(name, static_cast<uint32_t>(draw.Below(1000)), side.At(s, out_m),
               {.heading_rad = draw.Between(-M_PI, M_PI),
                .scale = tree ? draw.Between(0.55, 1) : draw.Between(0.6, 1.25),
                .margin_m = tree ? 1.2 : 0.15,
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
  bed.half_length_m = static_cast<float>(plot.house.width_m / 2);
  bed.cover = {Pattern::kSoil, 0.12f, 1, SemanticClass::kTerrain};
  site.decals().push_back(bed);

  const double front_m = sidewalk_m + 0.9, house_m = sidewalk_m + plot.setback_m;
  if (plot.setback_m > 2) {
    const int count = 3 + static_cast<int>(draw.Below(6));
    for (int i = 0; i < count; ++i) place(front_m, house_m - 0.4, 0.22);
  }
  const double back_m = house_m + plot.house.depth_m + 1;
  const int count = 2 + static_cast<int>(draw.Below(4));
  for (int i = 0; i < count; ++i) place(back_m, back_m + 14, 0.5);
}

void AddGarden(Site& site, const Plot& plot) {
  HashSequence draw(plot.seed, 0x67617264);
  const RoadSide& side = plot.side;
  const double sidewalk_m = side.sidewalk_m();
  std::vector<double> ways_m;
  if (plot.house.garage) {
    if (const auto way_m = AddDriveway(site, plot, draw)) ways_m.push_back(*way_m);
  }
  if (plot.setback_m > 1.8) {
    const double path_m = plot.house_m + draw.Between(-0.25, 0.25) * plot.house.width_m;
    AddWay(site, side, path_m, 0, sidewalk_m + plot.setback_m - 0.5, 1.2, PavedCover(draw));
    ways_m.push_back(path_m);
    AddFrontFence(site, plot, ways_m, draw);
    const double depth_m = sidewalk_m + plot.setback_m + plot.house.depth_m;
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
  if (draw.Chance(0.35)) {
    AddRow(site, side,
           {.kind = "pole",
            .spacing_m = 34,
            .out_m = sidewalk_m - 0.3,
            .lift_m = lift,
            .one_variant = true},
           3);
  }
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
  for (const RoadSide& side : sides) BuildHouses(site, side, &plots);
  for (const RoadSide& side : sides) {
    FurnishSidewalk(site, side);
    NameStreets(site, side);
  }
  for (const Plot& plot : plots) AddGarden(site, plot);
  for (const RoadSide& side : sides) BuildSecondRow(site, side);
  for (const RoadSide& side : sides) {
    AddKerbParking(site, side);
    AddRoadWear(site, side);
  }
  for (const CentreLine& line : site.roads().lines()) AddRoadMarks(site, line, 0.1);
  FillWithGreen(site, {.near_share = 0.3, .far_share = 0.4, .edge_m = 3});
}

}  // namespace carmap
