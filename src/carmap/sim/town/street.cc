#include "carmap/sim/town/street.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "carmap/sim/town/ground_mesh.h"

namespace carmap {
namespace {

constexpr std::pair<double, double> kCorners[] = {{1, 1}, {1, -1}, {-1, -1}, {-1, 1}};

GroundCover RoadCover(Pattern pattern, double albedo, double contrast = 1) {
  return {pattern, static_cast<float>(albedo), static_cast<float>(contrast), SemanticClass::kRoad};
}

Decal Rectangle(const RoutePoint& at, double length_m, double width_m, const GroundCover& cover,
                double turn_rad = 0) {
  Decal decal;
  decal.centre_in_enu = at.position_in_enu.cast<float>();
  const double heading = at.heading_rad + turn_rad;
  decal.along = Eigen::Vector2d(std::cos(heading), std::sin(heading)).cast<float>();
  decal.half_length_m = static_cast<float>(length_m / 2);
  decal.half_width_m = static_cast<float>(width_m / 2);
  decal.cover = cover;
  return decal;
}

}  // namespace

Eigen::Vector2d RoadSide::At(double along_m, double out_m) const {
  return line->path.At(along_m, side * (EdgeM() + out_m)).position_in_enu;
}

double RoadSide::Heading(double along_m) const {
  return line->path.At(along_m).heading_rad + (side > 0 ? M_PI : 0);
}

HashSequence RoadSide::Draw(uint64_t stream) const {
  return HashSequence(HashKeys(line->seed, side > 0 ? 1 : 0), stream);
}

std::vector<RoadSide> RoadSidesOf(const Site& site) {
  std::vector<RoadSide> sides;
  for (uint32_t idx = 0; idx < site.roads().lines().size(); ++idx) {
    const CentreLine& line = site.roads().lines()[idx];
    if (line.kind == CentreLine::Kind::kConnector) continue;
    for (const int side : {-1, 1}) sides.push_back({&line, idx, side});
  }
  return sides;
}

bool IsDeadEnd(const CentreLine& line) {
  return line.kind == CentreLine::Kind::kSide && !line.InJunction(line.path.length_m(), 3);
}

bool IsOffRoute(const Site& site, const Eigen::Vector2d& p, double distance_m) {
  return site.route_swath().IsFree({p, 0, distance_m, distance_m});
}

void AddRoadWear(Site& site, const RoadSide& side) {
  HashSequence draw = side.Draw(0x77656172);
  const double width_m = side.EdgeM();
  const auto at = [&](double s, double from_centre) {
    return side.line->path.At(s, side.side * from_centre);
  };
  const auto share = [&](double low, double high) { return draw.Between(low, high) * width_m; };
  for (double s = draw.Between(0, 20); s < side.length_m(); s += draw.Between(6, 30)) {
    const double kind = draw.Unit();
    const double turn = draw.Between(-0.04, 0.04);
    const bool freeway = site.scene() == Scene::kFreeway;
    if (freeway && !draw.Chance(0.35)) continue;  // looked after better
    if (kind < 0.3) {                             // repaired
      site.decals().push_back(
          Rectangle(at(s, share(0.1, 0.9)), draw.Between(1, 7), draw.Between(0.6, 2.6),
                    RoadCover(Pattern::kAsphalt, draw.Between(0.1, 0.25)), turn));
    } else if (kind < 0.45) {  // where a pipe was laid, along or across
      const bool across = draw.Chance(0.4);
      site.decals().push_back(Rectangle(
          at(s, across ? 0.5 * width_m : share(0.2, 0.8)), across ? width_m : draw.Between(8, 30),
          draw.Between(0.5, 0.9), RoadCover(Pattern::kAsphalt, draw.Between(0.1, 0.22)),
          turn + (across ? M_PI / 2 : 0)));
    } else if (kind < 0.75) {  // tar in cracks: a line of bent pieces
      double along = s, from_centre = share(0.05, 0.9), heading = draw.Between(-0.4, 0.4);
      const int pieces = 2 + static_cast<int>(draw.Below(6));
      for (int i = 0; i < pieces; ++i) {
        const double length_m = draw.Between(0.5, 1.6);
        site.decals().push_back(Rectangle(at(along, from_centre), length_m * 1.08,
                                          draw.Between(0.02, 0.05),
                                          RoadCover(Pattern::kPlain, 0.05), heading * side.side));
        along += length_m * std::cos(heading);
        from_centre += length_m * std::sin(heading);
        if (from_centre < 0.1 || from_centre > width_m - 0.1) break;
        heading += draw.Between(-0.5, 0.5);
      }
    } else if (!freeway) {  // a manhole cover in its frame
      const RoutePoint p = at(s, share(0.1, 0.8));
      Decal frame = Rectangle(p, 0.78, 0.78, RoadCover(Pattern::kConcrete, 0.28));
      Decal cover = Rectangle(p, 0.6, 0.6, RoadCover(Pattern::kMetal, 0.09));
      frame.shape = cover.shape = Decal::Shape::kEllipse;
      site.decals().push_back(frame);
      site.decals().push_back(cover);
    }
  }
  if (site.scene() == Scene::kFreeway) return;  // it has its gullies in the verge
  for (double s = draw.Between(0, 25); s < side.length_m(); s += draw.Between(18, 32)) {
    site.decals().push_back(
        Rectangle(at(s, width_m - 0.28), 0.5, 0.35, RoadCover(Pattern::kMetal, 0.07)));
  }
}

namespace {

/// Bars along the road, across all of the carriageway.
void AddZebra(Site& site, const CentreLine& line, double middle_m) {
  const double left = line.section.Edge(1) - 0.4, right = -line.section.Edge(-1) + 0.4;
  for (double across = right + 0.25; across < left; across += 1.0) {
    site.decals().push_back(
        Rectangle(line.path.At(middle_m, across), 3, 0.5, RoadCover(Pattern::kPlain, 0.62)));
  }
}

/// Over the lane that comes up to a junction at `at_m`, travelling in `direction`.
void AddStopLine(Site& site, const CentreLine& line, double at_m, int direction) {
  const double lane = line.section.lane_width_m;
  site.decals().push_back(Rectangle(line.path.At(at_m, -direction * lane / 2), 0.5, lane - 0.3,
                                    RoadCover(Pattern::kPlain, 0.6)));
}

}  // namespace

void AddRoadMarks(Site& site, const CentreLine& line, double zebra_share) {
  HashSequence draw(line.seed, 0x6d61726b);
  for (const CentreLine::Junction& junction : line.junctions) {
    for (const int direction : {1, -1}) {  // of who comes up to it
      const double edge_m = direction > 0 ? junction.begin_m : junction.end_m;
      const double zebra_m = edge_m - direction * 4.5;
      const bool zebra = draw.Chance(zebra_share);
      const bool stop = draw.Chance(line.kind == CentreLine::Kind::kSide ? 0.7 : 0.3);
      if (zebra_m < 6 || zebra_m > line.path.length_m() - 6) continue;
      if (zebra) AddZebra(site, line, zebra_m);
      if (stop) AddStopLine(site, line, edge_m - direction * (zebra ? 7.2 : 1.2), direction);
    }
  }
}

void AddKerbParking(Site& site, const RoadSide& side) {
  constexpr double kBayM = 6.0, kCarHalfWidthM = 0.95;
  if (!side.HasParking()) return;
  HashSequence draw = side.Draw(0x7061726b);
  const double strip_m =
      side.side > 0 ? side.line->section.left_parking_m : side.line->section.right_parking_m;
  const bool lined = draw.Chance(0.5);
  for (double s = 5; s < side.length_m() - 5; s += kBayM) {
    const Eigen::Vector2d p = side.At(s, -strip_m / 2);
    // Clear of junctions and of the crossings before them.
    if (side.line->InJunction(s, 10) || !IsOffRoute(site, p, kCarHalfWidthM)) continue;
    const GroundBox bay{p, side.Heading(s), 2.4, kCarHalfWidthM};
    const bool inside = std::all_of(std::begin(kCorners), std::end(kCorners), [&](const auto& c) {
      return site.ground().CarriagewayDistance(bay.At(c.first, c.second)) < 0.05;
    });
    if (!inside || !site.occupancy().IsFree(bay)) continue;
    const double heading = side.Heading(s);
    site.AddParking({.position_in_enu = site.At(p),
                     .heading_rad = static_cast<float>(heading),
                     .pitch_rad = static_cast<float>(site.PitchAt(p, heading)),
                     .length_m = 5.4f});
    if (lined) {
      for (const double end : {-kBayM / 2, kBayM / 2}) {
        site.decals().push_back(
            Rectangle(side.line->path.At(s + end, side.side * (side.EdgeM() - strip_m / 2)), 0.1,
                      strip_m - 0.3, RoadCover(Pattern::kPlain, 0.55)));
      }
    }
  }
}

void AddRow(Site& site, const RoadSide& side, const RowSpec& row, uint64_t stream) {
  HashSequence draw = side.Draw(stream);
  const auto same = static_cast<uint32_t>(draw.Below(1000));
  for (double s = draw.Between(2, row.spacing_m); s < side.length_m() - 2;
       s += row.spacing_m + draw.Between(-row.jitter_m, row.jitter_m)) {
    const auto other = static_cast<uint32_t>(draw.Below(1000));
    const double scale = draw.Between(row.scale_low, row.scale_high);
    if (!draw.Chance(row.chance) || side.line->InJunction(s, 1)) continue;
    site.Place(row.kind, row.one_variant ? same : other, side.At(s, row.out_m),
               {.heading_rad = side.Heading(s),
                .scale = scale,
                .margin_m = row.margin_m,
                .edge_m = std::min(0.25, row.out_m / 2),
                .lift_m = row.lift_m},
               draw);
  }
}

namespace {

/// A wire that sags, from `a` to `b`.
void AddWire(Site& site, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  constexpr int kPieces = 8;
  constexpr double kSagShare = 0.02;
  const Surface black = {
      .pattern = Pattern::kRubber, .albedo = 0.05f, .label = SemanticClass::kUnlabelled};
  const Eigen::Vector2d middle = (a + b).head<2>() / 2;
  MeshBuilder& builder = site.TileAt(middle);
  builder.SetFrame(site.FrameInTile(middle, Eigen::Vector3d::Zero(), 0));
  Points3 path;
  for (int i = 0; i <= kPieces; ++i) {
    const double t = static_cast<double>(i) / kPieces;
    Eigen::Vector3d p = a + t * (b - a);
    p.z() -= 4 * t * (1 - t) * kSagShare * (b - a).norm();
    path.push_back(p.cast<float>());
  }
  builder.Tube(path, std::vector<float>(path.size(), 0.018f), 3, builder.Use(black), false);
}

}  // namespace

void AddPoleLine(Site& site, const RoadSide& side, double out_m, double spacing_m, double lift_m) {
  constexpr double kWireM = 0.82;
  HashSequence draw = side.Draw(0x77697265);
  const auto variant = static_cast<uint32_t>(draw.Below(100));
  std::optional<double> last;
  for (double s = draw.Between(2, spacing_m); s < side.length_m() - 2; s += spacing_m) {
    if (side.line->InJunction(s, 1) ||
        !site.Place("pole", variant, side.At(s, out_m),
                    {.heading_rad = side.Heading(s), .lift_m = lift_m}, draw)) {
      continue;
    }
    if (last && s - *last < 2.2 * spacing_m) {
      const double up_m = site.HeightOf("pole", variant) + lift_m - 0.07;
      for (const double aside_m : {-kWireM, kWireM}) {
        const Eigen::Vector3d up = up_m * Eigen::Vector3d::UnitZ();
        AddWire(site, site.At(side.At(*last, out_m + aside_m)) + up,
                site.At(side.At(s, out_m + aside_m)) + up);
      }
    }
    last = s;
  }
}

void AddModules(Site& site, const RoadSide& side, std::string_view kind, uint32_t variant,
                double module_m, double begin_m, double end_m, double out_m, HashSequence& draw) {
  // As long as measured at that distance from the centre line, so that bends leave no gaps.
  constexpr double kStepM = 0.5;
  double left_m = module_m / 2;
  for (double s = begin_m; s + kStepM <= end_m; s += kStepM) {
    const double step_m = (side.At(s + kStepM, out_m) - side.At(s, out_m)).norm();
    if (step_m < left_m) {
      left_m -= step_m;
      continue;
    }
    const double at_m = s + kStepM * left_m / step_m;
    left_m += module_m - step_m;
    if (at_m + module_m / 2 > end_m) break;
    site.Place(kind, variant, side.At(at_m, out_m),
               {.heading_rad = side.Heading(at_m), .edge_m = std::min(0.25, out_m / 2)}, draw);
  }
}

void AddModulesBetween(Site& site, std::string_view kind, uint32_t variant, double module_m,
                       const Eigen::Vector2d& from, const Eigen::Vector2d& to, double edge_m,
                       HashSequence& draw) {
  const Eigen::Vector2d v = to - from;
  const double heading = std::atan2(v.y(), v.x());
  for (double s = module_m / 2; s <= v.norm() - module_m / 2; s += module_m) {
    site.Place(kind, variant, from + s * v.normalized(), {.heading_rad = heading, .edge_m = edge_m},
               draw);
  }
}

void AddWay(Site& site, const RoadSide& side, double along_m, double out_m, double to_out_m,
            double width_m, const GroundCover& cover) {
  const Eigen::Vector2d a = side.At(along_m, out_m), b = side.At(along_m, to_out_m), v = b - a;
  Decal decal;
  decal.centre_in_enu = ((a + b) / 2).cast<float>();
  decal.along = v.normalized().cast<float>();
  decal.half_length_m = static_cast<float>(v.norm() / 2);
  decal.half_width_m = static_cast<float>(width_m / 2);
  decal.on_road_too = false;
  decal.cover = cover;
  site.decals().push_back(decal);
  site.occupancy().Add({(a + b) / 2, std::atan2(v.y(), v.x()), v.norm() / 2, width_m / 2});
}

void AddGardenWall(Site& site, const RoadSide& side, double begin_m, double end_m, double out_m,
                   double height_m, const Surface& surface) {
  constexpr double kPieceM = 3;
  const int pieces = std::max(1, static_cast<int>(std::lround((end_m - begin_m) / kPieceM)));
  for (int i = 0; i < pieces; ++i) {
    const double from = begin_m + (end_m - begin_m) * i / pieces;
    const double to = begin_m + (end_m - begin_m) * (i + 1) / pieces;
    const Eigen::Vector2d a = side.At(from, out_m), b = side.At(to, out_m), v = b - a;
    const Eigen::Vector2d middle = (a + b) / 2;
    const GroundBox box{middle, std::atan2(v.y(), v.x()), v.norm() / 2, 0.12};
    if (!site.IsFree(box.Grown(-0.05), 0.25)) continue;
    site.occupancy().Add(box);
    MeshBuilder& builder = site.TileAt(middle);
    const auto half = static_cast<float>(v.norm() / 2);
    const auto pitch = static_cast<float>(-site.PitchAt(middle, box.heading_rad));
    builder.SetFrame(site.FrameInTile(middle, site.At(middle), box.heading_rad) *
                     FrameAt(Eigen::Vector3f::Zero(), 0, pitch));
    builder.Box({-half, -0.11f, -0.5f}, {half, 0.11f, static_cast<float>(height_m)},
                builder.Use(surface), false);
    Surface cap = surface;
    cap.pattern = Pattern::kConcrete;
    cap.albedo = 0.35f;
    const auto top = static_cast<float>(height_m);
    builder.Box({-half, -0.15f, top}, {half, 0.15f, top + 0.06f}, builder.Use(cap));
  }
}

void FillWithGreen(Site& site, const FillSpec& spec) {
  constexpr double kSquareM = 9, kReachM = 130, kNearM = 40;
  HashSequence draw(site.seed(), 0x66696c6c);
  const HeightField& heights = site.ground().heights();
  const Eigen::Vector2d low = heights.min_corner(), high = heights.max_corner();
  for (double y = low.y(); y < high.y(); y += kSquareM) {
    for (double x = low.x(); x < high.x(); x += kSquareM) {
      const double distance_m = heights.RoadDistanceAt({x, y});
      if (distance_m > kReachM) continue;
      const double share = distance_m < kNearM ? spec.near_share : spec.far_share;
      if (!draw.Chance(share)) continue;
      const Eigen::Vector2d p(x + draw.Between(-4, 4), y + draw.Between(-4, 4));
      const double kind = draw.Unit();
      const auto variant = static_cast<uint32_t>(draw.Below(1000));
      const bool bush = kind<(distance_m < kNearM ? 0.5 : 0.2), conifer = kind> 0.85;
      site.Place(bush ? "bush" : (conifer ? "conifer" : "tree"), variant, p,
                 {.heading_rad = draw.Between(-M_PI, M_PI),
                  .scale = draw.Between(0.75, 1.3),
                  .margin_m = bush ? 0.4 : 2.2,
                  .edge_m = spec.edge_m},
                 draw);
    }
  }
}

}  // namespace carmap
