// Lean maps that carry one section more: what a tile, a patch or a diff has besides its records.
//
// For the codecs of this module. Thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "carmap/format/container.h"
#include "carmap/format/lean_codec.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// Ids of sections beyond those of a lean map (docs/format.md). One file has one of them at most.
enum class AddedSection : uint16_t { kNone = 0, kTile = 6, kPatch = 7, kDiff = 8 };
inline constexpr uint16_t kLastAddedSection = 8;

/// As EncodeLeanMap.
absl::StatusOr<std::string> EncodeWithSection(const LeanMap& map,
                                              const std::optional<Section>& added,
                                              const LeanEncodeOptions& options);

struct DecodedSections {
  LeanMap map;
  std::string_view added;  ///< in the bytes that were decoded; empty if none was asked for
};

/// As DecodeLeanMap; InvalidArgument too for a file of another kind.
absl::StatusOr<DecodedSections> DecodeWithSection(std::string_view bytes, AddedSection added,
                                                  const std::string& name);

}  // namespace carmap
