// The world as rays see it: every mesh a tree of boxes, every placement an instance of one.
//
// Coordinates are relative to an origin near the camera, so that single precision is enough
// wherever in the world it is. SetTraffic and MoveOrigin must not run beside other calls.
#pragma once

#include <embree3/rtcore.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "carmap/sim/mesh/mesh.h"
#include "carmap/sim/town/world.h"

namespace carmap {

/// What a ray met, in coordinates relative to the origin.
struct RayHit {
  const Surface* surface = nullptr;
  const Placement* placement = nullptr;
  Eigen::Vector3f face_normal;             ///< unit length, outwards
  Eigen::Vector3f normal;                  ///< ... of the rounded shape that the faces stand for
  Eigen::Vector2f uv_m;                    ///< along the surface
  Eigen::Vector3f gradient_u, gradient_v;  ///< of them
  uint32_t group = 0;                      ///< the same on one surface of one placement
};

class RayScene {
 public:
  RayScene(std::shared_ptr<const World> world, const std::vector<Mesh>& vehicle_models);
  ~RayScene();
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;

  void SetTraffic(const std::vector<Placement>& traffic);
  /// Sets the origin near a place and brings the tree of instances up to date.
  void MoveOrigin(const Eigen::Vector3d& near_in_enu);

  /// A multiple of kOriginStepM along each axis.
  const Eigen::Vector3d& origin_in_enu() const { return origin_in_enu_; }
  static constexpr double kOriginStepM = 512;

  RTCScene scene() const { return scene_; }
  /// `in_triangle` are Embree's coordinates of the point in the triangle.
  RayHit HitAt(uint32_t instance_id, uint32_t triangle, const Eigen::Vector2f& in_triangle,
               const Eigen::Vector3f& position) const;

 private:
  /// How a triangle lies, in the model's frame.
  struct Face {
    Eigen::Vector3f normal, gradient_u, gradient_v;
    float u0 = 0, v0 = 0;  ///< at the model's origin
    uint32_t surface_idx = 0;
  };
  using CornerNormals = std::array<Eigen::Vector3f, 3>;
  struct Model {
    RTCScene scene = nullptr;  ///< none for a mesh without triangles
    std::vector<Face> faces;
    std::vector<CornerNormals> corner_normals;  ///< none for one of flat faces
    std::vector<Surface> surfaces;
  };
  struct Instance {
    Placement placement;
    Eigen::Matrix3f rotation;  ///< of the model's frame
    Eigen::Vector3f position;
    RTCGeometry geometry = nullptr;
  };

  static Face FaceOf(const Mesh& mesh, size_t triangle);
  static std::vector<CornerNormals> RoundedNormals(const Mesh& mesh,
                                                   const std::vector<Face>& faces);
  Model MakeModel(const Mesh& mesh, bool rounded);
  void AddInstance(const Placement& placement);
  void Place(Instance& instance) const;

  RTCDevice device_ = nullptr;
  RTCScene scene_ = nullptr;
  std::vector<Model> models_;
  std::vector<Instance> instances_;  ///< the world's, then traffic; by Embree's number
  size_t world_instances_ = 0;
  Eigen::Vector3d origin_in_enu_ = Eigen::Vector3d::Zero();
  bool changed_ = true;
};

}  // namespace carmap
