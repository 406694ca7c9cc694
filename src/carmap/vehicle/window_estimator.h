// Where a vehicle is in the base map, from the drive's own motion and the base landmarks that it
// sees (paper §3.2): a sliding window over its last keyframes, of which the older are marginalized
// (Sibley et al. 2010).
//
// Unknown are the poses of the window's frames. The motion between them is the drive's own
// odometry; base landmarks are held, with their uncertainty. Owned by one thread. Deterministic.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/solve/pose_refinement.h"
#include "carmap/solve/reprojection.h"

namespace carmap {

/// How far a vehicle's own motion can be trusted.
struct MotionNoise {
  double step_m = 0.004, step_rad = 0.0004;            ///< of each step, however short
  double drift_ratio = 0.006, drift_rad_per_m = 4e-4;  ///< grows with the distance of a step
  /// Of the scale of all motions together, against the map's: the disparity biases of the rigs that
  /// drive and mapped differ. Then how far it wanders from keyframe to keyframe.
  double scale = 0.01, scale_step = 3e-4;
};

struct WindowEstimatorOptions {
  MotionNoise motion;
  MeasurementNoise noise{.pixel_px = 0.5, .disparity_px = 0.5};  ///< as seen in other light
  size_t keyframes = 10;
  double keyframe_distance_m = 0.8, keyframe_turn_rad = 0.05;
  /// A landmark is seen in many frames, with the same error each time: what each says counts so
  /// much.
  double observation_weight = 0.4;
  /// Of a frame's own covariance, by its landmarks alone: so little the map's keyframes, which saw
  /// the same of the street, are known better.
  double map_jitter_ratio = 0.5;
  int iterations = 4;
};

/// A pose with its covariance in the tangent of Perturb (metres, radians, in the camera).
struct UncertainPose {
  Rigid3 camera_from_base;
  Matrix6d covariance = Matrix6d::Identity();
};

/// Base landmarks as a frame sees them.
struct SeenLandmarks {
  std::vector<PoseMeasurement> measurements;
  /// How much each would move, (u, v, disparity) in pixels, if the map's depths were off all alike,
  /// by a standard deviation.
  std::vector<Eigen::Vector3d> common_shift_px;
  /// Of the matches that agree. Where many do not, as under another sun, some of those that do are
  /// wrong too, by little; each counts by the square of this.
  double inlier_share = 1;
};

/// Covariance of one step of a vehicle's own motion.
Matrix6d MotionCovariance(const Rigid3& camera_from_previous, const MotionNoise& noise);

/// The pose after a step, when nothing else is known of it.
UncertainPose AfterMotion(const UncertainPose& before, const Rigid3& camera_from_previous,
                          const Matrix6d& motion_covariance);

class WindowEstimator {
 public:
  /// Starts at the pose of a first frame.
  WindowEstimator(const StereoRig& rig, const WindowEstimatorOptions& options,
                  const UncertainPose& start);

  /// A new frame: where its motion since the one before leads, and the base landmarks that agree
  /// with it (may be none). Moves the frames of the window to where all fits best.
  void Add(const Rigid3& camera_from_previous, const Matrix6d& motion_covariance,
           SeenLandmarks seen);

  /// The pose of the newest frame. Its covariance includes what no number of its frames averages
  /// out: what the depths of the map have in common (rigs are calibrated to some tenths of a
  /// pixel), and how well the map's own keyframes are known.
  const UncertainPose& newest() const { return newest_; }

 private:
  struct Frame {
    Rigid3 camera_from_base;
    Rigid3 camera_from_previous;  ///< of the frame before it in the window
    Matrix6d motion_covariance = Matrix6d::Zero();
    SeenLandmarks seen;
    std::vector<WhitenedMeasurement> whitened;
  };
  using Vector7d = Eigen::Matrix<double, 7, 1>;
  using Matrix7d = Eigen::Matrix<double, 7, 7>;
  /// What frames that left the window say of its oldest and of the scale: a quadratic around
  /// `camera_from_base` and `scale`.
  struct Prior {
    Rigid3 camera_from_base;
    double scale = 1;
    Matrix7d information = Matrix7d::Zero();
    Vector7d gradient = Vector7d::Zero();
  };
  /// In the tangents of the frames' poses, the oldest first, and the scale.
  struct Normal {
    Eigen::MatrixXd hessian;
    Eigen::VectorXd gradient;
  };

  bool IsKeyframe(const Frame& frame) const;
  void MarginalizeOldest();
  template <typename Visit>
  void VisitMeasurements(const Frame& frame, Visit&& visit) const;
  Matrix6d MapCovariance(const Frame& frame) const;
  Rigid3 MotionOf(const Frame& frame) const;
  static void AddTerm(size_t first, const Eigen::MatrixXd& hessian, const Eigen::VectorXd& gradient,
                      Normal& normal);
  void AddMotion(size_t idx, Normal& normal) const;
  void AddPrior(Normal& normal) const;
  Normal Linearize(size_t frames, size_t measured) const;
  void Solve();

  const StereoRig rig_;
  const WindowEstimatorOptions options_;
  Prior prior_;
  std::deque<Frame> frames_;
  double scale_ = 1;  ///< of the map by that of the vehicle's own motion
  UncertainPose newest_;
  Matrix6d map_covariance_ = Matrix6d::Zero();  ///< where enough of the base was seen last
};

}  // namespace carmap
