#include "carmap/sim/road/height_field.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/base/random.h"

namespace carmap {
namespace {

constexpr double kCellM = 8;
constexpr double kMarginM = 900;  // of ground round the roads, up to the skyline

/// The sum of some waves of about these lengths, each of amplitude 1.
class Waves {
 public:
  Waves(uint64_t seed, double min_length_m, double max_length_m) {
    HashSequence draw(seed);
    for (Wave& wave : waves_) {
      const double heading = draw.Between(-M_PI, M_PI);
      const double length_m = draw.Between(min_length_m, max_length_m);
      wave.k = 2 * M_PI / length_m * Eigen::Vector2d(std::cos(heading), std::sin(heading));
      wave.phase = draw.Between(-M_PI, M_PI);
    }
  }
  double At(const Eigen::Vector2d& p) const {
    double sum = 0;
    for (const Wave& wave : waves_) sum += std::sin(wave.k.dot(p) + wave.phase);
    return sum;
  }

 private:
  struct Wave {
    Eigen::Vector2d k;
    double phase;
  };
  std::array<Wave, 5> waves_;
};

double SmoothStep(double low, double high, double x) {
  const double t = std::clamp((x - low) / (high - low), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

/// Weights of four neighbouring control points.
std::array<double, 4> SplineWeights(double t) {
  const double s = 1 - t;
  return {s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6, (3 * s * s * s - 6 * s * s + 4) / 6,
          t * t * t / 6};
}

/// Mean over 2 radius + 1 neighbours, cells outside counting as zero.
void BoxBlur(const double* in, double* out, int count, int stride, int radius) {
  const double scale = 1.0 / (2 * radius + 1);
  double sum = 0;
  for (int i = 0; i < std::min(radius, count); ++i) sum += in[i * stride];
  for (int i = 0; i < count; ++i) {
    if (i + radius < count) sum += in[(i + radius) * stride];
    if (i - radius - 1 >= 0) sum -= in[(i - radius - 1) * stride];
    out[i * stride] = sum * scale;
  }
}

}  // namespace

HeightField::HeightField(const std::vector<Eigen::Vector2d>& roads,
                         const std::vector<Eigen::Vector3d>& heights, uint64_t seed,
                         const GroundBanks& banks) {
  Eigen::Vector2d low = roads.front(), high = roads.front();
  for (const Eigen::Vector2d& p : roads) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // On whole cells of enu: the same place has the same height in a longer world.
  min_corner_ = kCellM * ((low.array() - kMarginM) / kCellM).floor();
  const Eigen::Vector2d size = (high.array() + kMarginM).matrix() - min_corner_;
  columns_ = static_cast<int>(std::ceil(size.x() / kCellM)) + 1;
  rows_ = static_cast<int>(std::ceil(size.y() / kCellM)) + 1;
  const std::vector<double> distances = RoadDistances(roads);
  road_distances_.assign(distances.begin(), distances.end());
  heights_.assign(distances.size(), 0);
  if (heights.empty()) {
    AddRolling(seed);
  } else {
    AddRoads(heights);
  }
  AddHills(seed);
  if (banks.height_m > 0) AddBanks(seed, banks);
}

Eigen::Vector2d HeightField::max_corner() const { return Centre(columns_ - 1, rows_ - 1); }

Eigen::Vector2d HeightField::Centre(int column, int row) const {
  return min_corner_ + kCellM * Eigen::Vector2d(column, row);
}

size_t HeightField::Index(int column, int row) const {
  return static_cast<size_t>(std::clamp(row, 0, rows_ - 1)) * static_cast<size_t>(columns_) +
         static_cast<size_t>(std::clamp(column, 0, columns_ - 1));
}

double HeightField::At(const Eigen::Vector2d& p_in_enu) const {
  const Eigen::Vector2d cell = (p_in_enu - min_corner_) / kCellM;
  const double column = std::clamp(std::floor(cell.x()), -2.0, columns_ + 1.0);
  const double row = std::clamp(std::floor(cell.y()), -2.0, rows_ + 1.0);
  const auto wx = SplineWeights(std::clamp(cell.x() - column, 0.0, 1.0));
  const auto wy = SplineWeights(std::clamp(cell.y() - row, 0.0, 1.0));
  double height = 0;
  for (int y = 0; y < 4; ++y) {
    double sum = 0;
    for (int x = 0; x < 4; ++x) {
      sum += wx[static_cast<size_t>(x)] *
             heights_[Index(static_cast<int>(column) + x - 1, static_cast<int>(row) + y - 1)];
    }
    height += wy[static_cast<size_t>(y)] * sum;
  }
  return height;
}

double HeightField::RoadDistanceAt(const Eigen::Vector2d& p_in_enu) const {
  const Eigen::Vector2d cell = (p_in_enu - min_corner_) / kCellM;
  return road_distances_[Index(static_cast<int>(std::clamp(cell.x(), -1.0, columns_ + 0.0) + 0.5),
                               static_cast<int>(std::clamp(cell.y(), -1.0, rows_ + 0.0) + 0.5))];
}

/// Two passes of a chamfer over the grid (Borgefors 1986).
std::vector<double> HeightField::RoadDistances(const std::vector<Eigen::Vector2d>& roads) const {
  std::vector<double> distances(static_cast<size_t>(columns_) * static_cast<size_t>(rows_), 1e6);
  for (const Eigen::Vector2d& p : roads) {
    const Eigen::Vector2d cell = (p - min_corner_) / kCellM;
    distances[Index(static_cast<int>(cell.x() + 0.5), static_cast<int>(cell.y() + 0.5))] = 0;
  }
  const auto relax = [&](int column, int row, int step) {
    double& d = distances[Index(column, row)];
    for (const auto& [x, y] : {std::pair{-1, 0}, {0, -1}, {-1, -1}, {1, -1}}) {
      const int c = column + step * x, r = row + step * y;
      if (c < 0 || r < 0 || c >= columns_ || r >= rows_) continue;
      d = std::min(d, distances[Index(c, r)] + kCellM * (x != 0 && y != 0 ? M_SQRT2 : 1));
    }
  };
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) relax(column, row, 1);
  }
  for (int row = rows_ - 1; row >= 0; --row) {
    for (int column = columns_ - 1; column >= 0; --column) relax(column, row, -1);
  }
  return distances;
}

std::vector<double> HeightField::Blurred(const std::vector<double>& grid, int radius) const {
  std::vector<double> a = grid, b(grid.size());
  for (int pass = 0; pass < 3; ++pass) {  // three boxes make nearly a Gaussian
    for (int row = 0; row < rows_; ++row) {
      BoxBlur(&a[Index(0, row)], &b[Index(0, row)], columns_, 1, radius);
    }
    for (int column = 0; column < columns_; ++column) {
      BoxBlur(&b[Index(column, 0)], &a[Index(column, 0)], rows_, columns_, radius);
    }
  }
  return a;
}

/// The average of the given heights, near ones first: by a Gaussian of 28 m, one of 125 m where the
/// first does not reach, and the mean of all beyond.
void HeightField::AddRoads(const std::vector<Eigen::Vector3d>& heights) {
  std::vector<double> weights(heights_.size()), sums(heights_.size());
  double mean = 0;
  for (const Eigen::Vector3d& p : heights) {
    const Eigen::Vector2d cell = (p.head<2>() - min_corner_) / kCellM;
    const int column = static_cast<int>(cell.x()), row = static_cast<int>(cell.y());
    const double tx = cell.x() - column, ty = cell.y() - row;
    for (const auto& [x, y] : {std::pair{0, 0}, {1, 0}, {0, 1}, {1, 1}}) {
      const double weight = (x != 0 ? tx : 1 - tx) * (y != 0 ? ty : 1 - ty);
      weights[Index(column + x, row + y)] += weight;
      sums[Index(column + x, row + y)] += weight * p.z();
    }
    mean += p.z() / static_cast<double>(heights.size());
  }
  const std::vector<double> near_w = Blurred(weights, 3), near_s = Blurred(sums, 3);
  const std::vector<double> far_w = Blurred(weights, 15), far_s = Blurred(sums, 15);
  constexpr double kFar = 1e-3, kBeyond = 1e-6;
  for (size_t i = 0; i < heights_.size(); ++i) {
    heights_[i] += static_cast<float>((near_s[i] + kFar * far_s[i] + kBeyond * mean) /
                                      (near_w[i] + kFar * far_w[i] + kBeyond));
  }
}

void HeightField::AddRolling(uint64_t seed) {
  const Waves waves(HashKeys(seed, 0x726f6c6c), 150, 600);
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      heights_[Index(column, row)] += static_cast<float>(0.9 * waves.At(Centre(column, row)));
    }
  }
}

void HeightField::AddHills(uint64_t seed) {
  const Waves waves(HashKeys(seed, 0x68696c6c), 350, 1400);
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const size_t i = Index(column, row);
      const double rise = SmoothStep(150, 800, road_distances_[i]);
      if (rise == 0) continue;
      heights_[i] += static_cast<float>(rise * (28 + 7 * waves.At(Centre(column, row))));
    }
  }
}

void HeightField::AddBanks(uint64_t seed, const GroundBanks& banks) {
  const Waves waves(HashKeys(seed, 0x62616e6b), 250, 900);
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const size_t i = Index(column, row);
      const double rise = SmoothStep(banks.from_m, banks.to_m, road_distances_[i]);
      // More often a cutting than an embankment.
      const double wave = 0.4 + 0.6 * waves.At(Centre(column, row));
      heights_[i] += static_cast<float>(rise * banks.height_m * std::clamp(wave, -0.6, 1.0));
    }
  }
}

}  // namespace carmap
