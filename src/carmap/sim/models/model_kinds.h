// The tables of kinds that models.h chooses from, by file; and parts that many models share.
//
// Only for the sources of this folder.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "carmap/sim/mesh/mesh.h"
#include "carmap/sim/mesh/mesh_builder.h"

namespace carmap {

struct ModelKind {
  std::string_view kind;
  uint32_t variants = 1;
  Mesh (*make)(uint32_t variant) = nullptr;  ///< below `variants`
  uint32_t phases = 1;                       ///< how many variants make a cycle of motion ...
  float cycle_m = 0;                         ///< ... that goes with so much way
};

std::span<const ModelKind> VegetationKinds();
std::span<const ModelKind> SignKinds();
std::span<const ModelKind> FurnitureKinds();
std::span<const ModelKind> BarrierKinds();
std::span<const ModelKind> RoadWorkKinds();
std::span<const ModelKind> CarKinds();
std::span<const ModelKind> LongVehicleKinds();
std::span<const ModelKind> PeopleKinds();

/// How far posts and trunks reach into the earth.
inline constexpr float kFootingM = 0.4f;

inline Surface Steel(float albedo, SemanticClass label) {
  return {Pattern::kMetal, albedo, 0.6f, 0.06f, label};
}
inline Surface Painted(float albedo, SemanticClass label) {
  return {Pattern::kPlain, albedo, 1, 0.03f, label};
}
inline Surface SignFace(float albedo, SemanticClass label = SemanticClass::kTrafficSign) {
  return {Pattern::kSign, albedo, 1, 0.02f, label};
}

/// A flat outline seen from its front, counter-clockwise, with a border of this share of its size
/// (0: none) and a back.
void AddPlate(MeshBuilder& builder, const Points3& outline, float border_share, SurfaceIdx face,
              SurfaceIdx border, SurfaceIdx back);

/// An upright board that looks to -x: `face` in front with a frame of `frame_m` about it, all else
/// of `rest`.
void AddBoard(MeshBuilder& builder, const Eigen::Vector3f& centre, float width_m, float height_m,
              float thickness_m, float frame_m, SurfaceIdx face, SurfaceIdx rest);

/// A straight bar with a rectangular section, `width_m` level and `height_m` upright (or along x,
/// for an upright bar).
void AddBar(MeshBuilder& builder, const Eigen::Vector3f& from, const Eigen::Vector3f& to,
            float width_m, float height_m, SurfaceIdx surface);

/// Upright, from the earth to `height_m`.
void AddPost(MeshBuilder& builder, float x, float y, float height_m, float radius_m,
             SurfaceIdx surface, int sides = 8);

}  // namespace carmap
