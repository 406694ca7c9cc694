// The ground of a world of roads: sparse tiles of a raster near them, for speed.
//
// Each texel knows the nearest road and where on it it lies; between texels these numbers are
// linear, so edges and markings are as sharp as arithmetic, whatever the raster. What lies on the
// ground in one place only (patches, zebra crossings, manhole covers, driveways) are decals.
// Immutable once made, thread-safe; CoverAt allocates nothing.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/road/height_field.h"
#include "carmap/sim/road/road_network.h"

namespace carmap {

/// A rectangle or ellipse of other ground. Later ones lie on earlier ones.
struct Decal {
  enum class Shape : uint8_t { kRectangle, kEllipse };
  Eigen::Vector2f centre_in_enu = Eigen::Vector2f::Zero();
  Eigen::Vector2f along = {1, 0};  ///< unit length
  float half_length_m = 1, half_width_m = 1;
  Shape shape = Shape::kRectangle;
  bool on_road_too = true;  ///< else it shows only beside carriageways
  GroundCover cover;
};

/// A texel of the raster.
struct RoadTexel {
  float edge_m;   ///< to the edge of all carriageways' union, negative inside
  float left_m;   ///< of the nearest road's centre line
  float along_m;  ///< on it
  uint32_t line;
};

class RoadGround final : public GroundMap {
 public:
  RoadGround(Scene scene, const RoadNetwork& roads, HeightField heights, uint64_t seed);

  /// To be called once, before the ground is read.
  void SetDecals(std::vector<Decal> decals);

  double HeightAt(const Eigen::Vector2d& p_in_enu) const override;
  GroundCover CoverAt(const Eigen::Vector2f& p_in_enu,
                      const Eigen::Vector2f& footprint_m) const override;
  double CarriagewayDistance(const Eigen::Vector2d& p_in_enu) const override;

  const HeightField& heights() const { return heights_; }

  static constexpr double kTexelM = 0.5;
  static constexpr double kReachM = 8;  ///< beyond edges; farther the raster knows nothing
  static constexpr int kTileTexels = 32;

  /// Corners of the raster: tile `index` of them, each with one row and column of the next tile.
  struct Tile {
    std::array<RoadTexel, (kTileTexels + 1) * (kTileTexels + 1)> texels;
    const RoadTexel& At(int column, int row) const {
      return texels[static_cast<size_t>(row) * (kTileTexels + 1) + static_cast<size_t>(column)];
    }
  };
  int tile_columns() const { return tile_columns_; }
  int tile_rows() const { return tile_rows_; }
  /// Null where no road is near.
  const Tile* TileAt(int column, int row) const;
  Eigen::Vector2d min_corner() const { return min_corner_; }

 private:
  /// What a line looks like, ready for CoverAt.
  struct Paint {
    float lane_width_m, median_half_m, lanes_half_m;
    int lanes;
    bool dashes, edge_lines, marked;
    std::array<GroundCover, 2> strips;  ///< beyond the lanes, right and left
    float asphalt_albedo;
    std::vector<std::array<float, 2>> to_junction;  ///< ahead and behind, by metre
  };
  struct Sample;

  void Rasterize(const RoadNetwork& roads);
  Paint PaintOf(const CentreLine& line) const;
  bool SampleAt(const Eigen::Vector2f& p, Sample* sample) const;
  void PaintRoad(const Sample& sample, const Eigen::Vector2f& footprint_m,
                 GroundCover* cover) const;
  void PaintDecals(const Eigen::Vector2f& p, const Eigen::Vector2f& footprint_m, bool on_road,
                   GroundCover* cover) const;

  Scene scene_;
  uint64_t seed_;
  HeightField heights_;
  Eigen::Vector2d min_corner_;
  int tile_columns_ = 0, tile_rows_ = 0;
  std::vector<std::unique_ptr<Tile>> tiles_;
  std::vector<Paint> paints_;  ///< by line
  std::vector<Decal> decals_;
  std::vector<uint32_t> decal_begin_, decal_idxs_;  ///< by cell of the decals' grid
  int decal_columns_ = 0, decal_rows_ = 0;
};

}  // namespace carmap
