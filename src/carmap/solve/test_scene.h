// A street of random landmarks and what a stereo camera measures of them. For the tests of solve/.
#pragma once

#include <random>
#include <vector>

#include "carmap/solve/bundle_adjustment.h"
#include "carmap/solve/pose_refinement.h"
#include "carmap/solve/reprojection.h"

namespace carmap {

inline const StereoRig kTestRig{{718, 720, 607, 185, 1226, 370}, 0.54};

inline const MeasurementNoise kTestNoise{.pixel_px = 1, .disparity_px = 0.7};

class TestRandom {
 public:
  explicit TestRandom(uint64_t seed) : generator_(seed) {}

  double Uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(generator_() >> 11) * 0x1p-53;
  }
  /// Near enough to a normal distribution, and the same with every standard library.
  double Normal(double sigma) {
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += Uniform(0, 1);
    return sigma * sum;
  }
  Eigen::Vector3d Normal3(double sigma) { return {Normal(sigma), Normal(sigma), Normal(sigma)}; }

  Vector6d Tangent(double sigma_m, double sigma_rad) {
    Vector6d delta;
    delta.head<3>() = Normal3(sigma_m);
    delta.tail<3>() = Normal3(sigma_rad);
    return delta;
  }
  Rigid3 Pose(double sigma_m, double sigma_rad) {
    return Perturb(Rigid3(), Tangent(sigma_m, sigma_rad));
  }
  /// In the image, 4 to 50 m away.
  Eigen::Vector3d PointInCamera() {
    return kTestRig.camera.Unproject({Uniform(0, 1225), Uniform(0, 369)}, Uniform(4, 50));
  }

 private:
  std::mt19937_64 generator_;
};

struct TestNoise {
  double pixel_px = 0, disparity_px = 0;
  double outlier_ratio = 0;  ///< of measurements moved by 20 to 100 px
  double mono_ratio = 0.2;   ///< of measurements without disparity
};

template <typename Measurement>
void Measure(const Eigen::Vector3d& p_in_camera, const TestNoise& noise, TestRandom& random,
             Measurement& m) {
  m.scale = random.Uniform(0, 1) < 0.5 ? 1 : 1.44;
  const Eigen::Vector3d uvd = kTestRig.Project(p_in_camera);
  m.px.x() = uvd.x() + random.Normal(noise.pixel_px * m.scale);
  m.px.y() = uvd.y() + random.Normal(noise.pixel_px * m.scale);
  m.disparity_px = uvd.z() + random.Normal(noise.disparity_px * m.scale);
  if (random.Uniform(0, 1) < noise.mono_ratio) m.disparity_px = -1;
  if (random.Uniform(0, 1) < noise.outlier_ratio) {
    m.px.x() += random.Uniform(20, 100);
    m.px.y() -= random.Uniform(20, 100);
  }
}

inline std::vector<PoseMeasurement> MeasureScene(const Rigid3& camera_from_map, int count,
                                                 const TestNoise& noise, TestRandom& random) {
  std::vector<PoseMeasurement> measurements(count);
  const Rigid3 map_from_camera = camera_from_map.Inverse();
  for (PoseMeasurement& m : measurements) {
    const Eigen::Vector3d p = random.PointInCamera();
    m.position_in_map = map_from_camera * p;
    Measure(p, noise, random, m);
  }
  return measurements;
}

/// A drive straight ahead, 1 m between the poses; the first two are fixed. Poses and points are
/// true.
inline Bundle MakeBundle(int pose_count, int point_count, const TestNoise& noise,
                         TestRandom& random) {
  Bundle bundle;
  bundle.rig = kTestRig;
  bundle.noise = kTestNoise;
  for (int i = 0; i < pose_count; ++i) {
    bundle.camera_from_map.push_back(
        Perturb({Eigen::Quaterniond::Identity(), {0, 0, -1.0 * i}}, random.Tangent(0.05, 0.02)));
    bundle.pose_is_fixed.push_back(i < 2);
  }
  for (int j = 0; j < point_count; ++j) {
    bundle.points_in_map.push_back(random.PointInCamera() + Eigen::Vector3d(0, 0, pose_count));
    for (int i = 0; i < pose_count; ++i) {
      const Eigen::Vector3d p = bundle.camera_from_map[i] * bundle.points_in_map[j];
      if (!kTestRig.camera.Contains(kTestRig.camera.Project(p))) continue;
      BundleObservation& o = bundle.observations.emplace_back();
      o.pose_idx = i;
      o.point_idx = j;
      Measure(p, noise, random, o);
    }
  }
  return bundle;
}

/// Moves free poses and all points away from where they are.
inline void Disturb(Bundle& bundle, double sigma_m, double sigma_rad, TestRandom& random) {
  for (size_t i = 0; i < bundle.camera_from_map.size(); ++i) {
    if (bundle.pose_is_fixed[i]) continue;
    bundle.camera_from_map[i] =
        Perturb(bundle.camera_from_map[i], random.Tangent(sigma_m, sigma_rad));
  }
  for (Eigen::Vector3d& point : bundle.points_in_map) point += random.Normal3(sigma_m);
}

inline double RotationBetween(const Rigid3& a, const Rigid3& b) {
  return RotationAngle(a.rotation * b.rotation.conjugate());
}
inline double DistanceBetween(const Rigid3& a, const Rigid3& b) {
  return (a.Inverse().translation - b.Inverse().translation).norm();
}
inline bool SameBits(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

}  // namespace carmap
