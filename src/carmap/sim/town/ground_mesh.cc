#include "carmap/sim/town/ground_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace carmap {
namespace {

using Contour = std::vector<Eigen::Vector2d>;

constexpr Surface kGroundSurface = {
    .pattern = Pattern::kGround, .albedo = 0.2f, .label = SemanticClass::kTerrain};

/// How finely the ground follows its height, by the distance of roads.
double TerrainCellM(double road_distance_m) {
  if (road_distance_m < 60) return 4;
  return road_distance_m < 220 ? 12 : 48;
}

Surface TerrainSurface(double road_distance_m, const Eigen::Vector2d& p, uint64_t seed) {
  if (road_distance_m < 260) return kGroundSurface;
  // Woods and fields.
  const auto key = HashKeys(static_cast<uint64_t>(static_cast<int64_t>(p.x() / 190)),
                            static_cast<uint64_t>(static_cast<int64_t>(p.y() / 140)));
  if (UnitHash(seed, key) < 0.6) {
    return {.pattern = Pattern::kLeaves, .albedo = 0.07f, .label = SemanticClass::kVegetation};
  }
  return {.pattern = Pattern::kGrass, .albedo = 0.18f, .label = SemanticClass::kTerrain};
}

/// One square of the ground, with a hem that hides the seam where the next is coarser.
void AddTerrainTile(Site& site, const Eigen::Vector2d& corner, double cell_m, double distance_m) {
  constexpr double kHemM = 1.5;
  const int cells = static_cast<int>(std::lround(Site::kTileM / cell_m));
  const Eigen::Vector2d middle = corner.array() + Site::kTileM / 2;
  MeshBuilder& builder = site.TileAt(middle);
  builder.SetFrame(site.FrameInTile(middle, {corner.x(), corner.y(), 0}, 0));
  const SurfaceIdx surface = builder.Use(TerrainSurface(distance_m, middle, site.seed()));
  std::vector<uint32_t> vertices;
  const auto add = [&](int column, int row, double sink_m) {
    const Eigen::Vector2d local(column * cell_m, row * cell_m), p = corner + local;
    return builder.AddVertex(
        Eigen::Vector3d(local.x(), local.y(), site.ground().HeightAt(p) - sink_m).cast<float>(),
        local.cast<float>());
  };
  for (int row = 0; row <= cells; ++row) {
    for (int column = 0; column <= cells; ++column) vertices.push_back(add(column, row, 0));
  }
  const auto at = [&](int column, int row) {
    return vertices[static_cast<size_t>(row * (cells + 1) + column)];
  };
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      builder.AddTriangle(at(column, row), at(column + 1, row), at(column + 1, row + 1), surface);
      builder.AddTriangle(at(column, row), at(column + 1, row + 1), at(column, row + 1), surface);
    }
  }
  const std::array<std::array<int, 4>, 4> borders = {
      {{0, 0, 1, 0}, {cells, 0, 0, 1}, {cells, cells, -1, 0}, {0, cells, 0, -1}}};
  for (const auto& [column, row, right, up] : borders) {
    for (int i = 0; i < cells; ++i) {
      const int c = column + i * right, r = row + i * up;
      const uint32_t a = at(c, r), b = at(c + right, r + up);
      const uint32_t low_a = add(c, r, kHemM), low_b = add(c + right, r + up, kHemM);
      builder.AddTriangle(low_a, low_b, b, surface);
      builder.AddTriangle(low_a, b, a, surface);
    }
  }
}

/// Where a line of the raster crosses the edge: the line from a texel to the right or upwards.
using CrossingKey = uint64_t;

CrossingKey KeyOf(int column, int row, bool upwards) {
  return (static_cast<uint64_t>(row) << 33) | (static_cast<uint64_t>(column) << 1) |
         (upwards ? 1 : 0);
}

struct Crossing {
  CrossingKey key;
  Eigen::Vector2d p;
};

struct Piece {
  Crossing from, to;
};

/// The edge within one cell of the raster (marching squares; Lorensen, Cline 1987, in the plane),
/// with the carriageway on its left.
void AddPieces(const RoadGround::Tile& tile, int column, int row, int tile_column, int tile_row,
               const Eigen::Vector2d& min_corner, std::vector<Piece>* pieces) {
  constexpr int kColumns[] = {0, 1, 1, 0}, kRows[] = {0, 0, 1, 1};
  std::array<float, 4> edge;
  int inside = 0;
  for (size_t i = 0; i < 4; ++i) {
    edge[i] = tile.At(column + kColumns[i], row + kRows[i]).edge_m;
    inside += edge[i] < 0 ? 1 : 0;
  }
  if (inside == 0 || inside == 4) return;
  const int global_column = tile_column * RoadGround::kTileTexels + column;
  const int global_row = tile_row * RoadGround::kTileTexels + row;
  const auto crossing = [&](size_t i) {  // between corners i and i + 1, round to the left
    const size_t k = (i + 1) % 4;
    const double t = edge[i] / (edge[i] - edge[k]);
    const Eigen::Vector2d a(global_column + kColumns[i], global_row + kRows[i]);
    const Eigen::Vector2d b(global_column + kColumns[k], global_row + kRows[k]);
    const auto low = [](int x, int y) { return std::min(x, y); };
    return Crossing{KeyOf(global_column + low(kColumns[i], kColumns[k]),
                          global_row + low(kRows[i], kRows[k]), i % 2 == 1),
                    min_corner + RoadGround::kTexelM * (a + t * (b - a))};
  };
  // Going round, one leaves the carriageway at a crossing and comes back at the next: the edge runs
  // from there to here.
  for (size_t i = 0; i < 4; ++i) {
    if (edge[i] >= 0 || edge[(i + 1) % 4] < 0) continue;
    size_t back = (i + 1) % 4;
    while (edge[(back + 1) % 4] >= 0) back = (back + 1) % 4;
    pieces->push_back({crossing(i), crossing(back)});
  }
}

std::vector<Contour> Chain(const std::vector<Piece>& pieces) {
  std::unordered_map<CrossingKey, size_t> piece_from;
  for (size_t i = 0; i < pieces.size(); ++i) piece_from[pieces[i].from.key] = i;
  std::vector<bool> used(pieces.size(), false);
  std::vector<Contour> contours;
  for (size_t start = 0; start < pieces.size(); ++start) {
    Contour contour;
    for (size_t i = start; !used[i];) {
      used[i] = true;
      contour.push_back(pieces[i].from.p);
      const auto next = piece_from.find(pieces[i].to.key);
      if (next == piece_from.end()) break;
      i = next->second;
    }
    if (contour.size() > 8) contours.push_back(std::move(contour));
  }
  return contours;
}

/// Keeps what is needed to stay within a centimetre (Ramer 1972; Douglas, Peucker 1973), and a
/// point every few metres, for the ground's height.
void Simplify(const Contour& points, size_t begin, size_t end, Contour* kept) {
  constexpr double kToleranceM = 0.008, kMaxLengthM = 5;
  const Eigen::Vector2d line = points[end] - points[begin];
  size_t farthest = begin;
  double most = kToleranceM;
  for (size_t i = begin + 1; i < end; ++i) {
    const Eigen::Vector2d v = points[i] - points[begin];
    const double t = std::clamp(v.dot(line) / std::max(line.squaredNorm(), 1e-12), 0.0, 1.0);
    const double distance = (v - t * line).norm();
    if (distance > most) {
      most = distance;
      farthest = i;
    }
  }
  if (farthest == begin && line.norm() > kMaxLengthM && end - begin > 1) {
    farthest = (begin + end) / 2;
  }
  if (farthest == begin) {
    kept->push_back(points[begin]);
    return;
  }
  Simplify(points, begin, farthest, kept);
  Simplify(points, farthest, end, kept);
}

Contour Simplified(Contour points) {
  points.push_back(points.front());
  const size_t half = points.size() / 2;  // a closed line has no ends to begin with
  Contour kept;
  Simplify(points, 0, half, &kept);
  Simplify(points, half, points.size() - 1, &kept);
  return kept;
}

/// What stands along an edge at one of its points.
struct KerbStation {
  Eigen::Vector2d p, outwards;
  double reach_m = 0;  ///< of the sidewalk, from the edge
  double along_m = 0;
  uint32_t line = 0;
};

/// As wide as the road's sidewalk, where no other carriageway comes as near.
double FreeReach(const RoadGround& ground, const Eigen::Vector2d& p,
                 const Eigen::Vector2d& outwards, double wanted_m) {
  constexpr double kStepM = 0.25;
  double reach_m = 0.2;
  for (double t = kStepM; t <= wanted_m + 1e-9; t += kStepM) {
    if (ground.CarriagewayDistance(p + t * outwards) < 0.75 * t) break;
    reach_m = t;
  }
  return reach_m;
}

std::vector<KerbStation> StationsOf(const Site& site, const Contour& contour) {
  std::vector<KerbStation> stations;
  double along_m = 0;
  const size_t count = contour.size();
  for (size_t i = 0; i <= count; ++i) {
    const Eigen::Vector2d& p = contour[i % count];
    const Eigen::Vector2d& before = contour[(i + count - 1) % count];
    const Eigen::Vector2d& after = contour[(i + 1) % count];
    const Eigen::Vector2d a = (p - before).normalized(), b = (after - p).normalized();
    const Eigen::Vector2d along = (a + b).normalized();
    KerbStation station{.p = p, .outwards = {along.y(), -along.x()}, .along_m = along_m};
    double wanted_m = 2;
    double nearest = 1e9;
    for (const RoadHit& hit : site.roads().Near(p, 14)) {
      if (std::abs(hit.edge_m) >= nearest) continue;
      nearest = std::abs(hit.edge_m);
      station.line = hit.line;
      wanted_m = site.roads().lines()[hit.line].section.sidewalk_m;
    }
    station.reach_m = FreeReach(site.ground(), p, station.outwards, wanted_m);
    stations.push_back(station);
    along_m += (after - p).norm();
  }
  return stations;
}

Surface SidewalkSurface(uint64_t line_seed) {
  HashSequence draw(line_seed, 0x77616c6b);
  const Pattern patterns[] = {Pattern::kPaving, Pattern::kPaving, Pattern::kAsphalt};
  return {.pattern = patterns[draw.Below(3)],
          .albedo = static_cast<float>(draw.Between(0.2, 0.3)),
          .label = SemanticClass::kSidewalk};
}

/// Kerb stone and sidewalk between two stations.
void AddKerbPiece(Site& site, const KerbStation& a, const KerbStation& b) {
  constexpr float kStoneM = 0.14f;
  const Surface stone = {
      .pattern = Pattern::kConcrete, .albedo = 0.33f, .label = SemanticClass::kSidewalk};
  MeshBuilder& builder = site.TileAt(a.p);
  builder.SetFrame(site.FrameInTile(a.p, Eigen::Vector3d::Zero(), 0));
  const SurfaceIdx kerb = builder.Use(stone);
  const SurfaceIdx walk = builder.Use(SidewalkSurface(site.roads().lines()[a.line].seed));
  const auto corner = [&](const KerbStation& at, double out_m, double up_m) -> Eigen::Vector3f {
    Eigen::Vector3d p = site.At(at.p + out_m * at.outwards);
    p.z() += up_m;
    return p.cast<float>();
  };
  struct Profile {
    double out_share, out_m, up_m;
  };
  const Profile profile[] = {{0, 0, -0.05},
                             {0, 0.02, kSidewalkHeightM - 0.015},
                             {0, kStoneM, kSidewalkHeightM},
                             {1, 0, kSidewalkHeightM + 0.02},
                             {1, 0, -0.1}};
  const SurfaceIdx surfaces[] = {kerb, kerb, walk, kerb};
  float v = 0;
  for (size_t i = 0; i + 1 < std::size(profile); ++i) {
    const auto at = [&](const KerbStation& station, const Profile& where) {
      return corner(station, where.out_m + where.out_share * station.reach_m, where.up_m);
    };
    // Seen from the carriageway, which is on the left of the way from a to b: from b to a.
    const Eigen::Vector3f low_b = at(b, profile[i]), low_a = at(a, profile[i]);
    const Eigen::Vector3f high_a = at(a, profile[i + 1]), high_b = at(b, profile[i + 1]);
    const auto u_a = static_cast<float>(-a.along_m), u_b = static_cast<float>(-b.along_m);
    const float next_v = v + (high_a - low_a).norm();
    const uint32_t corners[] = {
        builder.AddVertex(low_b, {u_b, v}), builder.AddVertex(low_a, {u_a, v}),
        builder.AddVertex(high_a, {u_a, next_v}), builder.AddVertex(high_b, {u_b, next_v})};
    builder.AddTriangle(corners[0], corners[1], corners[2], surfaces[i]);
    builder.AddTriangle(corners[0], corners[2], corners[3], surfaces[i]);
    v = next_v;
  }
}

}  // namespace

void AddTerrain(Site& site) {
  const HeightField& heights = site.ground().heights();
  const Eigen::Vector2d low = (heights.min_corner() / Site::kTileM).array().ceil();
  const Eigen::Vector2d high = (heights.max_corner() / Site::kTileM).array().floor();
  for (double row = low.y(); row < high.y(); ++row) {
    for (double column = low.x(); column < high.x(); ++column) {
      const Eigen::Vector2d corner = Site::kTileM * Eigen::Vector2d(column, row);
      double distance_m = 1e9;
      for (int i = 0; i < 25; ++i) {
        const Eigen::Vector2d p =
            corner + Site::kTileM / 4 * Eigen::Vector2d(i % 5, static_cast<double>(i / 5));
        distance_m = std::min(distance_m, heights.RoadDistanceAt(p));
      }
      AddTerrainTile(site, corner, TerrainCellM(distance_m), distance_m);
    }
  }
}

std::vector<Contour> CarriagewayEdges(const RoadGround& ground) {
  std::vector<Piece> pieces;
  for (int tile_row = 0; tile_row < ground.tile_rows(); ++tile_row) {
    for (int tile_column = 0; tile_column < ground.tile_columns(); ++tile_column) {
      const RoadGround::Tile* tile = ground.TileAt(tile_column, tile_row);
      if (tile == nullptr) continue;
      for (int row = 0; row < RoadGround::kTileTexels; ++row) {
        for (int column = 0; column < RoadGround::kTileTexels; ++column) {
          AddPieces(*tile, column, row, tile_column, tile_row, ground.min_corner(), &pieces);
        }
      }
    }
  }
  std::vector<Contour> contours;
  for (Contour& contour : Chain(pieces)) contours.push_back(Simplified(std::move(contour)));
  return contours;
}

void AddKerbs(Site& site) {
  for (const Contour& contour : CarriagewayEdges(site.ground())) {
    const std::vector<KerbStation> stations = StationsOf(site, contour);
    for (size_t i = 0; i + 1 < stations.size(); ++i) {
      AddKerbPiece(site, stations[i], stations[i + 1]);
    }
  }
}

}  // namespace carmap
