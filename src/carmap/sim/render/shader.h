// What rays find and how it is lit: the work on many samples of an image together.
//
// Coordinates are relative to the scene's origin. A Shader does not change; each thread has its own
// Batch.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/sim/render/light.h"
#include "carmap/sim/render/ray_scene.h"
#include "carmap/sim/render/renderer.h"
#include "carmap/sim/render/sky.h"
#include "carmap/sim/render/texture.h"
#include "carmap/sim/road/ground_map.h"

namespace carmap {

struct View {
  View(const PinholeCamera& the_camera, const RectificationResidual& the_residual,
       const Rigid3& enu_from_camera, const Eigen::Vector3d& origin_in_enu);
  /// Not of unit length: the multiple that reaches a point is its depth.
  Eigen::Vector3f Ray(float u, float v) const;

  PinholeCamera camera;
  RectificationResidual residual;
  Eigen::Vector3f eye;
  Eigen::Matrix3f from_camera;  ///< rotation
  Eigen::Vector3f right, down;  ///< how the ray changes from pixel to pixel
  float pixel_rad = 0;
};

/// What a point of the image shows.
struct Sample {
  static constexpr uint32_t kSky = ~0u;
  static constexpr float kUnknown = -1;

  float depth_m = 0;
  uint32_t group = kSky;  ///< the same on one surface of one placement
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  Eigen::Vector3f position = Eigen::Vector3f::Zero();
  float fixed = 0;            ///< light but for ...
  float ambient = 0;          ///< ... that of the sky, were all of it open
  float open = 0;             ///< what one direction tells about the sky, 0 or `weight`
  float weight = 0;           ///< what that counts
  float openness = 0.5f;      ///< the open share of the sky
  float sunny = kUnknown;     ///< share of the sun's light that arrives
  float mirrored = kUnknown;  ///< what a glossy surface shows of its surroundings
  bool rough = false;         ///< one of many leaves

  bool is_sky() const { return group == kSky; }
};

/// Whether both lie on one smooth piece of a surface.
bool Continuous(const Sample& a, const Sample& b);

/// Samples that go through the stages of shading together.
struct Batch {
  static constexpr int kCapacity = TextureSpots::kCapacity;

  int count = 0;
  float u[kCapacity], v[kCapacity];  ///< place in the image
  Eigen::Vector3f ray[kCapacity];
  Sample sample[kCapacity];
  RayHit hit[kCapacity];
  GroundCover cover[kCapacity];
  TextureSpots spots;
  float brightness[kCapacity];  ///< of the texture
};

class Shader {
 public:
  static constexpr int kSkyDirections = 8;

  Shader(const RayScene& scene, const GroundMap* ground, const Sky& sky, const Light& light,
         const Textures& textures, const View& view);

  /// Finds what the samples at `u` and `v` show.
  void Meet(Batch& batch) const;
  /// Fills in how the samples that were met are lit, but for how open the sky is; casts rays for
  /// `sunny` and `mirrored` where they are not known yet.
  void Illuminate(Batch& batch) const;

  /// Sets `open` and `weight` of samples (first) by the direction to the sky that each is given
  /// (second). Fastest where those of one direction follow one another.
  void LookToSky(const std::vector<std::pair<int, int>>& samples, Batch& batch) const;

 private:
  void CastToSun(Batch& batch) const;
  void CastMirrored(Batch& batch) const;
  void Meet(Batch& batch, int i, const RayHit& hit) const;
  void LayFootprint(Batch& batch, int i, const Eigen::Vector3f& gradient_u,
                    const Eigen::Vector3f& gradient_v) const;
  void CoverGround(Batch& batch, int i) const;
  void Illuminate(Batch& batch, int i) const;
  float MirroredLight(const RayHit& hit) const;

  const RayScene& scene_;
  const GroundMap* ground_;
  const Sky& sky_;
  const Light& light_;
  const View& view_;
  const Textures& textures_;
  const Eigen::Vector3f to_sun_;
  Eigen::Vector3f sky_directions_[kSkyDirections];
};

}  // namespace carmap
