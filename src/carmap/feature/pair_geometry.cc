#include "carmap/feature/pair_geometry.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>

namespace carmap {
namespace {

constexpr int kMaxDistanceBits = 32;
constexpr double kMaxRatio = 0.8;
constexpr double kElsewherePx = 4;  ///< at the feature's level; nearer is the same place

double CoarserScale(const Feature& a, const Feature& b) {
  return ScaleOfLevel(std::max(a.level, b.level));
}

struct Candidate {
  size_t right_idx;
  int bits;
};

/// Features of the right image that the corner may be, or that may be taken for it.
std::vector<Candidate> CandidatesFor(const Feature& feature, const std::vector<Feature>& right,
                                     double max_rows_px) {
  constexpr int kMaxRivalBits = static_cast<int>(kMaxDistanceBits / kMaxRatio) + 1;
  std::vector<Candidate> candidates;
  for (size_t i = 0; i < right.size(); ++i) {
    const Feature& other = right[i];
    if (std::abs(other.y_px - feature.y_px) > max_rows_px ||
        std::abs(other.level - feature.level) > 1)
      continue;
    const int bits = HammingDistance(feature.descriptor, other.descriptor);
    if (bits <= kMaxRivalBits) candidates.push_back({i, bits});
  }
  return candidates;
}

/// The one that resembles it most, if none elsewhere does so nearly as well.
std::optional<Candidate> Clearest(const std::vector<Candidate>& candidates,
                                  const std::vector<Feature>& right) {
  if (candidates.empty()) return std::nullopt;
  const Candidate best =
      *std::min_element(candidates.begin(), candidates.end(),
                        [](const Candidate& a, const Candidate& b) { return a.bits < b.bits; });
  if (best.bits > kMaxDistanceBits) return std::nullopt;
  const Feature& found = right[best.right_idx];
  for (const Candidate& candidate : candidates) {
    const Feature& rival = right[candidate.right_idx];
    const bool is_elsewhere = std::hypot(rival.x_px - found.x_px, rival.y_px - found.y_px) >
                              kElsewherePx * CoarserScale(rival, found);
    if (is_elsewhere && best.bits > kMaxRatio * candidate.bits) return std::nullopt;
  }
  return best;
}

/// Of a row, as a part of the disparity.
constexpr double kNearSigma = 0.03;

/// What would be an arm's length away is a false match.
std::vector<CornerPair> WithoutNearest(const PinholeCamera& camera,
                                       const std::vector<CornerPair>& corners) {
  constexpr double kMaxDisparity = 0.2;  // of the image's width
  std::vector<CornerPair> left;
  std::copy_if(corners.begin(), corners.end(), std::back_inserter(left), [&](const CornerPair& c) {
    return std::abs(c.left_px.x() - c.right_px.x()) <= kMaxDisparity * camera.width;
  });
  return left;
}

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// One corner's equation: the row difference, over the focal length, by turn (3), place below and
/// before, and distortion.
struct RowEquation {
  Vector6 coefficients = Vector6::Zero();
  double rows = 0, sigma = 0;

  double ErrorOf(const Vector6& solution) const { return rows - coefficients.dot(solution); }
};

RowEquation EquationOf(const PinholeCamera& camera, const CornerPair& corner) {
  const Eigen::Vector2d centre(camera.cx, camera.cy), focal(camera.fx, camera.fy);
  const Eigen::Vector2d left = (corner.left_px - centre).cwiseQuotient(focal);
  const Eigen::Vector2d right = (corner.right_px - centre).cwiseQuotient(focal);
  const Eigen::Vector2d middle = (left + right) / 2;
  const double x = middle.x(), y = middle.y(), disparity = left.x() - right.x();
  RowEquation equation;
  equation.coefficients << 1 + y * y, -x * y, -x, -disparity, y * disparity, -2 * x * y * disparity;
  equation.rows = right.y() - left.y();
  // To the first order only; and a false match is often taken for something very near.
  equation.sigma = std::hypot(ScaleOfLevel(corner.level) / camera.fy, kNearSigma * disparity);
  return equation;
}

/// What a rig may be off at all, each of the six: keeps what a scene does not tell near zero.
const Vector6& PriorSigmas() {
  static const Vector6 sigmas = (Vector6() << 0.1, 0.1, 0.1, 1, 5, 1).finished();
  return sigmas;
}

Matrix6 InformationOf(const std::vector<RowEquation>& equations,
                      const std::vector<double>& weights) {
  Matrix6 information = PriorSigmas().cwiseAbs2().cwiseInverse().asDiagonal();
  for (size_t i = 0; i < equations.size(); ++i) {
    const RowEquation& equation = equations[i];
    information += weights[i] / (equation.sigma * equation.sigma) * equation.coefficients *
                   equation.coefficients.transpose();
  }
  return information;
}

Vector6 Solve(const std::vector<RowEquation>& equations, const std::vector<double>& weights) {
  Vector6 right_side = Vector6::Zero();
  for (size_t i = 0; i < equations.size(); ++i) {
    const RowEquation& equation = equations[i];
    right_side +=
        weights[i] / (equation.sigma * equation.sigma) * equation.rows * equation.coefficients;
  }
  return InformationOf(equations, weights).ldlt().solve(right_side);
}

/// Geman and McClure's weights, of errors of so many standard deviations.
void Weigh(const std::vector<RowEquation>& equations, const Vector6& solution, double sigmas,
           std::vector<double>& weights) {
  for (size_t i = 0; i < equations.size(); ++i) {
    const double error = equations[i].ErrorOf(solution) / (sigmas * equations[i].sigma);
    weights[i] = 1 / ((1 + error * error) * (1 + error * error));
  }
}

double RmsRows(const std::vector<RowEquation>& agreeing, const Vector6& part) {
  double sum = 0;
  for (const RowEquation& equation : agreeing) {
    const double rows = equation.coefficients.dot(part);
    sum += rows * rows;
  }
  return std::sqrt(sum / static_cast<double>(agreeing.size()));
}

double Correlation(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& point : points) mean += point / static_cast<double>(points.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& point : points) {
    scatter += (point - mean) * (point - mean).transpose();
  }
  const double spread = std::sqrt(scatter(0, 0) * scatter(1, 1));
  return spread > 0 ? scatter(0, 1) / spread : 0;
}

void DescribeDisparities(const PinholeCamera& camera, const std::vector<CornerPair>& agreeing,
                         PairGeometry& geometry) {
  std::vector<Eigen::Vector2d> row_and_size;
  size_t same = 0, backward = 0;
  for (const CornerPair& corner : agreeing) {
    const double disparity_px = corner.left_px.x() - corner.right_px.x();
    const double scale = ScaleOfLevel(corner.level);
    same += std::abs(disparity_px) < 0.5 * scale;
    backward += disparity_px < -scale;
    row_and_size.emplace_back(corner.left_px.y() - camera.cy, std::abs(disparity_px));
  }
  const auto count = static_cast<double>(agreeing.size());
  geometry.same_place_share = static_cast<double>(same) / count;
  geometry.backward_share = static_cast<double>(backward) / count;
  geometry.near_below = Correlation(row_and_size);
}

}  // namespace

std::vector<CornerPair> MatchCorners(const std::vector<Feature>& left,
                                     const std::vector<Feature>& right, double max_rows_px) {
  std::vector<int> least_bits(right.size(), std::numeric_limits<int>::max());
  std::vector<std::optional<Candidate>> found;
  for (const Feature& feature : left) {
    const std::vector<Candidate> candidates = CandidatesFor(feature, right, max_rows_px);
    for (const auto& [right_idx, bits] : candidates)
      least_bits[right_idx] = std::min(least_bits[right_idx], bits);
    found.push_back(Clearest(candidates, right));
  }
  std::vector<CornerPair> corners;
  for (size_t i = 0; i < left.size(); ++i) {
    if (!found[i] || found[i]->bits > least_bits[found[i]->right_idx]) continue;
    const Feature &l = left[i], &r = right[found[i]->right_idx];
    corners.push_back({{l.x_px, l.y_px}, {r.x_px, r.y_px}, std::max(l.level, r.level)});
  }
  return corners;
}

PairGeometry EstimatePairGeometry(const PinholeCamera& camera,
                                  const std::vector<CornerPair>& all_corners) {
  constexpr double kFirstSigmas = 40, kLastSigmas = 1.5, kStep = 0.7, kAgreeingSigmas = 2;
  const std::vector<CornerPair> corners = WithoutNearest(camera, all_corners);
  std::vector<RowEquation> equations;
  for (const CornerPair& corner : corners) equations.push_back(EquationOf(camera, corner));
  std::vector<double> weights(equations.size(), 1);
  Vector6 solution = Vector6::Zero();
  for (double sigmas = kFirstSigmas; sigmas > kLastSigmas; sigmas *= kStep) {
    Weigh(equations, solution, sigmas, weights);
    solution = Solve(equations, weights);
  }

  PairGeometry geometry;
  geometry.matches = corners.size();
  std::vector<RowEquation> agreeing;
  std::vector<CornerPair> agreeing_corners;
  for (size_t i = 0; i < equations.size(); ++i) {
    if (std::abs(equations[i].ErrorOf(solution)) > kAgreeingSigmas * equations[i].sigma) continue;
    agreeing.push_back(equations[i]);
    agreeing_corners.push_back(corners[i]);
  }
  geometry.agreeing = agreeing.size();
  if (agreeing.empty()) return geometry;

  geometry.turn_rad = solution.head<3>();
  geometry.below = solution[3];
  geometry.before = solution[4];
  geometry.distortion = solution[5];
  const auto part_px = [&](const Vector6& mask) {
    return camera.fy * RmsRows(agreeing, solution.cwiseProduct(mask));
  };
  geometry.turn_px = part_px({1, 1, 1, 0, 0, 0});
  geometry.place_px = part_px({0, 0, 0, 1, 1, 0});
  geometry.distortion_px = part_px({0, 0, 0, 0, 0, 1});
  const Matrix6 covariance =
      InformationOf(agreeing, std::vector<double>(agreeing.size(), 1)).inverse();
  geometry.rows_px = part_px(Vector6::Ones());
  geometry.before_sigma = std::sqrt(covariance(4, 4));
  geometry.distortion_sigma = std::sqrt(covariance(5, 5));
  DescribeDisparities(camera, agreeing_corners, geometry);
  return geometry;
}

}  // namespace carmap
