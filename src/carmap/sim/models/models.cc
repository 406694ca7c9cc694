#include "carmap/sim/models/models.h"

#include <fmt/core.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "carmap/sim/mesh/mesh_builder.h"
#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Kinds = std::vector<ModelKind>;

Kinds Joined(std::initializer_list<std::span<const ModelKind>> tables) {
  Kinds all;
  for (const auto& table : tables) all.insert(all.end(), table.begin(), table.end());
  return all;
}

const Kinds& Props() {
  static const auto* const kProps = new Kinds(
      Joined({VegetationKinds(), SignKinds(), FurnitureKinds(), BarrierKinds(), RoadWorkKinds()}));
  return *kProps;
}

const Kinds& Vehicles() {
  static const auto* const kVehicles =
      new Kinds(Joined({CarKinds(), LongVehicleKinds(), PeopleKinds()}));
  return *kVehicles;
}

const ModelKind* Find(const Kinds& kinds, std::string_view kind) {
  const auto found = std::find_if(kinds.begin(), kinds.end(),
                                  [&](const ModelKind& known) { return known.kind == kind; });
  return found == kinds.end() ? nullptr : &*found;
}

const ModelKind& FindOrDie(const Kinds& kinds, std::string_view kind) {
  const ModelKind* found = Find(kinds, kind);
  if (found != nullptr) return *found;
  fmt::print(stderr, "carmap: no model of kind \"{}\"\n", kind);
  std::abort();
}

Model Make(const Kinds& kinds, std::string_view kind, uint32_t variant) {
  const ModelKind& found = FindOrDie(kinds, kind);
  Model model{.kind = found.kind, .mesh = found.make(variant % found.variants)};
  const Eigen::AlignedBox3f bounds = BoundsOf(model.mesh);
  model.length_m = bounds.sizes().x();
  model.width_m = bounds.sizes().y();
  model.height_m = bounds.max().z();
  return model;
}

std::vector<std::string_view> Names(const Kinds& kinds) {
  std::vector<std::string_view> names;
  for (const ModelKind& kind : kinds) names.push_back(kind.kind);
  return names;
}

uint32_t Variants(const Kinds& kinds, std::string_view kind) {
  const ModelKind* found = Find(kinds, kind);
  return found == nullptr ? 0 : found->variants;
}

}  // namespace

Model MakeProp(std::string_view kind, uint32_t variant) { return Make(Props(), kind, variant); }
uint32_t PropVariants(std::string_view kind) { return Variants(Props(), kind); }
std::vector<std::string_view> PropKinds() { return Names(Props()); }

Model MakeVehicle(std::string_view kind, uint32_t variant) {
  return Make(Vehicles(), kind, variant);
}
uint32_t VehicleVariants(std::string_view kind) { return Variants(Vehicles(), kind); }
std::vector<std::string_view> VehicleKinds() { return Names(Vehicles()); }
uint32_t VehiclePhases(std::string_view kind) { return FindOrDie(Vehicles(), kind).phases; }
float VehicleCycleM(std::string_view kind) { return FindOrDie(Vehicles(), kind).cycle_m; }

}  // namespace carmap
