// What the parts of a complete map take, and what is left of them in a lean one (paper §5.4,
// Figure 18).
//
// Pure functions, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include "carmap/format/alternatives.h"
#include "carmap/map/map.h"
#include "carmap/map/strip.h"

namespace carmap {

/// The complete map is what `stripped` kept of `map`, with all features of its keyframes as the
/// mapper has them and with the index that Reconstruct makes of the lean map. Errors: as
/// MeasureComposition.
absl::StatusOr<CompositionBytes> MeasureComposition(const Map& map, const StrippedMap& stripped);

}  // namespace carmap
