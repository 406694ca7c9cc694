#include "carmap/sim/traffic/fleet.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "carmap/sim/models/models.h"

namespace carmap {
namespace {

/// Mirrors stick out above this height. What is shorter than a car is widest above it.
constexpr float kBelowMirrorsM = 0.8f, kShortestCarM = 3;

double WidthOf(const Model& model) {
  if (model.length_m < kShortestCarM) return model.width_m;
  float half_m = 0;
  for (const Eigen::Vector3f& v : model.mesh.vertices) {
    if (v.z() < kBelowMirrorsM) half_m = std::max(half_m, std::abs(v.y()));
  }
  return 2 * half_m;
}

}  // namespace

Fleet::Fleet() {
  for (const std::string_view kind : VehicleKinds()) {
    const uint32_t phases = VehiclePhases(kind), variants = VehicleVariants(kind);
    for (uint32_t look = 0; look < variants / phases; ++look) {
      Body body{.kind = kind,
                .first_model = static_cast<uint32_t>(models_.size()),
                .phases = phases,
                .cycle_m = VehicleCycleM(kind)};
      for (uint32_t phase = 0; phase < phases; ++phase) {
        Model model = MakeVehicle(kind, look * phases + phase);
        body.length_m = std::max<double>(body.length_m, model.length_m);
        body.width_m = std::max(body.width_m, WidthOf(model));
        models_.push_back(std::move(model.mesh));
      }
      bodies_.push_back(body);
    }
  }
}

uint32_t Fleet::Draw(std::span<const KindWeight> mix, HashSequence& random) const {
  double total = 0;
  for (const KindWeight& entry : mix) total += entry.weight;
  double rest = random.Unit() * total;
  std::string_view kind = mix.back().kind;
  for (const KindWeight& entry : mix) {
    if (rest < entry.weight) {
      kind = entry.kind;
      break;
    }
    rest -= entry.weight;
  }
  const auto has_kind = [&](const Body& body) { return body.kind == kind; };
  const auto first = std::find_if(bodies_.begin(), bodies_.end(), has_kind);
  const auto looks = static_cast<uint32_t>(std::count_if(first, bodies_.end(), has_kind));
  return static_cast<uint32_t>(first - bodies_.begin()) + random.Below(looks);
}

std::optional<uint32_t> Fleet::NextShorter(uint32_t body) const {
  constexpr double kLongestCarM = 4.8, kLessM = 0.2;
  if (bodies_[body].length_m < kLongestCarM) return std::nullopt;
  std::optional<uint32_t> shorter;
  for (uint32_t i = 0; i < bodies_.size(); ++i) {
    const std::string_view kind = bodies_[i].kind;
    if (kind != "lorry" && kind != "van" && kind != "hatchback") continue;
    if (bodies_[i].length_m > bodies_[body].length_m - kLessM) continue;
    if (!shorter || bodies_[i].length_m > bodies_[*shorter].length_m) shorter = i;
  }
  return shorter;
}

}  // namespace carmap
