#include "carmap/semantics/mobility.h"

#include <algorithm>
#include <array>

namespace carmap {
namespace {

/// By train id.
constexpr std::array<std::string_view, 19> kCityscapesNames = {
    "road",         "sidewalk",   "building", "wall",       "fence",  "pole",  "traffic light",
    "traffic sign", "vegetation", "terrain",  "sky",        "person", "rider", "car",
    "truck",        "bus",        "train",    "motorcycle", "bicycle"};

}  // namespace

Mobility MobilityOf(SemanticClass semantic_class) {
  if (semantic_class <= SemanticClass::kSky) return Mobility::kStatic;
  if (semantic_class <= SemanticClass::kBicycle) return Mobility::kNonStatic;
  return Mobility::kUnknown;
}

std::optional<SemanticClass> SemanticClassOf(std::string_view cityscapes_name) {
  const auto* const it =
      std::find(kCityscapesNames.begin(), kCityscapesNames.end(), cityscapes_name);
  if (it == kCityscapesNames.end()) return std::nullopt;
  return static_cast<SemanticClass>(it - kCityscapesNames.begin());
}

std::optional<Mobility> MobilityOfName(std::string_view name) {
  if (name == "static") return Mobility::kStatic;
  if (name == "non-static") return Mobility::kNonStatic;
  if (name == "unlabelled") return Mobility::kUnknown;
  const auto semantic_class = SemanticClassOf(name);
  if (!semantic_class) return std::nullopt;
  return MobilityOf(*semantic_class);
}

void MobilityVotes::Add(Mobility mobility, int count) {
  if (mobility == Mobility::kStatic) is_static += count;
  if (mobility == Mobility::kNonStatic) non_static += count;
}

Mobility MobilityVotes::Elected() const {
  if (is_static + non_static == 0) return Mobility::kUnknown;
  return non_static > 2 * is_static ? Mobility::kNonStatic : Mobility::kStatic;
}

}  // namespace carmap
