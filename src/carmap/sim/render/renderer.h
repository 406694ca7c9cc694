// What a camera sees of the simulated world: light, and the truth about each pixel.
//
// Rays are cast by Embree. A Renderer is owned by one thread and uses all cores; its images are the
// same bytes for the same input, whatever the number of cores.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/sim/render/light.h"
#include "carmap/sim/town/world.h"

namespace carmap {

/// One camera's view before the sensor: linear light, and the truth at each pixel's centre.
struct RenderedView {
  cv::Mat radiance;    ///< CV_32F, linear; a white surface in full daylight is about 1
  cv::Mat depth_m;     ///< CV_32F, along z of the camera; 0 where there is sky
  cv::Mat labels;      ///< CV_8U, SemanticClass
  cv::Mat instances;   ///< CV_16U, Placement::instance
  cv::Mat mobilities;  ///< CV_8U, PlacementMobility
  cv::Mat motion_px;   ///< CV_32FC2, where each pixel's point goes per second, for motion blur
};

/// How the camera and moving things move, for motion blur.
struct ViewMotion {
  Eigen::Vector3d velocity_in_camera = Eigen::Vector3d::Zero();          ///< m/s
  Eigen::Vector3d angular_velocity_in_camera = Eigen::Vector3d::Zero();  ///< rad/s
};

/// What rectification left of a lens: where an ideal camera sees the direction (x, y, 1), this one
/// sees (x + column(x, y), y + row(x, y), 1).
struct RectificationResidual {
  /// Coefficients of 1, x, y, x², xy, y².
  std::array<float, 6> column{}, row{};
};

class Renderer {
 public:
  /// Builds the acceleration structures. `vehicle_models` follow the world's models in the
  /// numbering of Placement::model_idx.
  Renderer(std::shared_ptr<const World> world, const std::vector<Mesh>& vehicle_models,
           const Light& light, uint64_t seed);
  ~Renderer();

  /// Sets what is not part of the world: parked and moving things, by now.
  void SetTraffic(const std::vector<Placement>& traffic);

  RenderedView Render(const PinholeCamera& camera, const Rigid3& enu_from_camera,
                      const ViewMotion& motion, const RectificationResidual& residual = {}) const;

  /// Left and right view at once; poses and faults in that order.
  std::array<RenderedView, 2> RenderStereo(
      const StereoRig& rig, const Rigid3& enu_from_left, const ViewMotion& motion,
      const std::array<RectificationResidual, 2>& residuals) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace carmap
