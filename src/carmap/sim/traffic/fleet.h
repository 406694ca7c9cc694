// The vehicles and people that traffic is made of: one body for each kind and look of models.h.
//
// Immutable, thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "carmap/base/random.h"
#include "carmap/sim/mesh/mesh.h"

namespace carmap {

struct Body {
  std::string_view kind;
  uint32_t first_model = 0;  ///< of Fleet::models(); its phases follow each other
  uint32_t phases = 1;
  double cycle_m = 0;                ///< of way, in which the phases go round; 0: none
  double length_m = 0, width_m = 0;  ///< of the largest phase; without the mirrors of cars
};

/// How often kinds are drawn, as weights.
struct KindWeight {
  std::string_view kind;
  double weight;
};

class Fleet {
 public:
  /// Builds all meshes.
  Fleet();

  const std::vector<Mesh>& models() const { return models_; }
  const std::vector<Body>& bodies() const { return bodies_; }
  /// Any look of a kind drawn by weight; an index into bodies(). The kinds must exist.
  uint32_t Draw(std::span<const KindWeight> mix, HashSequence& random) const;
  /// A lorry, van or car in the place of a longer vehicle; none for cars and what is no vehicle.
  std::optional<uint32_t> NextShorter(uint32_t body) const;

 private:
  std::vector<Mesh> models_;
  std::vector<Body> bodies_;
};

}  // namespace carmap
