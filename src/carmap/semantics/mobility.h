// Whether what a pixel shows will still be there on another day: the coarse classes of the dynamic
// object filter (§3.3).
//
// The paper votes on static and non-static rather than on finer labels: a segmenter that takes a
// tree for a building is wrong about the class and right about this. Pure functions.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "carmap/dataset/semantic_class.h"

namespace carmap {

enum class Mobility : uint8_t {
  kUnknown = 0,    ///< nothing was told
  kStatic = 1,     ///< stays where it is: roads, buildings, signs, trees
  kNonStatic = 2,  ///< moves or may move (§3.3 dynamic and semi-dynamic): also a parked car
};

Mobility MobilityOf(SemanticClass semantic_class);

/// The class that Cityscapes calls so ("traffic light"); nothing if there is none.
std::optional<SemanticClass> SemanticClassOf(std::string_view cityscapes_name);

/// Of a Cityscapes class, or of "static", "non-static" or "unlabelled"; nothing for other names.
std::optional<Mobility> MobilityOfName(std::string_view name);

/// What labelled keyframes say of a landmark (§3.3).
struct MobilityVotes {
  uint32_t is_static = 0, non_static = 0;

  /// A keyframe's vote, or with `count` -1 its withdrawal. Unknown is no vote.
  void Add(Mobility mobility, int count = 1);

  /// Non-static by more than two votes in three, since segmenters flicker; unknown without votes.
  Mobility Elected() const;

  bool operator==(const MobilityVotes&) const = default;
};

}  // namespace carmap
