#include "carmap/sim/road/road_ground.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <utility>

#include "carmap/base/random.h"

namespace carmap {
namespace {

constexpr double kTileM = RoadGround::kTexelM * RoadGround::kTileTexels;
constexpr float kDecalCellM = 8;
constexpr uint32_t kNoLine = std::numeric_limits<uint32_t>::max();

GroundCover Cover(Pattern pattern, float albedo, SemanticClass label, float contrast = 1) {
  return {pattern, albedo, contrast, label};
}

/// `share` of the spot is `over`.
void Mix(GroundCover* under, const GroundCover& over, float share) {
  if (share <= 0) return;
  under->albedo += share * (over.albedo - under->albedo);
  under->contrast += share * (over.contrast - under->contrast);
  if (share <= 0.5f) return;
  under->pattern = over.pattern;
  under->label = over.label;
}

/// Share of a spot of extent `width` about x that lies in [low, high].
float BandShare(float x, float width, float low, float high) {
  return std::max(0.0f, std::min(high, x + width / 2) - std::max(low, x - width / 2)) / width;
}

/// The same of the bands [0, on), repeated.
float DashShare(float x, float width, float on, float period) {
  const auto covered = [&](float end) {
    const float periods = std::floor(end / period);
    return periods * on + std::min(end - periods * period, on);
  };
  return (covered(x + width / 2) - covered(x - width / 2)) / width;
}

/// What a pixel sees across its longer axis: at 1.65 m above the road, 700 px focal length.
float ShortAxis(const Eigen::Vector2f& footprint_m) {
  return 0.005f + 0.05f * std::sqrt(footprint_m.norm());
}

float Extent(const Eigen::Vector2f& footprint_m, float short_m, const Eigen::Vector2f& direction) {
  return Eigen::Vector2f(footprint_m.dot(direction), short_m).norm();
}

/// Union of two carriageways with the corners between them rounded; parallel ones have none.
double RoundUnion(double a, double b, double radius) {
  const double u = std::max(radius - a, 0.0), v = std::max(radius - b, 0.0);
  return std::max(radius, std::min(a, b)) - std::hypot(u, v);
}

double CornerRadius(const RoadNetwork& roads, const RoadHit& a, const RoadHit& b) {
  const bool narrow = roads.lines()[a.line].kind == CentreLine::Kind::kConnector ||
                      roads.lines()[b.line].kind == CentreLine::Kind::kConnector;
  return (narrow ? 3 : 5.5) * std::abs(std::sin(a.heading_rad - b.heading_rad));
}

/// Consecutive points of one line that may be the nearest to some texel of a tile.
struct Stretch {
  uint32_t line, begin, end;
};

/// By tile, all lines' points within `reach_m` of it.
std::vector<std::vector<Stretch>> StretchesByTile(const RoadNetwork& roads,
                                                  const Eigen::Vector2d& min_corner, int columns,
                                                  int rows) {
  std::vector<std::vector<Stretch>> tiles(static_cast<size_t>(columns) * static_cast<size_t>(rows));
  for (uint32_t line = 0; line < roads.lines().size(); ++line) {
    const CentreLine& road = roads.lines()[line];
    const double reach_m =
        std::max(road.section.Edge(1), road.section.Edge(-1)) + RoadGround::kReachM + 1;
    const std::vector<Eigen::Vector2d>& points = road.path.points();
    for (uint32_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector2d low = (points[i] - min_corner).array() - reach_m;
      const Eigen::Vector2d high = (points[i] - min_corner).array() + reach_m;
      const int last_row = std::min(rows - 1, static_cast<int>(high.y() / kTileM));
      const int last_column = std::min(columns - 1, static_cast<int>(high.x() / kTileM));
      for (int row = std::max(0, static_cast<int>(low.y() / kTileM)); row <= last_row; ++row) {
        for (int column = std::max(0, static_cast<int>(low.x() / kTileM)); column <= last_column;
             ++column) {
          std::vector<Stretch>& tile =
              tiles[static_cast<size_t>(row) * static_cast<size_t>(columns) +
                    static_cast<size_t>(column)];
          const bool goes_on = !tile.empty() && tile.back().line == line && tile.back().end == i;
          if (!goes_on) tile.push_back({line, i, i});
          tile.back().end = i + 1;
        }
      }
    }
  }
  return tiles;
}

RoadHit NearestHit(const RoadNetwork& roads, const Stretch& stretch, const Eigen::Vector2d& p) {
  const CentreLine& line = roads.lines()[stretch.line];
  const std::vector<Eigen::Vector2d>& points = line.path.points();
  uint32_t nearest = stretch.begin;
  double least = std::numeric_limits<double>::infinity();
  for (uint32_t i = stretch.begin; i < stretch.end; ++i) {
    const double squared = (points[i] - p).squaredNorm();
    if (squared < least) {
      least = squared;
      nearest = i;
    }
  }
  return HitAt(line, stretch.line, nearest, p);
}

RoadTexel TexelAt(const RoadNetwork& roads, const std::vector<Stretch>& stretches,
                  const Eigen::Vector2d& p) {
  std::array<RoadHit, 2> best;
  size_t count = 0;
  for (const Stretch& stretch : stretches) {
    const RoadHit hit = NearestHit(roads, stretch, p);
    if (count == 0 || hit.edge_m < best[0].edge_m) {
      best[1] = best[0];
      best[0] = hit;
    } else if (count == 1 || hit.edge_m < best[1].edge_m) {
      best[1] = hit;
    }
    count = std::min<size_t>(2, count + 1);
  }
  double edge_m = best[0].edge_m;
  if (count == 2) {
    edge_m = RoundUnion(edge_m, best[1].edge_m, CornerRadius(roads, best[0], best[1]));
  }
  const bool near = edge_m < RoadGround::kReachM;
  return {static_cast<float>(std::min(edge_m, RoadGround::kReachM)),
          static_cast<float>(best[0].left_m), static_cast<float>(best[0].along_m),
          near ? best[0].line : kNoLine};
}

}  // namespace

/// The raster read between texels.
struct RoadGround::Sample {
  float edge_m, left_m, along_m;
  Eigen::Vector2f leftwards;  ///< unit vector to the left of the line
  uint32_t line;
  bool marked;  ///< all texels round it agree on the line
};

RoadGround::RoadGround(Scene scene, const RoadNetwork& roads, HeightField heights, uint64_t seed)
    : scene_(scene), seed_(seed), heights_(std::move(heights)) {
  min_corner_ = heights_.min_corner();
  const Eigen::Vector2d size = heights_.max_corner() - min_corner_;
  tile_columns_ = static_cast<int>(std::ceil(size.x() / kTileM));
  tile_rows_ = static_cast<int>(std::ceil(size.y() / kTileM));
  for (const CentreLine& line : roads.lines()) paints_.push_back(PaintOf(line));
  Rasterize(roads);
  SetDecals({});
}

void RoadGround::Rasterize(const RoadNetwork& roads) {
  const std::vector<std::vector<Stretch>> stretches =
      StretchesByTile(roads, min_corner_, tile_columns_, tile_rows_);
  tiles_.resize(stretches.size());
  tbb::parallel_for(size_t{0}, stretches.size(), [&](size_t i) {
    if (stretches[i].empty()) return;
    const auto columns = static_cast<size_t>(tile_columns_);
    const Eigen::Vector2d corner =
        min_corner_ + kTileM * Eigen::Vector2d(static_cast<double>(i % columns),
                                               static_cast<double>(i / columns));
    tiles_[i] = std::make_unique<Tile>();
    for (int row = 0; row <= kTileTexels; ++row) {
      for (int column = 0; column <= kTileTexels; ++column) {
        tiles_[i]
            ->texels[static_cast<size_t>(row) * (kTileTexels + 1) + static_cast<size_t>(column)] =
            TexelAt(roads, stretches[i], corner + kTexelM * Eigen::Vector2d(column, row));
      }
    }
  });
}

const RoadGround::Tile* RoadGround::TileAt(int column, int row) const {
  if (column < 0 || row < 0 || column >= tile_columns_ || row >= tile_rows_) return nullptr;
  return tiles_[static_cast<size_t>(row) * static_cast<size_t>(tile_columns_) +
                static_cast<size_t>(column)]
      .get();
}

RoadGround::Paint RoadGround::PaintOf(const CentreLine& line) const {
  HashSequence draw(line.seed, 0x7061696e);
  const bool freeway = scene_ == Scene::kFreeway;
  Paint paint{.lane_width_m = static_cast<float>(line.section.lane_width_m),
              .median_half_m = static_cast<float>(line.section.median_half_m),
              .lanes_half_m = static_cast<float>(line.section.LanesHalf()),
              .lanes = line.section.lanes,
              .dashes = freeway || draw.Chance(scene_ == Scene::kDowntown ? 0.85 : 0.4),
              .edge_lines = freeway,
              .marked = line.kind != CentreLine::Kind::kConnector,
              .asphalt_albedo = static_cast<float>(draw.Between(0.15, 0.21))};
  const Pattern patterns[] = {Pattern::kPaving, Pattern::kCobbles, Pattern::kAsphalt};
  const GroundCover strip = Cover(
      patterns[draw.Below(3)], static_cast<float>(draw.Between(0.17, 0.26)), SemanticClass::kRoad);
  const GroundCover asphalt = Cover(Pattern::kAsphalt, paint.asphalt_albedo, SemanticClass::kRoad);
  paint.strips = {line.section.right_parking_m > 0 ? strip : asphalt,
                  line.section.left_parking_m > 0 ? strip : asphalt};
  for (int along_m = 0; along_m <= static_cast<int>(line.path.length_m()) + 1; ++along_m) {
    paint.to_junction.push_back({static_cast<float>(line.ToJunctionAhead(along_m)),
                                 static_cast<float>(line.ToJunctionBehind(along_m))});
  }
  return paint;
}

double RoadGround::HeightAt(const Eigen::Vector2d& p_in_enu) const { return heights_.At(p_in_enu); }

bool RoadGround::SampleAt(const Eigen::Vector2f& p, Sample* sample) const {
  const Eigen::Vector2d cell = (p.cast<double>() - min_corner_) / kTexelM;
  if (!(cell.minCoeff() >= 0)) return false;
  const double max_cells = static_cast<double>(std::max(tile_columns_, tile_rows_)) * kTileTexels;
  if (cell.maxCoeff() >= max_cells) return false;
  const int column = static_cast<int>(cell.x()), row = static_cast<int>(cell.y());
  const Tile* tile = TileAt(column / kTileTexels, row / kTileTexels);
  if (tile == nullptr) return false;
  const int c = column % kTileTexels, r = row % kTileTexels;
  const RoadTexel &t00 = tile->At(c, r), &t10 = tile->At(c + 1, r);
  const RoadTexel &t01 = tile->At(c, r + 1), &t11 = tile->At(c + 1, r + 1);
  const auto x = static_cast<float>(cell.x() - column), y = static_cast<float>(cell.y() - row);
  const auto between = [&](float v00, float v10, float v01, float v11) {
    const float low = v00 + x * (v10 - v00), high = v01 + x * (v11 - v01);
    return low + y * (high - low);
  };
  sample->edge_m = between(t00.edge_m, t10.edge_m, t01.edge_m, t11.edge_m);
  sample->line = t00.line;
  const float low_along = std::min({t00.along_m, t10.along_m, t01.along_m, t11.along_m});
  const float high_along = std::max({t00.along_m, t10.along_m, t01.along_m, t11.along_m});
  sample->marked = t00.line == t10.line && t00.line == t01.line && t00.line == t11.line &&
                   t00.line != kNoLine && high_along - low_along < 3;
  if (!sample->marked) {
    const RoadTexel& nearest = x < 0.5f ? (y < 0.5f ? t00 : t01) : (y < 0.5f ? t10 : t11);
    sample->line = nearest.line;
    sample->left_m = nearest.left_m;
    sample->along_m = nearest.along_m;
    sample->leftwards = Eigen::Vector2f::Zero();
    return true;
  }
  sample->left_m = between(t00.left_m, t10.left_m, t01.left_m, t11.left_m);
  sample->along_m = between(t00.along_m, t10.along_m, t01.along_m, t11.along_m);
  sample->leftwards =
      Eigen::Vector2f(
          t10.left_m - t00.left_m + y * (t11.left_m - t01.left_m - t10.left_m + t00.left_m),
          t01.left_m - t00.left_m + x * (t11.left_m - t10.left_m - t01.left_m + t00.left_m))
          .normalized();
  return true;
}

double RoadGround::CarriagewayDistance(const Eigen::Vector2d& p_in_enu) const {
  constexpr double kLarge = 1000;
  Sample sample;
  if (!SampleAt(p_in_enu.cast<float>(), &sample)) return kLarge;
  return sample.edge_m >= static_cast<float>(kReachM) ? kLarge : sample.edge_m;
}

void RoadGround::PaintRoad(const Sample& s, const Eigen::Vector2f& footprint_m,
                           GroundCover* cover) const {
  const Paint& paint = paints_[s.line];
  const float short_m = ShortAxis(footprint_m);
  const Eigen::Vector2f forwards(s.leftwards.y(), -s.leftwards.x());
  const bool has_axes = s.marked;
  const float across =
      has_axes ? Extent(footprint_m, short_m, s.leftwards) : std::max(short_m, footprint_m.norm());
  const float along = has_axes ? Extent(footprint_m, short_m, forwards) : across;
  const float from_centre = std::abs(s.left_m);

  GroundCover road = Cover(Pattern::kAsphalt, paint.asphalt_albedo, SemanticClass::kRoad);
  // Tyres polish two tracks a lane.
  const float lane = (from_centre - paint.median_half_m) / paint.lane_width_m;
  road.albedo *= 1 + 0.05f * std::cos(4 * static_cast<float>(M_PI) * lane);
  const GroundCover gutter = Cover(Pattern::kConcrete, 0.3f, SemanticClass::kRoad);
  const auto metre =
      std::min(static_cast<size_t>(std::max(0.0f, s.along_m)), paint.to_junction.size() - 1);
  const auto [ahead_m, behind_m] = paint.to_junction[metre];
  const bool open_road = s.marked && paint.marked && ahead_m > 0.5f && behind_m > 0.5f;
  if (open_road) {
    const GroundCover& strip = paint.strips[s.left_m > 0 ? 1 : 0];
    Mix(&road, strip, BandShare(from_centre, across, paint.lanes_half_m, 1e3f));
    if (scene_ != Scene::kFreeway) {
      Mix(&road, gutter,
          BandShare(from_centre, across, paint.lanes_half_m, paint.lanes_half_m + 0.25f));
    }
  }
  if (scene_ != Scene::kFreeway) Mix(&road, gutter, BandShare(s.edge_m, across, -0.2f, 1e3f));
  if (open_road) {
    const GroundCover white = Cover(Pattern::kPlain, 0.62f, SemanticClass::kRoad);
    if (paint.dashes) {
      const bool freeway = scene_ == Scene::kFreeway;
      const float dash =
          freeway ? DashShare(s.along_m, along, 6, 18) : DashShare(s.along_m, along, 3, 6);
      const int first = freeway ? 1 : 0, last = freeway ? paint.lanes - 1 : 0;
      const float half = freeway ? 0.075f : 0.06f;
      for (int k = first; k <= last; ++k) {
        const float at = paint.median_half_m + static_cast<float>(k) * paint.lane_width_m;
        const float x = freeway ? from_centre : s.left_m;
        Mix(&road, white, dash * BandShare(x, across, at - half, at + half));
      }
    }
    if (paint.edge_lines) {
      const float inner = paint.median_half_m - 0.15f, outer = paint.lanes_half_m + 0.15f;
      Mix(&road, white,
          BandShare(from_centre, across, inner - 0.1f, inner + 0.1f) +
              BandShare(from_centre, across, outer - 0.15f, outer + 0.15f));
    }
  }
  Mix(cover, road, BandShare(s.edge_m, across, -1e3f, 0));
}

void RoadGround::SetDecals(std::vector<Decal> decals) {
  decals_ = std::move(decals);
  const Eigen::Vector2d size = heights_.max_corner() - min_corner_;
  decal_columns_ = static_cast<int>(size.x() / kDecalCellM) + 1;
  decal_rows_ = static_cast<int>(size.y() / kDecalCellM) + 1;
  std::vector<std::pair<uint32_t, uint32_t>> entries;  // cell, decal
  for (uint32_t i = 0; i < decals_.size(); ++i) {
    const Decal& decal = decals_[i];
    const Eigen::Vector2f reach =
        decal.half_length_m * decal.along.cwiseAbs() +
        decal.half_width_m * Eigen::Vector2f(-decal.along.y(), decal.along.x()).cwiseAbs();
    const Eigen::Vector2f centre = decal.centre_in_enu - min_corner_.cast<float>();
    const Eigen::Vector2f low = (centre - reach).array() - 0.5f;
    const Eigen::Vector2f high = (centre + reach).array() + 0.5f;
    const int last_row = std::min(decal_rows_ - 1, static_cast<int>(high.y() / kDecalCellM));
    const int last_column = std::min(decal_columns_ - 1, static_cast<int>(high.x() / kDecalCellM));
    for (int row = std::max(0, static_cast<int>(low.y() / kDecalCellM)); row <= last_row; ++row) {
      for (int column = std::max(0, static_cast<int>(low.x() / kDecalCellM)); column <= last_column;
           ++column) {
        entries.push_back({static_cast<uint32_t>(row * decal_columns_ + column), i});
      }
    }
  }
  std::sort(entries.begin(), entries.end());
  const auto cells = static_cast<size_t>(decal_columns_) * static_cast<size_t>(decal_rows_);
  decal_begin_.assign(cells + 1, 0);
  decal_idxs_.clear();
  for (const auto& [cell, decal] : entries) {
    ++decal_begin_[cell + 1];
    decal_idxs_.push_back(decal);
  }
  for (size_t i = 0; i < cells; ++i) decal_begin_[i + 1] += decal_begin_[i];
}

void RoadGround::PaintDecals(const Eigen::Vector2f& p, const Eigen::Vector2f& footprint_m,
                             bool on_road, GroundCover* cover) const {
  const Eigen::Vector2f cell = (p - min_corner_.cast<float>()) / kDecalCellM;
  if (!(cell.minCoeff() >= 0) || cell.x() >= static_cast<float>(decal_columns_) ||
      cell.y() >= static_cast<float>(decal_rows_)) {
    return;
  }
  const auto idx = static_cast<size_t>(cell.y()) * decal_columns_ + static_cast<size_t>(cell.x());
  const float short_m = ShortAxis(footprint_m);
  for (uint32_t i = decal_begin_[idx]; i < decal_begin_[idx + 1]; ++i) {
    const Decal& decal = decals_[decal_idxs_[i]];
    if (on_road && !decal.on_road_too) continue;
    const Eigen::Vector2f v = p - decal.centre_in_enu;
    const Eigen::Vector2f across(-decal.along.y(), decal.along.x());
    const float x = v.dot(decal.along), y = v.dot(across);
    float share = 0;
    if (decal.shape == Decal::Shape::kRectangle) {
      share = BandShare(x, Extent(footprint_m, short_m, decal.along), -decal.half_length_m,
                        decal.half_length_m) *
              BandShare(y, Extent(footprint_m, short_m, across), -decal.half_width_m,
                        decal.half_width_m);
    } else {
      const float radius = Eigen::Vector2f(x / decal.half_length_m, y / decal.half_width_m).norm();
      const float edge_m = (radius - 1) * std::min(decal.half_length_m, decal.half_width_m);
      const float extent = 0.5f * (footprint_m.norm() + short_m);
      share = BandShare(edge_m, extent, -1e3f, 0);
    }
    Mix(cover, decal.cover, share);
  }
}

GroundCover RoadGround::CoverAt(const Eigen::Vector2f& p_in_enu,
                                const Eigen::Vector2f& footprint_m) const {
  GroundCover cover = scene_ == Scene::kDowntown
                          ? Cover(Pattern::kPaving, 0.24f, SemanticClass::kSidewalk)
                          : Cover(Pattern::kGrass, 0.17f, SemanticClass::kTerrain);
  Sample sample;
  const bool near_road = SampleAt(p_in_enu, &sample) && sample.line != kNoLine;
  const bool on_road = near_road && sample.edge_m < 0;
  if (near_road) PaintRoad(sample, footprint_m, &cover);
  PaintDecals(p_in_enu, footprint_m, on_road, &cover);
  return cover;
}

}  // namespace carmap
