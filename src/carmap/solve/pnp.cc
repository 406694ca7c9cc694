#include "carmap/solve/pnp.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/calib3d.hpp>
#include <random>

#include "carmap/solve/alignment.h"
#include "carmap/solve/reprojection.h"

namespace carmap {
namespace {

constexpr size_t kSampleSize = 3;
// Of the bound on inliers: a sample should be of good measurements, of which some always are.
constexpr double kSampleTightness = 1.0 / 3;
constexpr int kStereoSteps = 3;
// So many with depth, and samples are of these: they are solved for a tenth of the time.
constexpr size_t kMinStereo = 20;
// Three measurements tell nothing of how noisy they are: pixels and disparities weigh the same.
constexpr MeasurementNoise kPixelNoise{.pixel_px = 1, .disparity_px = 1};

using Sample = std::array<size_t, kSampleSize>;

class PnpRansac {
 public:
  PnpRansac(const StereoRig& rig, const MeasurementNoise& noise,
            const std::vector<PoseMeasurement>& measurements, const PnpOptions& options)
      : rig_(rig),
        noise_(noise),
        measurements_(measurements),
        options_(options),
        random_(options.seed) {
    seen_.reserve(measurements.size());
    for (const PoseMeasurement& m : measurements) seen_.push_back(See(m));
    for (size_t i = 0; i < seen_.size(); ++i) {
      if (IsStereo(i)) drawn_from_.push_back(i);
    }
    if (drawn_from_.size() < kMinStereo) {
      drawn_from_.resize(seen_.size());
      std::iota(drawn_from_.begin(), drawn_from_.end(), 0);
    }
  }

  std::optional<PoseEstimate> Run() {
    if (measurements_.size() < kSampleSize) return std::nullopt;
    size_t best_count = 0;
    Rigid3 best;
    int iterations = options_.max_iterations;
    for (int i = 0; i < iterations; ++i) {
      const Sample sample = DrawSample();
      if (!KeepsDistances(sample)) continue;
      for (const Rigid3& pose : SolveMinimal(sample)) {
        if (!IsUpright(pose) || !AgreesWithSample(pose, sample)) continue;
        const size_t count = CountInliers(pose, best_count);
        if (count <= best_count) continue;
        best_count = count;
        best = pose;
        iterations = IterationsNeeded(best_count);
      }
    }
    if (best_count < kSampleSize) return std::nullopt;
    const PoseEstimate coarse = RefineOn(InliersOf(best), best);
    PoseEstimate fine = RefineOn(InliersOf(coarse.camera_from_map), coarse.camera_from_map);
    if (fine.inlier_count < std::max<int>(options_.min_inliers, kSampleSize)) return std::nullopt;
    return fine;
  }

 private:
  /// Until a sample of inliers only has been drawn with the wanted confidence.
  int IterationsNeeded(size_t inlier_count) const {
    const double ratio = static_cast<double>(inlier_count) / measurements_.size();
    const double all_good = std::pow(ratio, kSampleSize);
    if (all_good <= 0) return options_.max_iterations;
    if (all_good >= 1) return 1;
    const double needed = std::log(1 - options_.confidence) / std::log1p(-all_good);
    return needed < options_.max_iterations ? static_cast<int>(std::ceil(needed))
                                            : options_.max_iterations;
  }

  /// Not std::uniform_int_distribution, whose output differs between standard libraries.
  size_t DrawIndex() { return drawn_from_[(random_() >> 32) * drawn_from_.size() >> 32]; }

  Sample DrawSample() {
    Sample sample;
    for (size_t i = 0; i < kSampleSize; ++i) {
      do {
        sample[i] = DrawIndex();
      } while (std::find(sample.begin(), sample.begin() + i, sample[i]) != sample.begin() + i);
    }
    return sample;
  }

  /// Where the stereo pair sees a landmark, and how far off that may be.
  struct SeenPoint {
    Eigen::Vector3d p_in_camera = Eigen::Vector3d::Zero();
    double error_m = std::numeric_limits<double>::infinity();
  };

  SeenPoint See(const PoseMeasurement& m) const {
    const double bound = kSampleTightness * options_.inlier_px * m.scale;
    if (!(m.disparity_px > bound)) return {};
    const Eigen::Vector3d p = rig_.Triangulate(m.px, m.disparity_px);
    const double along_m = rig_.DepthAt(m.disparity_px - bound) - p.z();
    const double across_m = p.z() * bound / rig_.camera.fx;
    return {p, along_m * p.norm() / p.z() + across_m};
  }

  /// Rejects nearly all samples with a wrong match for next to nothing: a pose leaves the distances
  /// between landmarks as they are.
  bool KeepsDistances(const Sample& sample) const {
    for (size_t i = 0; i < kSampleSize; ++i) {
      const size_t a = sample[i], b = sample[(i + 1) % kSampleSize];
      const double seen_m = (seen_[a].p_in_camera - seen_[b].p_in_camera).norm();
      const double known_m =
          (measurements_[a].position_in_map - measurements_[b].position_in_map).norm();
      if (std::abs(seen_m - known_m) > seen_[a].error_m + seen_[b].error_m) return false;
    }
    return true;
  }

  std::vector<Rigid3> SolveMinimal(const Sample& sample) const {
    const bool is_stereo =
        std::all_of(sample.begin(), sample.end(), [&](size_t i) { return IsStereo(i); });
    return is_stereo ? SolveStereo(sample) : SolveP3P(sample);
  }

  bool IsStereo(size_t i) const {
    return std::isfinite(seen_[i].error_m) && measurements_[i].position_in_map.allFinite();
  }

  /// The pose that puts the three landmarks where stereo sees them, and from there the one that
  /// sees them best: depths are far less certain than pixels.
  std::vector<Rigid3> SolveStereo(const Sample& sample) const {
    std::vector<Eigen::Vector3d> known, seen;
    for (const size_t i : sample) {
      known.push_back(measurements_[i].position_in_map);
      seen.push_back(seen_[i].p_in_camera);
    }
    auto pose = AlignRigidly(known, seen);
    if (!pose || !IsUpright(*pose)) return {};
    for (int step = 0; pose && step < kStereoSteps; ++step) pose = StepOnSample(sample, *pose);
    if (!pose) return {};
    return {*pose};
  }

  /// One Gauss-Newton step; nothing where a landmark gets behind the camera.
  std::optional<Rigid3> StepOnSample(const Sample& sample, const Rigid3& pose) const {
    PoseNormal normal;
    for (const size_t i : sample) {
      const PoseMeasurement& m = measurements_[i];
      const WhitenedMeasurement whitened = Whiten(kPixelNoise, m.px, m.disparity_px, m.scale);
      const Eigen::Vector3d p = pose * m.position_in_map;
      Eigen::Vector3d error;
      if (!WhitenedError(rig_, whitened, p, error)) return std::nullopt;
      normal.Add(MakePointTerm(rig_, whitened, p, error, /*weight=*/1), p);
    }
    const Matrix6d hessian = normal.hessian.selfadjointView<Eigen::Lower>();
    const Vector6d delta = -hessian.ldlt().solve(normal.gradient);
    if (!delta.allFinite()) return std::nullopt;
    return Perturb(pose, delta);
  }

  /// Up to four poses that project the three landmarks onto their pixels.
  std::vector<Rigid3> SolveP3P(const Sample& sample) const {
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> pixels;
    for (const size_t i : sample) {
      const PoseMeasurement& m = measurements_[i];
      if (!m.position_in_map.allFinite() || !m.px.allFinite()) return {};
      points.emplace_back(m.position_in_map.x(), m.position_in_map.y(), m.position_in_map.z());
      pixels.emplace_back(m.px.x(), m.px.y());
    }
    const PinholeCamera& c = rig_.camera;
    const cv::Matx33d intrinsics(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
    std::vector<cv::Vec3d> rotations, translations;
    // OpenCV's other solver, AP3P, gives other last bits from run to run.
    cv::solveP3P(points, pixels, intrinsics, cv::noArray(), rotations, translations,
                 cv::SOLVEPNP_P3P);
    std::vector<Rigid3> poses;
    for (size_t i = 0; i < rotations.size(); ++i) {
      const Eigen::Vector3d turn(rotations[i].val), translation(translations[i].val);
      if (turn.allFinite() && translation.allFinite()) {
        poses.push_back({RotationExp(turn), translation});
      }
    }
    return poses;
  }

  bool IsUpright(const Rigid3& camera_from_map) const {
    if (!options_.down_in_map) return true;
    return (camera_from_map.rotation * *options_.down_in_map).y() >=
           std::cos(options_.max_tilt_rad);
  }

  /// Rejects most of the wrong solutions cheaply: they contradict the disparities.
  bool AgreesWithSample(const Rigid3& pose, const Sample& sample) const {
    return std::all_of(sample.begin(), sample.end(),
                       [&](size_t i) { return Agrees(pose, measurements_[i]); });
  }

  bool Agrees(const Rigid3& pose, const PoseMeasurement& m) const {
    const Eigen::Vector3d p = pose * m.position_in_map;
    if (!(p.z() > 0)) return false;
    const double bound = options_.inlier_px * m.scale;
    if (!((rig_.camera.Project(p) - m.px).squaredNorm() <= bound * bound)) return false;
    return !(m.disparity_px > 0) || std::abs(rig_.DisparityAt(p.z()) - m.disparity_px) <= bound;
  }

  /// Gives up once more than `count_to_beat` can no longer be reached.
  size_t CountInliers(const Rigid3& pose, size_t count_to_beat) const {
    size_t count = 0;
    for (size_t i = 0; i < measurements_.size(); ++i) {
      if (count + (measurements_.size() - i) <= count_to_beat) break;
      if (Agrees(pose, measurements_[i])) ++count;
    }
    return count;
  }

  std::vector<size_t> InliersOf(const Rigid3& pose) const {
    std::vector<size_t> inliers;
    for (size_t i = 0; i < measurements_.size(); ++i) {
      if (Agrees(pose, measurements_[i])) inliers.push_back(i);
    }
    return inliers;
  }

  /// RefinePose on a part of the measurements; its inliers are told of all of them.
  PoseEstimate RefineOn(const std::vector<size_t>& chosen, const Rigid3& initial) const {
    std::vector<PoseMeasurement> part;
    part.reserve(chosen.size());
    for (const size_t i : chosen) part.push_back(measurements_[i]);
    PoseEstimate estimate = RefinePose(rig_, noise_, part, initial);
    std::vector<bool> is_inlier(measurements_.size(), false);
    for (size_t k = 0; k < chosen.size(); ++k) is_inlier[chosen[k]] = estimate.is_inlier[k];
    estimate.is_inlier = std::move(is_inlier);
    return estimate;
  }

  const StereoRig& rig_;
  const MeasurementNoise& noise_;
  const std::vector<PoseMeasurement>& measurements_;
  const PnpOptions& options_;
  std::mt19937_64 random_;
  std::vector<SeenPoint> seen_;
  std::vector<size_t> drawn_from_;  ///< what samples are of
};

}  // namespace

std::optional<PoseEstimate> SolvePnpRansac(const StereoRig& rig, const MeasurementNoise& noise,
                                           const std::vector<PoseMeasurement>& measurements,
                                           const PnpOptions& options) {
  return PnpRansac(rig, noise, measurements, options).Run();
}

}  // namespace carmap
