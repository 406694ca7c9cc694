#include "carmap/sim/render/ray_scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <tuple>

namespace carmap {
namespace {

Eigen::Matrix3f RotationOf(const Placement& placement) {
  return (Eigen::AngleAxisf(placement.heading_rad, Eigen::Vector3f::UnitZ()) *
          Eigen::AngleAxisf(-placement.pitch_rad, Eigen::Vector3f::UnitY()))
      .toRotationMatrix();
}

/// Copies into a buffer that Embree pads as its loads need.
template <typename T>
void CopyToBuffer(RTCGeometry geometry, RTCBufferType type, RTCFormat format,
                  const std::vector<T>& values) {
  void* buffer = rtcSetNewGeometryBuffer(geometry, type, 0, format, sizeof(T), values.size());
  std::memcpy(buffer, values.data(), values.size() * sizeof(T));
}

}  // namespace

RayScene::RayScene(std::shared_ptr<const World> world, const std::vector<Mesh>& vehicle_models)
    : device_(rtcNewDevice(nullptr)), scene_(rtcNewScene(device_)) {
  rtcSetSceneBuildQuality(scene_, RTC_BUILD_QUALITY_HIGH);
  models_.reserve(world->models.size() + vehicle_models.size());
  std::vector<bool> is_tile(world->models.size(), false);
  for (const Placement& tile : world->tiles) is_tile[tile.model_idx] = true;
  for (size_t i = 0; i < world->models.size(); ++i) {
    models_.push_back(MakeModel(world->models[i], !is_tile[i]));
  }
  for (const Mesh& mesh : vehicle_models) models_.push_back(MakeModel(mesh, true));
  for (const Placement& tile : world->tiles) AddInstance(tile);
  for (const WorldObject& object : world->objects) AddInstance(object.placement);
  world_instances_ = instances_.size();
}

RayScene::~RayScene() {
  for (const Instance& instance : instances_) rtcReleaseGeometry(instance.geometry);
  for (const Model& model : models_) {
    if (model.scene != nullptr) rtcReleaseScene(model.scene);
  }
  rtcReleaseScene(scene_);
  rtcReleaseDevice(device_);
}

RayScene::Face RayScene::FaceOf(const Mesh& mesh, size_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  const Eigen::Vector3f ab = mesh.vertices[b] - mesh.vertices[a];
  const Eigen::Vector3f ac = mesh.vertices[c] - mesh.vertices[a];
  const Eigen::Vector3f cross = ab.cross(ac);
  const float area = cross.squaredNorm();
  Face face;
  face.surface_idx = mesh.surface_of_triangle[triangle];
  if (area <= 0) {  // never hit
    face.normal = Eigen::Vector3f::UnitZ();
    face.gradient_u = face.gradient_v = Eigen::Vector3f::Zero();
    return face;
  }
  face.normal = cross / std::sqrt(area);
  // Dual vectors of the edges in the triangle's plane.
  const Eigen::Vector3f dual_ab = ac.cross(cross) / area, dual_ac = cross.cross(ab) / area;
  const Eigen::Vector2f uv = mesh.uv_m[a];
  const Eigen::Vector2f uv_ab = mesh.uv_m[b] - uv, uv_ac = mesh.uv_m[c] - uv;
  face.gradient_u = uv_ab.x() * dual_ab + uv_ac.x() * dual_ac;
  face.gradient_v = uv_ab.y() * dual_ab + uv_ac.y() * dual_ac;
  face.u0 = uv.x() - face.gradient_u.dot(mesh.vertices[a]);
  face.v0 = uv.y() - face.gradient_v.dot(mesh.vertices[a]);
  return face;
}

/// Each corner's normal is the mean of those of the faces that meet there at a blunt angle, on the
/// same surface. Leaves stay as they are.
std::vector<RayScene::CornerNormals> RayScene::RoundedNormals(const Mesh& mesh,
                                                              const std::vector<Face>& faces) {
  constexpr float kBluntCosine = 0.75f;
  struct Corner {
    std::array<int32_t, 3> place;  ///< in steps of 0.5 mm
    uint32_t surface, face, number;
    auto Key() const { return std::tie(place, surface); }
  };
  std::vector<Corner> corners;
  corners.reserve(3 * faces.size());
  for (uint32_t face = 0; face < faces.size(); ++face) {
    if (mesh.surfaces[faces[face].surface_idx].pattern == Pattern::kLeaves) continue;
    for (uint32_t number = 0; number < 3; ++number) {
      const Eigen::Vector3f place = mesh.vertices[mesh.triangles[face][number]] * 2000;
      corners.push_back({{static_cast<int32_t>(std::lround(place.x())),
                          static_cast<int32_t>(std::lround(place.y())),
                          static_cast<int32_t>(std::lround(place.z()))},
                         faces[face].surface_idx,
                         face,
                         number});
    }
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.Key() < b.Key(); });
  std::vector<CornerNormals> normals(faces.size());
  for (size_t i = 0; i < faces.size(); ++i) normals[i].fill(faces[i].normal);
  for (auto first = corners.begin(); first != corners.end();) {
    const auto last = std::find_if(
        first, corners.end(), [&](const Corner& corner) { return corner.Key() != first->Key(); });
    for (auto corner = first; corner != last; ++corner) {
      const Eigen::Vector3f& own = faces[corner->face].normal;
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (auto other = first; other != last; ++other) {
        const Eigen::Vector3f& normal = faces[other->face].normal;
        if (normal.dot(own) > kBluntCosine) sum += normal;
      }
      normals[corner->face][corner->number] = sum.normalized();
    }
    first = last;
  }
  return normals;
}

RayScene::Model RayScene::MakeModel(const Mesh& mesh, bool rounded) {
  Model model;
  model.surfaces = mesh.surfaces;
  if (mesh.triangles.empty()) return model;
  model.faces.reserve(mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) model.faces.push_back(FaceOf(mesh, i));
  if (rounded) model.corner_normals = RoundedNormals(mesh, model.faces);
  RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
  CopyToBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, mesh.vertices);
  CopyToBuffer(geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, mesh.triangles);
  rtcCommitGeometry(geometry);
  model.scene = rtcNewScene(device_);
  rtcSetSceneBuildQuality(model.scene, RTC_BUILD_QUALITY_HIGH);
  rtcAttachGeometry(model.scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(model.scene);
  return model;
}

void RayScene::AddInstance(const Placement& placement) {
  const Model& model = models_[placement.model_idx];
  if (model.scene == nullptr) return;
  Instance instance{.placement = placement};
  instance.rotation = RotationOf(placement);
  instance.geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(instance.geometry, model.scene);
  Place(instance);
  rtcAttachGeometryByID(scene_, instance.geometry, static_cast<unsigned>(instances_.size()));
  instances_.push_back(instance);
  changed_ = true;
}

void RayScene::Place(Instance& instance) const {
  instance.position = (instance.placement.position_in_enu - origin_in_enu_).cast<float>();
  Eigen::Matrix<float, 3, 4> origin_from_model;
  origin_from_model << instance.placement.scale * instance.rotation, instance.position;
  rtcSetGeometryTransform(instance.geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR,
                          origin_from_model.data());
  rtcCommitGeometry(instance.geometry);
}

void RayScene::SetTraffic(const std::vector<Placement>& traffic) {
  while (instances_.size() > world_instances_) {
    rtcDetachGeometry(scene_, static_cast<unsigned>(instances_.size() - 1));
    rtcReleaseGeometry(instances_.back().geometry);
    instances_.pop_back();
  }
  for (const Placement& placement : traffic) AddInstance(placement);
  changed_ = true;
}

void RayScene::MoveOrigin(const Eigen::Vector3d& near_in_enu) {
  const Eigen::Vector3d origin =
      (near_in_enu / kOriginStepM).array().round().matrix() * kOriginStepM;
  if (origin != origin_in_enu_) {
    origin_in_enu_ = origin;
    for (Instance& instance : instances_) Place(instance);
    changed_ = true;
  }
  if (changed_) rtcCommitScene(scene_);
  changed_ = false;
}

RayHit RayScene::HitAt(uint32_t instance_id, uint32_t triangle, const Eigen::Vector2f& in_triangle,
                       const Eigen::Vector3f& position) const {
  const Instance& instance = instances_[instance_id];
  const Model& model = models_[instance.placement.model_idx];
  const Face& face = model.faces[triangle];
  const float scale = instance.placement.scale;
  const Eigen::Vector3f in_model =
      instance.rotation.transpose() * (position - instance.position) / scale;
  RayHit hit;
  hit.surface = &model.surfaces[face.surface_idx];
  hit.placement = &instance.placement;
  hit.normal = hit.face_normal = instance.rotation * face.normal;
  if (!model.corner_normals.empty()) {
    const auto& [a, b, c] = model.corner_normals[triangle];
    const Eigen::Vector3f rounded = a + in_triangle.x() * (b - a) + in_triangle.y() * (c - a);
    hit.normal = (instance.rotation * rounded).normalized();
  }
  hit.uv_m = {face.gradient_u.dot(in_model) + face.u0, face.gradient_v.dot(in_model) + face.v0};
  hit.gradient_u = instance.rotation * face.gradient_u / scale;
  hit.gradient_v = instance.rotation * face.gradient_v / scale;
  hit.group = (instance_id << 12) ^ face.surface_idx;
  return hit;
}

}  // namespace carmap
